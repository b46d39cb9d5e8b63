// The part of a pixel's light that is shown.  With SPLIT_LIGHT the light that the first surface scatters diffusely is known: debug views show
// it, or all other light that it scatters, and the denoiser gets the luminance of the diffuse part beside the light.  Samples, selections and
// roulette do not depend on the part, so that the sum of the two parts is the light of the frame.
#define_import_path bevy_restir::view::light_part

#import bevy_restir::bsdf::types::{Bsdf, BsdfSample}
#ifdef SPLIT_LIGHT
#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_eval_lobe}
#import bevy_restir::bsdf::types::LOBE_DIFFUSE
#import bevy_restir::common::math::luminance
#import bevy_restir::view::bindings::view
#endif

#ifdef SPLIT_LIGHT
const SPLITS_LIGHT: bool = true;
// A test holds them equal to the order of `DebugView` in src/settings/debug_view.rs.
const DEBUG_DIFFUSE_LIGHT: u32 = 29u;
const DEBUG_SPECULAR_LIGHT: u32 = 30u;

// The light that is shown, and the luminance of its diffuse part.  `diffuse`: the share that the first surface scatters diffusely.
fn shown_light(light: vec3<f32>, diffuse: vec3<f32>) -> vec4<f32> {
    return vec4<f32>(light * shown_share(diffuse), luminance(light * diffuse));
}

// The share of scattered light that is shown.
fn shown_share(diffuse: vec3<f32>) -> vec3<f32> {
    let part = select(diffuse, 1.0 - diffuse, view.debug_view == DEBUG_SPECULAR_LIGHT);
    return select(vec3<f32>(1.0), part, shows_part());
}

fn shows_part() -> bool {
    return view.debug_view == DEBUG_DIFFUSE_LIGHT || view.debug_view == DEBUG_SPECULAR_LIGHT;
}

// Light that the first surface emits, and the backdrop, belong to neither part.
fn shown_emission(light: vec3<f32>) -> vec3<f32> {
    return select(light, vec3<f32>(0.0), shows_part());
}

// Diffuse share of light from the direction of a sample; no delta lobe is diffuse.
fn sample_diffuse_share(b: Bsdf, wo: vec3<f32>, s: BsdfSample) -> vec3<f32> {
    if s.delta != 0u {
        return vec3<f32>(0.0);
    }
    return bsdf_diffuse_share(b, wo, s.wi);
}

// Diffuse share of light from wi that a surface scatters to wo by all of its lobes.  A channel without light has none.
fn bsdf_diffuse_share(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    let total = bsdf_eval(b, wo, wi);
    let share = bsdf_eval_lobe(b, wo, wi, LOBE_DIFFUSE) / total;
    return select(vec3<f32>(0.0), min(share, vec3<f32>(1.0)), total > vec3<f32>(0.0));
}
#else
const SPLITS_LIGHT: bool = false;

fn shown_light(light: vec3<f32>, diffuse: vec3<f32>) -> vec4<f32> {
    return vec4<f32>(light, 0.0);
}

fn shown_share(diffuse: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}

fn shown_emission(light: vec3<f32>) -> vec3<f32> {
    return light;
}

// Without SPLIT_LIGHT no pass reads the share.
fn sample_diffuse_share(b: Bsdf, wo: vec3<f32>, s: BsdfSample) -> vec3<f32> {
    return vec3<f32>(0.0);
}

fn bsdf_diffuse_share(b: Bsdf, wo: vec3<f32>, wi: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(0.0);
}
#endif

// Three shares from 0 to 1 in a channel of a texture: 10 bits each, exact to 0.0005, and exact for 0 and 1.  In the exponent of the float, bit
// 30 is always set and bit 23 never: it is then neither subnormal nor NaN, which textures do not keep.
fn pack_share(share: vec3<f32>) -> f32 {
    let v = vec3<u32>(clamp(share, vec3<f32>(0.0), vec3<f32>(1.0)) * 1023.0 + 0.5);
    let bits = v.x | (v.y << 10u) | (v.z << 20u);
    return bitcast<f32>((bits & 0x7fffffu) | (((bits >> 23u) & 63u) << 24u) | 0x40000000u | ((bits >> 29u) << 31u));
}

fn unpack_share(word: f32) -> vec3<f32> {
    let w = bitcast<u32>(word);
    let bits = (w & 0x7fffffu) | (((w >> 24u) & 63u) << 23u) | ((w >> 31u) << 29u);
    return vec3<f32>(vec3<u32>(bits, bits >> 10u, bits >> 20u) & vec3<u32>(1023u)) / 1023.0;
}
