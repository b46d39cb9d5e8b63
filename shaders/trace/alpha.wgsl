// Whether a ray meets a triangle with an alpha: mask below its cutoff never, blend with the probability alpha.  One random number
// a ray and triangle, a hash of both, so that closest-hit and any-hit rays of one seed agree.
#define_import_path bevy_restir::trace::alpha

#import bevy_restir::common::constants::{INSTANCE_ALPHA, MATERIAL_ALPHA_MASK, MATERIAL_ALPHA_BLEND}
#import bevy_restir::common::rng::{pcg4d, unit_float}
#import bevy_restir::scene::bindings::{instances, materials}
#import bevy_restir::scene::material::alpha_at

fn alpha_passes(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    let material = instances[instance].material;
    let flags = materials[material].flags;
    if (flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND)) == 0u {
        return true;
    }
    let alpha = alpha_at(instance, triangle, barycentrics);
    if (flags & MATERIAL_ALPHA_MASK) != 0u {
        return alpha >= materials[material].alpha_cutoff;
    }
    return unit_float(pcg4d(vec4<u32>(alpha_seed, instance, triangle, 0x5eedu))).x < alpha;
}

// Whether a ray that meets a triangle is stopped by it.
#ifdef ALPHA
fn accepts(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    if (instances[instance].flags & INSTANCE_ALPHA) == 0u {
        return true;
    }
    return alpha_passes(instance, triangle, barycentrics, alpha_seed);
}
#else
fn accepts(instance: u32, triangle: u32, barycentrics: vec2<f32>, alpha_seed: u32) -> bool {
    return true;
}
#endif
