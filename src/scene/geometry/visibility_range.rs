//! Selects levels of detail by `VisibilityRange`: each object has one level for all rays.
//!
//! Bevy dithers two levels in screen space where their ranges overlap.  Rays have no screen space, so the level changes abruptly in the
//! middle of the overlap.

use bevy::{
    camera::{Camera, primitives::Aabb, visibility::VisibilityRange},
    ecs::{prelude::*, system::SystemParam},
    math::Vec3A,
    transform::components::GlobalTransform,
};

use crate::settings::Restir;

/// Visibility ranges of the main world, and the cameras that they depend on.
#[derive(SystemParam)]
pub(crate) struct VisibilityRanges<'w, 's> {
    ranges: Query<'w, 's, (&'static VisibilityRange, &'static GlobalTransform, Option<&'static Aabb>)>,
    cameras: Query<'w, 's, (Entity, &'static Camera, &'static GlobalTransform), With<Restir>>,
}

impl VisibilityRanges<'_, '_> {
    /// The position that distances are measured from: that of the first active `Restir` camera.  `None` if there is no such camera or no
    /// range.
    pub(crate) fn viewpoint(&self) -> Option<Vec3A> {
        if self.ranges.is_empty() {
            return None;
        }
        let active = self.cameras.iter().filter(|(_, camera, _)| camera.is_active);
        let first = active.min_by_key(|(entity, camera, _)| (camera.order, *entity))?;
        Some(first.2.translation_vec3a())
    }

    /// Whether an entity is outside its visibility range.
    pub(crate) fn is_culled(&self, entity: Entity, viewpoint: Vec3A) -> bool {
        let Ok((range, transform, bounds)) = self.ranges.get(entity) else { return false };
        let position = match bounds.filter(|_| range.use_aabb) {
            Some(bounds) => transform.affine().transform_point3a(bounds.center),
            None => transform.translation_vec3a(),
        };
        abrupt(range).is_culled((viewpoint - position).length())
    }
}

/// The range without margins: each end is the middle of its margin.
fn abrupt(range: &VisibilityRange) -> VisibilityRange {
    let middle = |margin: &core::ops::Range<f32>| 0.5 * margin.start + 0.5 * margin.end;
    VisibilityRange::abrupt(middle(&range.start_margin), middle(&range.end_margin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exactly_one_of_several_overlapping_levels_is_visible() {
        let level = |start: core::ops::Range<f32>, end| {
            abrupt(&VisibilityRange { start_margin: start, end_margin: end, use_aabb: false })
        };
        let levels =
            [level(0.0..0.0, 20.0..25.0), level(20.0..25.0, 70.0..75.0), level(70.0..75.0, f32::MAX..f32::MAX)];
        for distance in [0.0, 10.0, 20.0, 22.4, 22.5, 25.0, 60.0, 72.5, 74.0, 1e9] {
            let visible = levels.iter().filter(|level| level.is_visible_at_all(distance)).count();
            assert_eq!(visible, 1, "{distance}");
        }
    }
}
