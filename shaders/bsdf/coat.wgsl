// LOBE_COAT: the reflection of a clearcoat over the base (KHR_materials_clearcoat), with its own normal and roughness.  The Fresnel term
// is evaluated at the coat's normal, so that it depends on wo alone; the lobe is not reciprocal.  Directions are in world space, because
// the base and the coat have different local frames.
#define_import_path bevy_restir::bsdf::coat

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::ggx::{ggx_reflection, ggx_reflection_pdf, ggx_sample}
#import bevy_restir::bsdf::types::{Bsdf, BsdfSample, LOBE_COAT, no_bsdf_sample}
#import bevy_restir::common::constants::ALPHA_DELTA
#import bevy_restir::common::guard::{GUARD_BSDF_SAMPLE, guard_holds}
#import bevy_restir::common::math::{is_finite_3, orthonormal_basis}

#ifdef CLEARCOAT
// Reflectance at normal incidence of varnish, index of refraction 1.5.
const COAT_F0: f32 = 0.04;

// Share of light that the coat reflects, and that the base does not receive.
fn coat_share(b: Bsdf, wo: vec3<f32>) -> f32 {
    return b.coat * schlick(vec3<f32>(COAT_F0), abs(dot(wo, b.coat_normal))).x;
}

// Share of light that the coat reflects with energy compensation.  Multiple scattering adds to the reflection and takes nothing from the
// base.
fn coat_reflectance(b: Bsdf, wo: vec3<f32>) -> f32 {
    return coat_share(b, wo) * (1.0 + COAT_F0 * b.coat_compensation);
}

// Whether the coat reflects light to wo.
fn coat_reflects(b: Bsdf, wo: vec3<f32>) -> bool {
    return b.coat > 0.0 && dot(wo, b.coat_normal) > 0.0 && dot(wo, b.n_geo) > 0.0;
}

fn coat_is_rough(b: Bsdf) -> bool {
    return b.coat > 0.0 && b.coat_roughness >= ALPHA_DELTA;
}

// Whether a rough coat scatters light from wi, which is i in the frame of the coat, to wo.
fn coat_scatters(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>, i: vec3<f32>) -> bool {
    return coat_reflects(b, wo) && i.z > 0.0 && dot(wi, b.n_geo) > 0.0;
}

// f·|n·wi| of a rough coat; 0 unless wi is above the coat's normal and n_geo.
fn coat_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let frame = orthonormal_basis(b.coat_normal);
    let o = wo * frame;
    let i = wi * frame;
    if !coat_scatters(b, wo, wi, i) {
        return 0.0;
    }
    return coat_reflectance(b, wo) * ggx_reflection(o, i, normalize(o + i), vec2<f32>(b.coat_roughness));
}

// Density of wi, solid angle, given the lobe.
fn coat_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let frame = orthonormal_basis(b.coat_normal);
    let o = wo * frame;
    let i = wi * frame;
    if !coat_scatters(b, wo, wi, i) {
        return 0.0;
    }
    return ggx_reflection_pdf(o, normalize(o + i), vec2<f32>(b.coat_roughness));
}

// `bsdf_draw` of this lobe, which was chosen with probability `p`.
fn coat_draw(b: Bsdf, wo: vec3<f32>, u: vec2<f32>, p: f32) -> BsdfSample {
    let frame = orthonormal_basis(b.coat_normal);
    let o = wo * frame;
    var h = vec3<f32>(0.0, 0.0, 1.0);
    if coat_is_rough(b) {
        h = ggx_sample(o, vec2<f32>(b.coat_roughness), u);
    }
    var s = no_bsdf_sample();
    s.wi = normalize(frame * (2.0 * dot(o, h) * h - o));
    _ = guard_holds(is_finite_3(s.wi), GUARD_BSDF_SAMPLE);
    s.lobe = LOBE_COAT;
    s.delta = u32(!coat_is_rough(b));
    s.valid = u32(dot(s.wi, b.coat_normal) > 0.0 && dot(s.wi, b.n_geo) > 0.0);
    s.weight = vec3<f32>(select(0.0, coat_reflectance(b, wo) / p, s.delta != 0u));
    return s;
}

fn coat_is_chosen(u: f32, p: f32) -> bool {
    return u < p;
}
#else
fn coat_share(b: Bsdf, wo: vec3<f32>) -> f32 {
    return 0.0;
}

fn coat_is_rough(b: Bsdf) -> bool {
    return false;
}

fn coat_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return 0.0;
}

fn coat_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    return 0.0;
}

fn coat_draw(b: Bsdf, wo: vec3<f32>, u: vec2<f32>, p: f32) -> BsdfSample {
    return no_bsdf_sample();
}

fn coat_is_chosen(u: f32, p: f32) -> bool {
    return false;
}
#endif
