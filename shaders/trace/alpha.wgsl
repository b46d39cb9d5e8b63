// Alpha tests of hits: a mask compares alpha with its cutoff; a blended surface is hit with the probability alpha.  The random number is a
// hash of the seed and the triangle, so that closest-hit and any-hit rays with the same seed agree.  A constant keeps it apart from other
// hashes.
#define_import_path bevy_restir::trace::alpha

#import bevy_restir::common::constants::INSTANCE_ALPHA
#import bevy_restir::common::rng::{pcg4d, unit_float}
#import bevy_restir::scene::bindings::instances
#import bevy_restir::scene::material::opacity_at
#import bevy_restir::trace::drawn_sides::hits_side

fn passes_alpha_test(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    let opacity = opacity_at(instance, triangle, barycentrics);
    return opacity >= 1.0 || unit_float(pcg4d(vec4<u32>(alpha_seed, instance, triangle, 0x5eedu))).x < opacity;
}

// Whether a ray that intersects a triangle hits it.
#ifdef ALPHA
fn accepts_hit(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    let is_opaque = (instances[instance].flags & INSTANCE_ALPHA) == 0u;
    return hits_side(instance, triangle) && (is_opaque || passes_alpha_test(instance, triangle, barycentrics, alpha_seed));
}
#else
fn accepts_hit(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    return hits_side(instance, triangle);
}
#endif
