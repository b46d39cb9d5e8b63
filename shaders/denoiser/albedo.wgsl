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

// An albedo counts as black if no component is above this bound.
const BLACK_ALBEDO: f32 = 1.0e-4;

// Whether a surface has lobes with this albedo.
fn has_albedo(albedo: vec3<f32>) -> bool {
    return max_component(albedo) > BLACK_ALBEDO;
}

// Channels whose albedo is below this share of the greatest one say too little about the light.
const LEAST_ALBEDO_SHARE: f32 = 0.02;
// Floors of divisors, for albedos that are not black.  Channels that say enough about the light are above LEAST_ALBEDO_SHARE * BLACK_ALBEDO,
// which is 2e-6: LEAST_CHANNEL only keeps the quotients of other channels finite, which are not used.  The luminance is above 7e-6, that of
// BLACK_ALBEDO in blue alone: LEAST_LUMINANCE changes the quotient of the darkest blues only, by less than a third.
const LEAST_CHANNEL: f32 = 1.0e-6;
const LEAST_LUMINANCE: f32 = 1.0e-5;

// Light that arrives, from light that leaves.  Channels that hardly reflect get the light of the others.
fn without_albedo(light: vec3<f32>, albedo: vec3<f32>) -> vec3<f32> {
    let gray = luminance(light) / max(luminance(albedo), LEAST_LUMINANCE);
    let greatest = max_component(albedo);
    return select(vec3<f32>(gray), light / max(albedo, vec3<f32>(LEAST_CHANNEL)), albedo > vec3<f32>(LEAST_ALBEDO_SHARE * greatest));
}
