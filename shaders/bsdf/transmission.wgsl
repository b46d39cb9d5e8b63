// LOBE_TRANSMISSION: refraction into a volume (Walter et al. 2007) with the exact dielectric Fresnel equations, or transmission through a
// thin wall (KHR_materials_transmission) with Schlick's approximation, where wi is the reflected direction mirrored through the wall.
// Radiance scales by (index on wo's side / index on wi's side)² = 1/eta².  Directions are in the local frame, n = z.  Without the shader
// definition TRANSMISSION the lobe is 0.
#define_import_path bevy_restir::bsdf::transmission

#import bevy_restir::bsdf::fresnel::{dielectric_fresnel, refraction_cosine_squared, schlick}
#import bevy_restir::bsdf::ggx::{ggx_d, ggx_g2_over_cos_cos, ggx_visible_pdf}
#import bevy_restir::bsdf::roughness::alpha_of
#import bevy_restir::bsdf::types::{Bsdf, bsdf_is_thin}
#import bevy_restir::common::constants::{ALPHA_DELTA, LEAST_MAGNITUDE}

// Spread of directions, α·|eta - 1|, below which refraction is a delta: h cannot be recovered from wi with enough precision.
const DELTA_SPREAD: f32 = 2.0e-5;

#ifdef TRANSMISSION
// Fresnel reflectance of the interface, c = wo·h.
fn interface_fresnel(b: Bsdf, c: f32) -> vec3<f32> {
    if bsdf_is_thin(b) {
        return schlick(b.dielectric_reflectance, c);
    }
    return vec3<f32>(dielectric_fresnel(c, b.eta));
}

// Fresnel reflectance of the interface at normal incidence.
fn interface_f0(b: Bsdf) -> vec3<f32> {
    if bsdf_is_thin(b) {
        return b.dielectric_reflectance;
    }
    let r = (b.eta - 1.0) / (b.eta + 1.0);
    return vec3<f32>(r * r);
}

// The interface's term of `reflectance`.
fn interface_reflectance(b: Bsdf, c: f32) -> vec3<f32> {
    return (1.0 - b.metallic) * b.transmission * interface_fresnel(b, c);
}

// Share of light that a microfacet transmits, c = wo·h.
fn transmitted_share(b: Bsdf, c: f32) -> vec3<f32> {
    return (1.0 - b.metallic) * b.transmission * (1.0 - interface_fresnel(b, c)) * b.base_color;
}

fn transmission_is_delta(b: Bsdf) -> bool {
    return b.roughness < ALPHA_DELTA || (!bsdf_is_thin(b) && b.roughness * abs(b.eta - 1.0) < DELTA_SPREAD);
}

// The direction that forms h with wo: wi for refraction; for a thin wall, wi mirrored to wo's side.
fn reflection_side_wi(b: Bsdf, wi: vec3<f32>) -> vec3<f32> {
    return select(wi, vec3<f32>(wi.xy, -wi.z), bsdf_is_thin(b));
}

// wo + eta·wi on the upper side: the half vector times a length whose square is the denominator of Walter's Jacobian (Eq. 17).  For a thin
// wall, with the mirrored wi and eta = 1, that Jacobian is the one of reflection.
fn transmission_half_vector(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let v = wo + b.eta * reflection_side_wi(b, wi);
    return select(-v, v, v.z >= 0.0);
}

// |wi·h|, or 0 where wi is on the wrong side of h: refraction leads below h; for a thin wall the mirrored wi must be above it.
fn transmission_cosine_i(b: Bsdf, wi: vec3<f32>, h: vec3<f32>) -> f32 {
    let c = dot(reflection_side_wi(b, wi), h);
    return max(select(-c, c, bsdf_is_thin(b)), 0.0);
}

// f·|n·wi| of a rough lobe.
fn transmission_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let v = transmission_half_vector(b, wo, wi);
    let v2 = dot(v, v);
    if !(wi.z < 0.0) || !(v2 > 0.0) {
        return vec3<f32>(0.0);
    }
    let h = v * inverseSqrt(v2);
    let wo_h = dot(wo, h);
    let wi_h = transmission_cosine_i(b, wi, h);
    if !(wo_h > 0.0) || !(wi_h > 0.0) {
        return vec3<f32>(0.0);
    }
    let alpha = alpha_of(b);
    let d_g2 = ggx_d(h, alpha) * ggx_g2_over_cos_cos(wo, wi, alpha) * -wi.z;
    return transmitted_share(b, wo_h) * (d_g2 * wo_h * wi_h / v2);
}

// Direction that the normal h transmits wo to; z >= 0 at total internal reflection.
fn transmission_sample(b: Bsdf, wo: vec3<f32>, h: vec3<f32>) -> vec3<f32> {
    let c = dot(wo, h);
    if bsdf_is_thin(b) {
        let r = 2.0 * c * h - wo;
        return vec3<f32>(r.xy, -r.z);
    }
    // A rough lobe that counts as a delta (eta near 1) does not deflect: h would only add noise.
    if b.roughness >= ALPHA_DELTA && transmission_is_delta(b) {
        return -wo;
    }
    let t2 = refraction_cosine_squared(c, b.eta);
    if !(t2 > 0.0) {
        return vec3<f32>(1.0, 0.0, 0.0);
    }
    return normalize((c / b.eta - sqrt(t2)) * h - wo / b.eta);
}

// Density of wi, solid angle, given that the sampled normal transmits.
fn transmission_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let v = transmission_half_vector(b, wo, wi);
    let v2 = dot(v, v);
    if !(wi.z < 0.0) || !(v2 > 0.0) {
        return 0.0;
    }
    let h = v * inverseSqrt(v2);
    return ggx_visible_pdf(wo, h, alpha_of(b)) * (b.eta * b.eta * transmission_cosine_i(b, wi, h) / v2);
}

// |wo·h| of the normal h that transmits wo to wi.
fn transmission_cosine(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let v = transmission_half_vector(b, wo, wi);
    return clamp(dot(wo, v) * inverseSqrt(max(dot(v, v), LEAST_MAGNITUDE)), 0.0, 1.0);
}
#else
fn interface_f0(b: Bsdf) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn interface_reflectance(b: Bsdf, c: f32) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn transmitted_share(b: Bsdf, c: f32) -> vec3<f32> {
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
