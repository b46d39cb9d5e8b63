// The albedo of a surface, which the denoiser divides light by: what it averages then has no texture.
#define_import_path bevy_restir::denoiser::albedo

#import bevy_restir::bsdf::diffuse::diffuse_base
#import bevy_restir::bsdf::reflection::reflectance
#import bevy_restir::bsdf::transmission::transmitted_share
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::math::max_component
#ifdef CLEARCOAT
#import bevy_restir::bsdf::coat::{coat_reflectance, coat_share}
#endif

struct Albedo {
    diffuse: vec3<f32>,        // with the light that scatters below the surface
    specular: vec3<f32>,       // of all other lobes: an estimate, for the direction of the camera
    roughness: f32,            // GGX α of the smoothest of them
}

#ifdef CLEARCOAT
fn albedo_of(b: Bsdf, wo: vec3<f32>) -> Albedo {
    let specular = coat_reflectance(b, wo) + (1.0 - coat_share(b, wo)) * base_specular_albedo(b, wo);
    return Albedo(diffuse_base(b), specular, select(b.roughness, min(b.roughness, b.coat_roughness), b.coat > 0.0));
}
#else
fn albedo_of(b: Bsdf, wo: vec3<f32>) -> Albedo {
    return Albedo(diffuse_base(b), base_specular_albedo(b, wo), b.roughness);
}
#endif

fn base_specular_albedo(b: Bsdf, wo: vec3<f32>) -> vec3<f32> {
    let cosine = abs(dot(wo, b.n));
    return reflectance(b, cosine) + transmitted_share(b, cosine);
}

// Whether a surface has lobes with this albedo.  Darker ones count as black.
fn has_albedo(albedo: vec3<f32>) -> bool {
    return max_component(albedo) > 1.0e-4;
}

// Least albedo of a channel, relative to the greatest one.
const LEAST_SHARE: f32 = 0.02;

// The albedo that light is divided by, and multiplied by again.  Light that a channel hardly reflects is noise: to divide it by less would
// make it the greatest part of what is filtered.
fn divisor_of(albedo: vec3<f32>) -> vec3<f32> {
    return max(albedo, vec3<f32>(LEAST_SHARE * max_component(albedo)));
}
