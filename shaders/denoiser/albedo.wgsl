// The albedo of a surface, which the denoiser divides light by: what it averages then has no texture.
#define_import_path bevy_restir::denoiser::albedo

#import bevy_restir::bsdf::diffuse::diffuse_base
#import bevy_restir::bsdf::reflection::reflectance
#import bevy_restir::bsdf::transmission::transmitted_share
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::math::{luminance, max_component}
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

// Channels whose albedo is below this share of the greatest one say too little about the light.
const LEAST_ALBEDO_SHARE: f32 = 0.02;

// Light that arrives, from light that leaves.  Channels that hardly reflect get the light of the others.
fn without_albedo(light: vec3<f32>, albedo: vec3<f32>) -> vec3<f32> {
    let gray = luminance(light) / max(luminance(albedo), 1.0e-5);
    let greatest = max_component(albedo);
    return select(vec3<f32>(gray), light / max(albedo, vec3<f32>(1.0e-6)), albedo > vec3<f32>(LEAST_ALBEDO_SHARE * greatest));
}
