//! Frustum culling: the draw calls of the visibility pass that show something to a camera.

use bevy::math::{Mat4, UVec2, Vec2, Vec3, Vec4};

use crate::{
    gpu_layout::GpuCamera,
    scene::{
        accel::blas::Bounds,
        bindings::SceneBindings,
        geometry::{draw_list::Draw, instances::InstancePool},
    },
};

/// A draw call is split where more hidden triangles than this lie between visible instances.
const SPLIT_TRIANGLES: u32 = 4096;
/// A draw call of more than `MANY_INSTANCES` instances with fewer triangles than this is drawn whole: a test would cost more than it saves.
const LEAST_TRIANGLES: u32 = 64;
const MANY_INSTANCES: usize = 64;
/// Scenes with more instances are drawn whole: a test of all takes about a millisecond, whenever the camera or an instance moves.
const MAX_INSTANCES: u64 = 1 << 16;

/// The space that a camera sees.
struct Frustum {
    /// Coefficients of the six planes, for points relative to `origin`: positive inside.
    planes: [Vec4; 6],
    origin: Vec3,
}

impl Frustum {
    fn new(camera: &GpuCamera, size: UVec2) -> Self {
        let clip = Mat4::from_cols_array_2d(&camera.clip_from_offset);
        let [x, y, z, w] = [0, 1, 2, 3].map(|row| clip.row(row));
        // Jitter moves the image by up to a pixel, which is 2 / size in clip space.
        let [wide, high] = (Vec2::ONE + 2.0 / size.as_vec2()).to_array();
        let planes = [w * wide + x, w * wide - x, w * high + y, w * high - y, w - z, z];
        let [.., place] = camera.world_from_view;
        Self { planes, origin: Vec4::from_array(place).truncate() }
    }

    /// False only if the box is outside of one of the planes.
    fn may_show(&self, bounds: Bounds) -> bool {
        /// Relative error of a distance, which has seven roundings.
        const ROUNDING: f32 = 1e-6;
        let [min, max] = [bounds.0, bounds.1].map(|corner| Vec3::from_array(corner) - self.origin);
        // NaN, from boxes at the end of the range of f32, counts as inside.
        !self.planes.iter().any(|plane| {
            let normal = plane.truncate();
            // The corner that is farthest inside.
            let corner = Vec3::select(normal.cmpgt(Vec3::ZERO), max, min);
            let size = normal.abs().dot(corner.abs()) + plane.w.abs();
            normal.dot(corner) + plane.w < -ROUNDING * size
        })
    }
}

/// The draw calls of a camera.  They are made again only if the camera or an instance has changed.
#[derive(Default)]
pub(crate) struct VisibleDraws {
    made_for: Option<Inputs>,
    pub draws: Vec<Draw>,
}

/// All values that the draw calls depend on.
#[derive(Clone, Copy, PartialEq)]
struct Inputs {
    draws_key: [u64; 2],
    motion_revision: u64,
    camera: GpuCamera,
    size: UVec2,
    layers: u32,
}

impl VisibleDraws {
    /// Brings them up to date.  `size`: traced pixels.
    pub(super) fn update(
        &mut self,
        scene: &SceneBindings,
        instances: &InstancePool,
        camera: GpuCamera,
        size: UVec2,
        layers: u32,
    ) {
        let SceneBindings { draws_key, motion_revision, .. } = *scene;
        let inputs = Inputs { draws_key, motion_revision, camera, size, layers };
        if self.made_for == Some(inputs) {
            return;
        }
        self.made_for = Some(inputs);
        self.draws.clear();
        let frustum = Frustum::new(&camera, size);
        let is_seen = |slot| instances.live_in(slot).is_none_or(|live| frustum.may_show(live.bounds));
        for draw in scene.draw_list.draws.iter().filter(|draw| draw.camera_mask & layers != 0) {
            let are_small = draw.triangles < LEAST_TRIANGLES && draw.instances.len() > MANY_INSTANCES;
            if are_small || scene.instances > MAX_INSTANCES {
                self.draws.push(draw.clone());
            } else {
                add_seen(&mut self.draws, draw, is_seen);
            }
        }
    }
}

/// Adds the parts of a draw call whose instances are seen.
fn add_seen(draws: &mut Vec<Draw>, draw: &Draw, is_seen: impl Fn(u32) -> bool) {
    let mut open: Option<Draw> = None;
    for slot in draw.instances.clone().filter(|slot| is_seen(*slot)) {
        match &mut open {
            Some(open) if (slot - open.instances.end).saturating_mul(draw.triangles) <= SPLIT_TRIANGLES => {
                open.instances.end = slot + 1
            }
            _ => {
                draws.extend(open.take());
                open = Some(Draw { instances: slot..slot + 1, ..draw.clone() });
            }
        }
    }
    draws.extend(open);
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Affine3A;

    fn camera(clip_from_view: Mat4, world_from_view: Affine3A) -> GpuCamera {
        let turn = Mat4::from_mat3(world_from_view.matrix3.into());
        GpuCamera {
            clip_from_offset: (clip_from_view * turn.inverse()).to_cols_array_2d(),
            world_from_view: Mat4::from(world_from_view).to_cols_array_2d(),
            ..Default::default()
        }
    }

    /// A box is left out only if no point of it is in the image, and most boxes outside of the image are.
    #[test]
    fn boxes_in_the_image_are_seen() {
        let poses = [
            Affine3A::IDENTITY,
            Affine3A::from_rotation_y(2.0) * Affine3A::from_translation(Vec3::new(3.0, -7.0, 2.0)),
            Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0)) * Affine3A::from_rotation_x(1.0),
        ];
        let projections = [
            Mat4::perspective_infinite_reverse_rh(1.0, 1.5, 0.1),
            Mat4::orthographic_rh(-3.0, 3.0, -2.0, 2.0, 50.0, -1.0),
        ];
        let mut seed = 1u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let (mut inside, mut left_out) = (0, 0);
        for (pose, projection) in poses.iter().flat_map(|pose| projections.map(|projection| (*pose, projection))) {
            let camera = camera(projection, pose);
            let frustum = Frustum::new(&camera, UVec2::new(300, 200));
            for _ in 0..2000 {
                let [center, half] = [20.0, 3.0].map(|scale| scale * Vec3::new(random(), random(), random()));
                let center = pose.transform_point3(center);
                let bounds = ((center - half.abs()).to_array(), (center + half.abs()).to_array());
                let shows = (0..64).any(|i| {
                    let place = Vec3::new((i % 4) as f32, (i / 4 % 4) as f32, (i / 16) as f32) / 1.5 - 1.0;
                    let point = pose.inverse().transform_point3(center + half.abs() * place);
                    let clip = projection * point.extend(1.0);
                    clip.w > 0.0
                        && clip.truncate().truncate().abs().max_element() <= clip.w
                        && (0.0..=clip.w).contains(&clip.z)
                });
                assert!(!shows || frustum.may_show(bounds), "{bounds:?}");
                inside += u32::from(shows);
                left_out += u32::from(!frustum.may_show(bounds));
            }
        }
        assert!(inside > 500 && left_out > 7000, "{inside} of 12,000 boxes are seen, and {left_out} are left out");
    }

    #[test]
    fn far_boxes_and_broken_ones_are_seen() {
        let camera = camera(Mat4::perspective_infinite_reverse_rh(1.0, 1.5, 0.1), Affine3A::IDENTITY);
        let frustum = Frustum::new(&camera, UVec2::new(300, 200));
        for half in [1.0, 1e18, 1e38, f32::INFINITY, f32::NAN] {
            assert!(frustum.may_show(([-half; 3], [half; 3])), "{half}");
        }
        assert!(frustum.may_show(([-1.0, -1.0, -1e18], [1.0, 1.0, -9e17])));
        assert!(!frustum.may_show(([-1.0, -1.0, 1.0], [1.0, 1.0, 2.0])), "behind the camera");
    }

    #[test]
    fn a_draw_call_is_split_where_much_is_hidden() {
        let draw = |instances, triangles| Draw { instances, triangles, camera_mask: 1, cull: None };
        let seen = |draw: &Draw, slots: &[u32]| {
            let mut draws = Vec::new();
            add_seen(&mut draws, draw, |slot| slots.contains(&slot));
            draws.into_iter().map(|draw| (draw.instances.start, draw.instances.end)).collect::<Vec<_>>()
        };
        assert_eq!(seen(&draw(4..20, 1000), &[]), []);
        assert_eq!(seen(&draw(4..20, 1000), &[5, 6, 9]), [(5, 10)], "2,000 triangles are not worth a call");
        assert_eq!(seen(&draw(4..20, 1000), &[4, 6, 12, 19]), [(4, 7), (12, 13), (19, 20)]);
        assert_eq!(seen(&draw(0..5000, 1_000_000), &[0, 4999]), [(0, 1), (4999, 5000)], "more than 2³² triangles");
    }
}
