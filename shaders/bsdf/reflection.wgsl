// LOBE_REFLECTION: dielectric, metal and the reflection of a transmitting interface, which share D and G and so make one lobe.
// Local frame, n = z.  Its Fresnel factor is the sum of theirs, each times 1 + F0·(1 - E)/E where energy compensation is on
// (Turquin 2019; Lanz 2025, 2.1.3): light that bounces between microfacets, by E(n.wo, α) alone, so not reciprocal.
#define_import_path bevy_restir::bsdf::reflection

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::ggx::{ggx_reflection, ggx_reflection_pdf}
#import bevy_restir::bsdf::roughness::alpha_of
#import bevy_restir::bsdf::transmission::{interface_at_normal, interface_reflectance}
#import bevy_restir::bsdf::types::Bsdf

// Share of light that a microfacet reflects, c = wo.h
fn reflectance(b: Bsdf, c: f32) -> vec3<f32> {
    return (1.0 - b.metallic) * (1.0 - b.transmission) * schlick(b.dielectric_reflectance, c) * compensated(b, b.dielectric_reflectance)
        + b.metallic * schlick(b.base_color, c) * compensated(b, b.base_color)
        + interface_reflectance(b, c) * compensated(b, interface_at_normal(b));
}

#ifdef ENERGY_COMPENSATION
fn compensated(b: Bsdf, at_normal: vec3<f32>) -> vec3<f32> {
    return 1.0 + at_normal * b.compensation;
}
#else
fn compensated(b: Bsdf, at_normal: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}
#endif

// f·|n.wi| of a rough lobe
fn reflection_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    if !(wi.z > 0.0) {
        return vec3<f32>(0.0);
    }
    let h = normalize(wo + wi);
    return reflectance(b, dot(wo, h)) * ggx_reflection(wo, wi, h, alpha_of(b));
}

fn reflection_sample(wo: vec3<f32>, h: vec3<f32>) -> vec3<f32> {
    return 2.0 * dot(wo, h) * h - wo;
}

// Solid angle of wi, given that a sampled normal reflects.
fn reflection_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    if !(wi.z > 0.0) {
        return 0.0;
    }
    return ggx_reflection_pdf(wo, normalize(wo + wi), alpha_of(b));
}
