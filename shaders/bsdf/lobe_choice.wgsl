// Probabilities of sampling each lobe, by its estimated albedo: Fresnel terms are evaluated at n·wo, as in mirror reflection.
#define_import_path bevy_restir::bsdf::lobe_choice

#import bevy_restir::bsdf::diffuse::diffuse_albedo
#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::reflection::reflectance
#import bevy_restir::bsdf::transmission::transmitted_share
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::LEAST_DIVISOR
#import bevy_restir::common::math::{luminance, max_component}
#ifdef CLEARCOAT
#import bevy_restir::bsdf::coat::{coat_reflectance, coat_reflects, coat_share}
#endif

// Least probability of choosing one of two kinds of lobes that both contribute.
const LOBE_PROBABILITY_MIN: f32 = 0.05;

struct LobeChoice {
    coat: f32,                 // probability of the coat against the base
    specular: f32,             // probability of microfacets against diffuse, given the base
}

// `cos_o`: n·wo.
fn lobe_choice(b: Bsdf, wo: vec3<f32>, cos_o: f32) -> LobeChoice {
    return LobeChoice(coat_probability(b, wo, cos_o), specular_probability(b, cos_o));
}

// Luminance of the albedos of the base: (diffuse, microfacets).
fn base_albedo(b: Bsdf, cos_o: f32) -> vec2<f32> {
    return vec2<f32>(
        luminance(diffuse_albedo(b) * (1.0 - schlick(b.dielectric_reflectance, cos_o))),
        luminance(reflectance(b, cos_o) + transmitted_share(b, cos_o)),
    );
}

// Whether the microfacets of the base contribute.
fn is_specular(b: Bsdf) -> bool {
    let f0 = max(b.dielectric_reflectance, b.metallic * b.base_color);
    return max(max_component(f0), b.transmission) > 0.0;
}

// Probability of microfacets against diffuse; at least LOBE_PROBABILITY_MIN for each where both contribute.
fn specular_probability(b: Bsdf, cos_o: f32) -> f32 {
    if !(max_component(diffuse_albedo(b)) > 0.0) {
        return 1.0;
    }
    if !is_specular(b) {
        return 0.0;
    }
    let albedo = base_albedo(b, cos_o);
    let p = albedo.y / max(albedo.y + albedo.x, LEAST_DIVISOR);
    return clamp(p, LOBE_PROBABILITY_MIN, 1.0 - LOBE_PROBABILITY_MIN);
}

// Probability of the coat against the base.
#ifdef CLEARCOAT
fn coat_probability(b: Bsdf, wo: vec3<f32>, cos_o: f32) -> f32 {
    if !coat_reflects(b, wo) {
        return 0.0;
    }
    // With normal maps, wo may be below the base's normal and above the coat's.
    if !(cos_o > 0.0) || !(is_specular(b) || max_component(diffuse_albedo(b)) > 0.0) {
        return 1.0;
    }
    let coat = coat_reflectance(b, wo);
    let albedo = base_albedo(b, cos_o);
    let p = coat / max(coat + (1.0 - coat_share(b, wo)) * (albedo.x + albedo.y), LEAST_DIVISOR);
    return clamp(p, LOBE_PROBABILITY_MIN, 1.0 - LOBE_PROBABILITY_MIN);
}
#else
fn coat_probability(b: Bsdf, wo: vec3<f32>, cos_o: f32) -> f32 {
    return 0.0;
}
#endif

// Probability of reflection against transmission at a microfacet, c = wo·h: proportional to the light that each of them carries.
fn reflection_probability(b: Bsdf, c: f32) -> f32 {
    let r = luminance(reflectance(b, c));
    let t = luminance(transmitted_share(b, c));
    if !(t > 0.0) {
        return 1.0;
    }
    return r / (r + t);
}
