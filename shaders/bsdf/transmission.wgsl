// LOBE_TRANSMISSION: refraction through a thick interface (Walter et al. 2007) and the exact dielectric Fresnel.  Local frame, n = z.
// Radiance scales by (index on wo's side / index on wi's side)² = 1/eta².  Without the feature TRANSMISSION nothing is transmitted.
#define_import_path bevy_restir::bsdf::transmission

#import bevy_restir::bsdf::fresnel::{dielectric_fresnel, refraction_cosine_squared}
#import bevy_restir::bsdf::ggx::{ggx_d, ggx_g2_over_cos_cos, ggx_visible_pdf}
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::ALPHA_DELTA

// Spread of directions, α·|eta - 1|, below which refraction is a delta: there wi no longer tells h.
const SPREAD_DELTA: f32 = 2.0e-5;

#ifdef TRANSMISSION
// The interface's part of `reflectance`.
fn interface_reflectance(b: Bsdf, c: f32) -> vec3<f32> {
    return vec3<f32>((1.0 - b.metallic) * b.transmission * dielectric_fresnel(c, b.eta));
}

// Share of light that a microfacet refracts, c = wo.h
fn transmittance(b: Bsdf, c: f32) -> vec3<f32> {
    return (1.0 - b.metallic) * b.transmission * (1.0 - dielectric_fresnel(c, b.eta)) * b.base_color;
}

fn transmission_is_delta(b: Bsdf) -> bool {
    return b.roughness < ALPHA_DELTA || b.roughness * abs(b.eta - 1.0) < SPREAD_DELTA;
}

// wo + eta·wi, turned to the upper side: h times its length, whose square is also the denominator of Walter's Jacobian.
fn refraction_half_vector(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let v = wo + b.eta * wi;
    return select(-v, v, v.z >= 0.0);
}

// f·|n.wi| of a rough lobe
fn transmission_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let v = refraction_half_vector(b, wo, wi);
    let v2 = dot(v, v);
    if !(wi.z < 0.0) || !(v2 > 0.0) {
        return vec3<f32>(0.0);
    }
    let h = v * inverseSqrt(v2);
    let wo_h = dot(wo, h);
    let wi_h = dot(wi, h);
    if !(wo_h > 0.0) || !(wi_h < 0.0) {
        return vec3<f32>(0.0);
    }
    let d_g2 = ggx_d(h, b.roughness) * ggx_g2_over_cos_cos(wo, wi, b.roughness) * -wi.z;
    return transmittance(b, wo_h) * (d_g2 * wo_h * -wi_h / v2);
}

// The refracted direction; z = 0 where all is reflected.
fn transmission_sample(b: Bsdf, wo: vec3<f32>, h: vec3<f32>) -> vec3<f32> {
    // A delta of a rough lobe (eta near 1) goes straight on: h would only add noise to it.
    if b.roughness >= ALPHA_DELTA && transmission_is_delta(b) {
        return -wo;
    }
    let c = dot(wo, h);
    let t2 = refraction_cosine_squared(c, b.eta);
    if !(t2 > 0.0) {
        return vec3<f32>(1.0, 0.0, 0.0);
    }
    return normalize((c / b.eta - sqrt(t2)) * h - wo / b.eta);
}

// Solid angle of wi, given that a sampled normal refracts.
fn transmission_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let v = refraction_half_vector(b, wo, wi);
    let v2 = dot(v, v);
    if !(wi.z < 0.0) || !(v2 > 0.0) {
        return 0.0;
    }
    let h = v * inverseSqrt(v2);
    let wi_h = dot(wi, h);
    if !(wi_h < 0.0) {
        return 0.0;
    }
    return ggx_visible_pdf(wo, h, b.roughness) * (b.eta * b.eta * -wi_h / v2);
}

// |cos| of wo and the normal that refracts it to wi.
fn transmission_cosine(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let v = refraction_half_vector(b, wo, wi);
    return clamp(dot(wo, v) * inverseSqrt(max(dot(v, v), 1.0e-30)), 0.0, 1.0);
}
#else
fn interface_reflectance(b: Bsdf, c: f32) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn transmittance(b: Bsdf, c: f32) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn transmission_is_delta(b: Bsdf) -> bool {
    return true;
}

fn transmission_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn transmission_sample(b: Bsdf, wo: vec3<f32>, h: vec3<f32>) -> vec3<f32> {
    return -wo;
}

fn transmission_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return 0.0;
}

fn transmission_cosine(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return 1.0;
}
#endif
