// LOBE_REFLECTION: dielectric, metal and the reflection of a transmissive interface.  They share D and G, and so form one lobe with the sum
// of their Fresnel terms.  Energy compensation multiplies each term by 1 + F0·(1 - E)/E (Turquin 2019; Lanz 2025, 2.1.3), where E depends
// on n·wo and α alone: the lobe is then not reciprocal.  Directions are in the local frame, n = z.
#define_import_path bevy_restir::bsdf::reflection

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::ggx::{ggx_reflection, ggx_reflection_pdf}
#import bevy_restir::bsdf::roughness::alpha_of
#import bevy_restir::bsdf::transmission::{interface_f0, interface_reflectance}
#import bevy_restir::bsdf::types::Bsdf

// Share of light that a microfacet reflects, c = wo·h.
fn reflectance(b: Bsdf, c: f32) -> vec3<f32> {
    return (1.0 - b.metallic) * (1.0 - b.transmission) * schlick(b.dielectric_reflectance, c) * compensation(b, b.dielectric_reflectance)
        + b.metallic * schlick(b.base_color, c) * compensation(b, b.base_color)
        + interface_reflectance(b, c) * compensation(b, interface_f0(b));
}

// Factor of a term with the reflectance `f0` at normal incidence.
#ifdef ENERGY_COMPENSATION
fn compensation(b: Bsdf, f0: vec3<f32>) -> vec3<f32> {
    return 1.0 + f0 * b.compensation;
}
#else
fn compensation(b: Bsdf, f0: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}
#endif

// f·|n·wi| of a rough lobe.
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

// Density of wi, solid angle, given that the sampled normal reflects.
fn reflection_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    if !(wi.z > 0.0) {
        return 0.0;
    }
    return ggx_reflection_pdf(wo, normalize(wo + wi), alpha_of(b));
}
