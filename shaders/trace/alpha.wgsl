// Whether a ray is stopped where it meets a surface whose alpha is not 1: a mask by its cutoff, a blend by one random number.
#define_import_path bevy_restir::trace::alpha

#import bevy_restir::common::constants::MATERIAL_ALPHA_MASK
#import bevy_restir::common::rng::{pcg4d, unit_float}
#import bevy_restir::scene::bindings::{instances, materials}

// The same seed gives the same answer for a triangle, in whatever order a traversal asks.
fn alpha_passes(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    let material = instances[instance].material;
    let alpha = materials[material].alpha;
    if (materials[material].flags & MATERIAL_ALPHA_MASK) != 0u {
        return alpha >= materials[material].alpha_cutoff;
    }
    return unit_float(pcg4d(vec4<u32>(alpha_seed, instance, triangle, 0u))).x < alpha;
}
