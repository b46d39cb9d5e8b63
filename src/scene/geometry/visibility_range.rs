//! `VisibilityRange`: of an object's levels of detail one is there, for every ray.  Rays have no pixel to dither in: where Bevy fades one
//! level into the next, the change is in the middle.

use bevy::{
    camera::{Camera, primitives::Aabb, visibility::VisibilityRange},
    ecs::{prelude::*, system::SystemParam},
    math::Vec3A,
    transform::components::GlobalTransform,
};

use crate::settings::Restir;

/// The levels of detail of the main world, and who looks at them.
#[derive(SystemParam)]
pub(crate) struct VisibilityRanges<'w, 's> {
    ranges: Query<'w, 's, (&'static VisibilityRange, &'static GlobalTransform, Option<&'static Aabb>)>,
    cameras: Query<'w, 's, (Entity, &'static Camera, &'static GlobalTransform), With<Restir>>,
}

impl VisibilityRanges<'_, '_> {
    /// Where distances are measured from: the first `Restir` camera of those that are drawn; `None` where nothing asks.
    pub(crate) fn eye(&self) -> Option<Vec3A> {
        if self.ranges.is_empty() {
            return None;
        }
        let active = self.cameras.iter().filter(|(_, camera, _)| camera.is_active);
        let first = active.min_by_key(|(entity, camera, _)| (camera.order, *entity))?;
        Some(first.2.translation_vec3a())
    }

    /// Whether an entity is a level that is out of range.
    pub(crate) fn hides(&self, entity: Entity, eye: Vec3A) -> bool {
        let Ok((range, transform, bounds)) = self.ranges.get(entity) else { return false };
        let place = match bounds.filter(|_| range.use_aabb) {
            Some(bounds) => transform.affine().transform_point3a(bounds.center),
            None => transform.translation_vec3a(),
        };
        abrupt(range).is_culled((eye - place).length())
    }
}

/// The range without its fading.
fn abrupt(range: &VisibilityRange) -> VisibilityRange {
    let middle = |margin: &core::ops::Range<f32>| 0.5 * margin.start + 0.5 * margin.end;
    VisibilityRange::abrupt(middle(&range.start_margin), middle(&range.end_margin))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_levels_that_fade_into_each_other_one_is_there() {
        let level = |start: core::ops::Range<f32>, end| {
            abrupt(&VisibilityRange { start_margin: start, end_margin: end, use_aabb: false })
        };
        let levels =
            [level(0.0..0.0, 20.0..25.0), level(20.0..25.0, 70.0..75.0), level(70.0..75.0, f32::MAX..f32::MAX)];
        for distance in [0.0, 10.0, 20.0, 22.4, 22.5, 25.0, 60.0, 72.5, 74.0, 1e9] {
            let there = levels.iter().filter(|level| level.is_visible_at_all(distance)).count();
            assert_eq!(there, 1, "{distance}");
        }
    }
}
