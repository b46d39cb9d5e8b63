// GGX microfacets with height-correlated Smith masking (Heitz 2014), sampled by visible normals as spherical caps (Dupuy and Benyoub
// 2023).  Directions are in the local frame, n = z; `alpha` is the roughness along x and y.  The formulas avoid 0/0 at grazing angles, and
// the cancellation in 1 - cos².
#define_import_path bevy_restir::bsdf::ggx

#import bevy_restir::common::constants::{PI, TWO_PI}

// D(h): density of normals, in projected solid angle.
fn ggx_d(h: vec3<f32>, alpha: vec2<f32>) -> f32 {
    let s = h.xy / alpha;
    let t = dot(s, s) + h.z * h.z;
    return 1.0 / (PI * alpha.x * alpha.y * t * t);
}

// |cos|·(1 + 2Λ), which the masking functions are built from.
fn ggx_stretch(w: vec3<f32>, alpha: vec2<f32>) -> f32 {
    let s = alpha * w.xy;
    return sqrt(dot(s, s) + w.z * w.z);
}

// G1(wo) / |n·wo|.
fn ggx_g1_over_cos(wo: vec3<f32>, alpha: vec2<f32>) -> f32 {
    return 2.0 / (abs(wo.z) + ggx_stretch(wo, alpha));
}

// G2(wo, wi) / (|n·wo| |n·wi|).
fn ggx_g2_over_cos_cos(wo: vec3<f32>, wi: vec3<f32>, alpha: vec2<f32>) -> f32 {
    return 2.0 / (abs(wi.z) * ggx_stretch(wo, alpha) + abs(wo.z) * ggx_stretch(wi, alpha));
}

// G2(wo, wi) / G1(wo).
fn ggx_masking_ratio(wo: vec3<f32>, wi: vec3<f32>, alpha: vec2<f32>) -> f32 {
    return ggx_g2_over_cos_cos(wo, wi, alpha) * abs(wi.z) / ggx_g1_over_cos(wo, alpha);
}

// Density of visible normals, solid angle of h: G1(wo) (wo·h) D(h) / |n·wo|.
fn ggx_visible_pdf(wo: vec3<f32>, h: vec3<f32>, alpha: vec2<f32>) -> f32 {
    return ggx_g1_over_cos(wo, alpha) * max(dot(wo, h), 0.0) * ggx_d(h, alpha);
}

// Samples a normal that is visible from wo, wo.z > 0.
fn ggx_sample(wo: vec3<f32>, alpha: vec2<f32>, u: vec2<f32>) -> vec3<f32> {
    // Stretch to the hemisphere.
    let s = normalize(vec3<f32>(alpha * wo.xy, wo.z));
    // A direction uniform on the cap z >= -s.z; its sum with s is the normal.  1 - z² is computed by its factors, exact near both ends.
    let phi = TWO_PI * u.x;
    let rise = (1.0 - u.y) * (1.0 + s.z);
    let one_minus_s = dot(s.xy, s.xy) / (1.0 + s.z);
    let r = sqrt(u.y * (1.0 + s.z) * (rise + one_minus_s));
    let h = vec3<f32>(r * cos(phi) + s.x, r * sin(phi) + s.y, rise);
    // Stretch back.
    return normalize(vec3<f32>(alpha * h.xy, h.z));
}

// f·|n·wi| of reflection with F = 1: D·G2·|n·wi| / (4 |n·wo| |n·wi|), for wi.z > 0.
fn ggx_reflection(wo: vec3<f32>, wi: vec3<f32>, h: vec3<f32>, alpha: vec2<f32>) -> f32 {
    return 0.25 * ggx_d(h, alpha) * ggx_g2_over_cos_cos(wo, wi, alpha) * wi.z;
}

// Density of reflected directions, solid angle of wi: that of visible normals over 4 (wo·h).
fn ggx_reflection_pdf(wo: vec3<f32>, h: vec3<f32>, alpha: vec2<f32>) -> f32 {
    return 0.25 * ggx_g1_over_cos(wo, alpha) * ggx_d(h, alpha);
}
