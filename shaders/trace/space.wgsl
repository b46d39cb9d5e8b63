// Transforms a ray to the object space of an instance, now or in the last frame.
#define_import_path bevy_restir::trace::space

#import bevy_restir::common::ray::Ray
#import bevy_restir::scene::bindings::instances

struct ObjectRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
}

// The direction is not normalized, so that t has the same meaning in both spaces.  The translation is subtracted before the rotation: far
// from the origin this is exact, where the affine inverse would lose all precision.
fn object_ray(ray: Ray, instance: u32, previous: bool) -> ObjectRay {
    if previous {
        let world = instances[instance].previous_world_from_object;
        let origin = ray.origin - vec3<f32>(world[0].w, world[1].w, world[2].w);
        // The inverse by cofactors: that of the last frame is not stored.
        let x = cross(world[1].xyz, world[2].xyz);
        let y = cross(world[2].xyz, world[0].xyz);
        let z = cross(world[0].xyz, world[1].xyz);
        let linear = mat3x3<f32>(
            vec3<f32>(x.x, y.x, z.x),
            vec3<f32>(x.y, y.y, z.y),
            vec3<f32>(x.z, y.z, z.z),
        );
        let scale = 1.0 / dot(world[0].xyz, x);
        return ObjectRay(origin * linear * scale, ray.direction * linear * scale);
    }
    let world = instances[instance].world_from_object;
    let object = instances[instance].object_from_world;
    let linear = mat3x3<f32>(object[0].xyz, object[1].xyz, object[2].xyz);
    let origin = ray.origin - vec3<f32>(world[0].w, world[1].w, world[2].w);
    return ObjectRay(origin * linear, ray.direction * linear);
}
