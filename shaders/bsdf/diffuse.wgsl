// LOBE_DIFFUSE: Lambert under a dielectric interface, weighted by 1 - F(wo·h) (glTF 2.0 Appendix B).  With DIFFUSE_TRANSMISSION it
// also transmits (KHR_materials_diffuse_transmission).  Directions are in the local frame, n = z.
#define_import_path bevy_restir::bsdf::diffuse

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::{INV_PI, TWO_PI}

// Albedo of reflection plus transmission, without the Fresnel weight.
fn diffuse_albedo(b: Bsdf) -> vec3<f32> {
    return (1.0 - b.metallic) * (1.0 - b.transmission) * b.base_color;
}

// f·|n·wi|.  For transmission, F is evaluated with wi mirrored to wo's side, so that both sides have the same weight.
fn diffuse_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let share = diffuse_share(b, wi.z);
    if !(share > 0.0) {
        return vec3<f32>(0.0);
    }
    let c = dot(wo, normalize(wo + vec3<f32>(wi.xy, abs(wi.z))));
    return diffuse_albedo(b) * (1.0 - schlick(b.dielectric_reflectance, c)) * (share * abs(wi.z) * INV_PI);
}

// Density of wi, solid angle, given the lobe.
fn diffuse_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return diffuse_share(b, wi.z) * abs(wi.z) * INV_PI;
}

// Samples wi; u.z chooses the side.
fn diffuse_sample(b: Bsdf, wo: vec3<f32>, u: vec3<f32>) -> vec3<f32> {
    let r = sqrt(u.y);
    let phi = TWO_PI * u.x;
    return vec3<f32>(r * cos(phi), r * sin(phi), diffuse_side(b, u.z) * sqrt(1.0 - u.y));
}

// Share of diffuse light on the side of z; and the sign of z that a random number chooses.
#ifdef DIFFUSE_TRANSMISSION
fn diffuse_share(b: Bsdf, z: f32) -> f32 {
    return select(b.diffuse_transmission, 1.0 - b.diffuse_transmission, z > 0.0);
}

fn diffuse_side(b: Bsdf, u: f32) -> f32 {
    return select(1.0, -1.0, u < b.diffuse_transmission);
}
#else
fn diffuse_share(b: Bsdf, z: f32) -> f32 {
    return select(0.0, 1.0, z > 0.0);
}

fn diffuse_side(b: Bsdf, u: f32) -> f32 {
    return 1.0;
}
#endif
