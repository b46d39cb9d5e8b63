// Absorption inside of transmissive objects (Beer-Lambert law).  Without ATTENUATION no object absorbs.
#define_import_path bevy_restir::path::medium

#import bevy_restir::bsdf::types::bsdf_is_thin
#import bevy_restir::common::constants::FAR
#import bevy_restir::common::math::{exponential_decay_3, max_component}
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::surface::{Surface, surface_at}

// Absorption coefficient (1/m) along a ray that leaves `s` towards `wi`, where `medium` is that of the ray that arrived.
#ifdef ATTENUATION
fn medium_towards(s: Surface, wi: vec3<f32>, medium: vec3<f32>) -> vec3<f32> {
    if dot(wi, s.bsdf.n_geo) >= 0.0 || bsdf_is_thin(s.bsdf) {
        return medium;
    }
    return select(vec3<f32>(0.0), s.attenuation, s.front != 0u);
}

// Absorption coefficient along a ray that arrived at `s`.  A ray that leaves an object inside of another one carries no medium; the inside of
// the other object tells which one it crossed.
fn medium_before(s: Surface, medium: vec3<f32>) -> vec3<f32> {
    let is_inside = s.front == 0u && !bsdf_is_thin(s.bsdf);
    return select(medium, s.attenuation, is_inside && max_component(medium) == 0.0);
}

// The same for a point of a triangle.
fn medium_before_point(instance: u32, triangle: u32, barycentrics: vec2<f32>, wo: vec3<f32>, medium: vec3<f32>) -> vec3<f32> {
    return medium_before(surface_at(instance, triangle, barycentrics, wo, Cone(0.0, 0.0), false), medium);
}

fn absorbs(medium: vec3<f32>) -> bool {
    return max_component(medium) > 0.0;
}

// A ray that escapes from the scene is not absorbed: it has no length, and the object around its origin is open.
fn transmittance(medium: vec3<f32>, distance: f32) -> vec3<f32> {
    return exponential_decay_3(medium * select(distance, 0.0, distance >= FAR));
}
#else
fn absorbs(medium: vec3<f32>) -> bool {
    return false;
}

fn medium_towards(s: Surface, wi: vec3<f32>, medium: vec3<f32>) -> vec3<f32> {
    return medium;
}

fn medium_before(s: Surface, medium: vec3<f32>) -> vec3<f32> {
    return medium;
}

fn medium_before_point(instance: u32, triangle: u32, barycentrics: vec2<f32>, wo: vec3<f32>, medium: vec3<f32>) -> vec3<f32> {
    return medium;
}

fn transmittance(medium: vec3<f32>, distance: f32) -> vec3<f32> {
    return vec3<f32>(1.0);
}
#endif
