// LOBE_DIFFUSE: Lambert under a dielectric interface, weighted by 1 - F(wo·h) (glTF 2.0 Appendix B).  With DIFFUSE_TRANSMISSION it
// also transmits (KHR_materials_diffuse_transmission).  With SUBSURFACE, light that scatters below the surface is subtracted from
// the reflected light.  Directions are in the local frame, n = z.
#define_import_path bevy_restir::bsdf::diffuse

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::{INV_PI, LEAST_DIVISOR, TWO_PI}

// Albedo of everything diffuse, without the Fresnel weight: reflection, transmission, and scattering below the surface.
fn diffuse_base(b: Bsdf) -> vec3<f32> {
    return (1.0 - b.metallic) * (1.0 - b.transmission) * b.base_color;
}

// f·|n·wi|.  For transmission, F is evaluated with wi mirrored to wo's side, so that both sides have the same weight.
fn diffuse_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let share = diffuse_share(b, wi.z);
    if !(share > 0.0) {
        return vec3<f32>(0.0);
    }
    let c = dot(wo, normalize(wo + vec3<f32>(wi.xy, abs(wi.z))));
    return surface_part(b, wi.z, diffuse_base(b) * (1.0 - schlick(b.dielectric_reflectance, c)) * (share * abs(wi.z) * INV_PI));
}

// Density of wi, solid angle, given the lobe.
fn diffuse_pdf(b: Bsdf, wi: vec3<f32>) -> f32 {
    return diffuse_probability(b, wi.z) * abs(wi.z) * INV_PI;
}

// Samples wi; u.z chooses the side.
fn diffuse_sample(b: Bsdf, u: vec3<f32>) -> vec3<f32> {
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
    return select(1.0, -1.0, u < diffuse_probability(b, -1.0));
}
#else
fn diffuse_share(b: Bsdf, z: f32) -> f32 {
    return select(0.0, 1.0, z > 0.0);
}

fn diffuse_side(b: Bsdf, u: f32) -> f32 {
    return 1.0;
}
#endif

#ifdef SUBSURFACE
// Albedo of reflection plus transmission, without the Fresnel weight.
fn diffuse_albedo(b: Bsdf) -> vec3<f32> {
    return diffuse_base(b) * (1.0 - diffuse_share(b, 1.0) * b.subsurface);
}

// The part of a diffuse value that does not scatter below the surface.  At a point where light enters a body, it crosses the interface of
// the body; on all other surfaces `entry_reflectance` is 0.
fn surface_part(b: Bsdf, z: f32, value: vec3<f32>) -> vec3<f32> {
    let stays = select(vec3<f32>(1.0), 1.0 - b.subsurface, z > 0.0);
    return value * stays * (1.0 - schlick(b.entry_reflectance, abs(z)));
}

// Probability of the side of z.
fn diffuse_probability(b: Bsdf, z: f32) -> f32 {
    let above = diffuse_share(b, 1.0) * (1.0 - min(b.subsurface.x, min(b.subsurface.y, b.subsurface.z)));
    let below = diffuse_share(b, -1.0);
    return select(below, above, z > 0.0) / max(above + below, LEAST_DIVISOR);
}
#else
fn diffuse_albedo(b: Bsdf) -> vec3<f32> {
    return diffuse_base(b);
}

fn surface_part(b: Bsdf, z: f32, value: vec3<f32>) -> vec3<f32> {
    return value;
}

fn diffuse_probability(b: Bsdf, z: f32) -> f32 {
    return diffuse_share(b, z);
}
#endif
