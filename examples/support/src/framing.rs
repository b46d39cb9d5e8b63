//! Camera positions that show a whole scene.

use bevy::{camera::primitives::Aabb, prelude::*};

/// Greatest coordinate that the plugin renders, m.
const FARTHEST: f32 = 1e18;

/// Center and radius of a sphere around the boxes; a box of 2 m around the origin where there are none.
pub fn bounding_sphere<'a>(parts: impl IntoIterator<Item = (&'a GlobalTransform, &'a Aabb)>) -> (Vec3, f32) {
    let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
    for (transform, aabb) in parts {
        for i in 0..8 {
            let sign = Vec3::new(((i & 1) * 2) as f32 - 1.0, (i & 2) as f32 - 1.0, ((i & 4) / 2) as f32 - 1.0);
            let corner = transform.transform_point(Vec3::from(aabb.center + aabb.half_extents * Vec3A::from(sign)));
            if corner.is_finite() {
                // The square of the size, too, must be finite.
                let corner = corner.clamp(Vec3::splat(-FARTHEST), Vec3::splat(FARTHEST));
                (low, high) = (low.min(corner), high.max(corner));
            }
        }
    }
    if low.cmpgt(high).any() {
        (low, high) = (Vec3::NEG_ONE, Vec3::ONE);
    }
    (0.5 * (low + high), (0.5 * (high - low)).length().max(1e-6))
}

/// A camera in front of a sphere, a little to the right and above. `aspect` is width over height of the picture.
pub fn in_front(center: Vec3, radius: f32, aspect: f32) -> (Transform, Projection) {
    let projection = PerspectiveProjection { near: 0.01 * radius, far: 100.0 * radius, ..Default::default() };
    let narrowest = ((0.5 * projection.fov).tan() * aspect.clamp(0.1, 1.0)).atan();
    let distance = radius / narrowest.sin() * 0.9;
    let eye = center + distance * Vec3::new(0.45, 0.3, 0.84).normalize();
    (Transform::from_translation(eye).looking_at(center, Vec3::Y), Projection::Perspective(projection))
}
