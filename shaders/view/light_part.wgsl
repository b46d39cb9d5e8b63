// The part of a pixel's light that is shown.  Debug views (SPLIT_LIGHT) show either the light that the first surface scatters diffusely or
// all other light that it scatters.  Samples, selections and roulette do not depend on the part, so that the sum of the two parts is the
// light of the frame.
#define_import_path bevy_restir::view::light_part

#import bevy_restir::bsdf::types::{Bsdf, BsdfSample}
#ifdef SPLIT_LIGHT
#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_eval_lobe}
#import bevy_restir::bsdf::types::LOBE_DIFFUSE
#import bevy_restir::view::bindings::view
#endif

#ifdef SPLIT_LIGHT
// Equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_SPECULAR_LIGHT: u32 = 30u;

// The share of scattered light that is shown.  `diffuse`: the share that the first surface scatters diffusely.
fn shown_share(diffuse: vec3<f32>) -> vec3<f32> {
    return select(diffuse, 1.0 - diffuse, view.debug_view == DEBUG_SPECULAR_LIGHT);
}

// Light that the first surface emits, and the backdrop, belong to neither part.
fn shown_emission(light: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(0.0);
}

// Shown share of light from wi that the first surface scatters to wo, by all of its lobes.
fn shown_by_lobes(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    return shown_share(bsdf_diffuse_share(b, wo, wi));
}

// Shown share of light from the direction of a sample; no delta lobe is diffuse.
fn shown_by_sample(b: Bsdf, wo: vec3<f32>, s: BsdfSample) -> vec3<f32> {
    if s.delta != 0u {
        return shown_share(vec3<f32>(0.0));
    }
    return shown_by_lobes(b, wo, s.wi);
}

// Share of `bsdf_eval` that is diffuse.  A channel without light has none.
fn bsdf_diffuse_share(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let share = bsdf_eval_lobe(b, wo, wi, LOBE_DIFFUSE) / bsdf_eval(b, wo, wi);
    return select(vec3<f32>(0.0), min(share, vec3<f32>(1.0)), share >= vec3<f32>(0.0));
}
#else
fn shown_share(diffuse: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}

fn shown_emission(light: vec3<f32>) -> vec3<f32> {
    return light;
}

fn shown_by_lobes(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}

fn shown_by_sample(b: Bsdf, wo: vec3<f32>, s: BsdfSample) -> vec3<f32> {
    return vec3<f32>(1.0);
}
#endif
