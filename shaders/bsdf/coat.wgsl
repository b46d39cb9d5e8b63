// LOBE_COAT: what a clearcoat reflects before anything below it does (KHR_materials_clearcoat), with a normal and a roughness of its own.
// Its share of the light goes by Fresnel's at its normal, so that it is known from wo alone: not reciprocal.  World space, as the
// material's frame is not the coat's.
#define_import_path bevy_restir::bsdf::coat

#import bevy_restir::bsdf::fresnel::schlick
#import bevy_restir::bsdf::ggx::{ggx_reflection, ggx_reflection_pdf, ggx_sample}
#import bevy_restir::bsdf::types::{Bsdf, BsdfSample, LOBE_COAT, no_bsdf_sample}
#import bevy_restir::common::constants::ALPHA_DELTA
#import bevy_restir::common::math::orthonormal_basis

#ifdef CLEARCOAT
// Of varnish, index 1.5.
const COAT_AT_NORMAL: f32 = 0.04;

// Share of light that the coat keeps from what is below.
fn coat_share(b: Bsdf, wo: vec3<f32>) -> f32 {
    return b.coat * schlick(vec3<f32>(COAT_AT_NORMAL), abs(dot(wo, b.coat_normal))).x;
}

// Share that it reflects: more by what bounces between its microfacets.
fn coat_reflectance(b: Bsdf, wo: vec3<f32>) -> f32 {
    return coat_share(b, wo) * (1.0 + COAT_AT_NORMAL * b.coat_compensation);
}

// Where it reflects anything.
fn coat_is_seen(b: Bsdf, wo: vec3<f32>) -> bool {
    return b.coat > 0.0 && dot(wo, b.coat_normal) > 0.0 && dot(wo, b.n_geo) > 0.0;
}

fn coat_is_rough(b: Bsdf) -> bool {
    return b.coat > 0.0 && b.coat_roughness >= ALPHA_DELTA;
}

// f·|n.wi| of a rough coat; light that one of the coat's normal and n_geo has behind it is none.
fn coat_eval(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let frame = orthonormal_basis(b.coat_normal);
    let o = wo * frame;
    let i = wi * frame;
    if !coat_is_seen(b, wo) || !(i.z > 0.0) || !(dot(wi, b.n_geo) > 0.0) {
        return 0.0;
    }
    return coat_reflectance(b, wo) * ggx_reflection(o, i, normalize(o + i), vec2<f32>(b.coat_roughness));
}

// Solid angle, given the lobe.
fn coat_pdf(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> f32 {
    let frame = orthonormal_basis(b.coat_normal);
    let o = wo * frame;
    let i = wi * frame;
    if !coat_is_seen(b, wo) || !(i.z > 0.0) || !(dot(wi, b.n_geo) > 0.0) {
        return 0.0;
    }
    return ggx_reflection_pdf(o, normalize(o + i), vec2<f32>(b.coat_roughness));
}

// As `bsdf_draw` of a material: the lobe was chosen with probability `p`.
fn coat_draw(b: Bsdf, wo: vec3<f32>, u: vec2<f32>, p: f32) -> BsdfSample {
    let frame = orthonormal_basis(b.coat_normal);
    let o = wo * frame;
    var h = vec3<f32>(0.0, 0.0, 1.0);
    if coat_is_rough(b) {
        h = ggx_sample(o, vec2<f32>(b.coat_roughness), u);
    }
    var s = no_bsdf_sample();
    s.wi = normalize(frame * (2.0 * dot(o, h) * h - o));
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
