// Transforms a ray to the object space of an instance, now or in the last frame.
#define_import_path bevy_restir::trace::space

#import bevy_restir::common::ray::Ray
#import bevy_restir::scene::triangle::{instance_transform, linear_inverse}

struct ObjectRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

// The direction is not normalized, so that t has the same meaning in both spaces.  The translation is subtracted before the rotation: far
// from the origin this is exact, where the affine inverse would lose all precision.
fn object_ray(ray: Ray, instance: u32, previous: bool) -> ObjectRay {
    let world = instance_transform(instance, previous);
    let linear = linear_inverse(instance, previous);
    let origin = ray.origin - vec3<f32>(world[0].w, world[1].w, world[2].w);
    return ObjectRay(origin * linear, ray.direction * linear);
}
