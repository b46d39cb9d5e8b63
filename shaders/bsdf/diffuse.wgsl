// LOBE_DIFFUSE: Lambert under a coat that reflects its share F at h (glTF 2.0 Appendix B).  Local frame, n = z.
#define_import_path bevy_restir::bsdf::diffuse

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::{INV_PI, TWO_PI}

// Albedo but for the coat's share.
fn diffuse_albedo(b: Bsdf) -> vec3<f32> {
    return (1.0 - b.metallic) * (1.0 - b.transmission) * b.base_color;
}

// f·|n.wi|
fn diffuse_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    if !(wi.z > 0.0) {
        return vec3<f32>(0.0);
    }
    let c = dot(wo, normalize(wo + wi));
    return diffuse_albedo(b) * (1.0 - schlick(b.dielectric_reflectance, c)) * (wi.z * INV_PI);
}

fn diffuse_sample(b: Bsdf, wo: vec3<f32>, u: vec2<f32>) -> vec3<f32> {
    let r = sqrt(u.y);
    let phi = TWO_PI * u.x;
    return vec3<f32>(r * cos(phi), r * sin(phi), sqrt(1.0 - u.y));
}

// Solid angle, given the lobe.
fn diffuse_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return max(wi.z, 0.0) * INV_PI;
}
