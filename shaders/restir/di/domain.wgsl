// ReSTIR DI: the domain of points of lights, seen from a surface (Wyman and Panteleev 2021).  It defines the functions that the
// resampling routine (`pass/reuse.wgsl`) calls.
#define_import_path bevy_restir::restir::di::domain

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_pdf}
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_LIGHT_CONTRIBUTION, guarded_3}
#import bevy_restir::common::math::luminance
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::light::remap::current_light_id
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::medium::{medium_towards, transmittance}
#import bevy_restir::path::shadow_ray::light_is_visible
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::di::reservoir::Reservoir
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::surface::Surface
#import bevy_restir::view::primary::primary_surface
#ifdef SPLIT_LIGHT
#import bevy_restir::view::light_part::bsdf_diffuse_share
#endif

// A pixel's surface, in this frame or the last.
struct Receiver {
    surface: Surface,
    wo: vec3<f32>,
    cone: Cone,                // footprint of the pixel
    previous: bool,
}

// A point of a light, seen from a receiver.
struct Evaluated {
    f: vec3<f32>,              // f·L·|cos| in the measure of the light, without visibility
    light: LightSample,
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    let s = primary_surface(ids, pixel, previous);
    return Receiver(s.surface, s.wo, s.cone, previous);
}

fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    return evaluate_sample(r, light_point_at(s.point, r.surface.position, r.previous));
}

fn evaluate_sample(r: Receiver, l: LightSample) -> Evaluated {
    if !(l.pdf_solid_angle > 0.0) {
        return Evaluated(vec3<f32>(0.0), l);
    }
    let carried = transmittance(medium_towards(r.surface, l.wi, vec3<f32>(0.0)), l.distance);
    let f = bsdf_eval(r.surface.bsdf, r.wo, l.wi) * l.radiance * carried / l.pdf_solid_angle;
    return Evaluated(guarded_3(f, GUARD_LIGHT_CONTRIBUTION), l);
}

// Arriving light without the BSDF: positive wherever `evaluate_sample` is.
fn evaluate_arriving(r: Receiver, l: LightSample) -> Evaluated {
    if !(l.pdf_solid_angle > 0.0) {
        return Evaluated(vec3<f32>(0.0), l);
    }
    let f = l.radiance * abs(dot(r.surface.bsdf.n, l.wi)) / l.pdf_solid_angle;
    return Evaluated(guarded_3(f, GUARD_LIGHT_CONTRIBUTION), l);
}

// Share of a sample's light that the receiver scatters diffusely.
#ifdef SPLIT_LIGHT
fn diffuse_share(r: Receiver, s: Reservoir, packed_splat_share: f32) -> vec3<f32> {
    return bsdf_diffuse_share(r.surface.bsdf, r.wo, light_point_at(s.point, r.surface.position, false).wi);
}
#endif

// p̂: the resampling routine selects by it.
fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

// Density, in the measure of the light, with which the receiver's BSDF samples the point.  A ray that reaches a point of a surface with
// alpha is stopped there with the probability `opacity`.
fn bsdf_pdf_of(r: Receiver, l: LightSample, opacity: f32) -> f32 {
    if l.delta != 0u || !(l.pdf_solid_angle > 0.0) {
        return 0.0;
    }
    return opacity * bsdf_pdf(r.surface.bsdf, r.wo, l.wi) / l.pdf_solid_angle;
}

fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return light_is_visible(r.surface, e.light, alpha_seed, r.previous);
}

// The measure of a light is the same for all receivers and in both frames: a shift has no Jacobian and changes nothing.
fn jacobian_of(e: Evaluated) -> f32 {
    return 1.0;
}

fn can_be_shifted(s: Reservoir) -> bool {
    return true;
}

// Sample fields that a shift changes: none, but WGSL has no empty struct.
struct ShiftResult {
    unused: u32,
}

fn shift_result_of(e: Evaluated) -> ShiftResult {
    return ShiftResult(0u);
}

fn apply_shift(s: Reservoir, a: ShiftResult) -> Reservoir {
    return s;
}

// The reservoir does not store p̂.
fn stores_target() -> bool {
    return false;
}

fn stored_target(s: Reservoir) -> f32 {
    return 0.0;
}

// A shift draws no vertex again.
fn needs_replay(r: Receiver, s: Reservoir) -> bool {
    return false;
}

// Paired reuse keeps the contribution of a visible sample (`kept_shift`), and restores the shift from it (`shift_from`).
fn kept_shift(e: Evaluated) -> vec4<f32> {
    return vec4<f32>(e.f, 0.0);
}

fn shift_from(s: Reservoir, kept: vec4<f32>) -> Evaluated {
    var e: Evaluated;
    e.f = kept.rgb;
    return e;
}

// Whether a pixel resamples; the reservoirs of others stay empty.
fn resamples(r: Receiver) -> bool {
    return true;
}

// Radius of the disk that neighbors are in, pixels.
fn neighbor_radius(r: Receiver) -> f32 {
    return settings.radius;
}

// The sample that a pixel stores.
fn completed(r: Receiver, s: Reservoir, bits: u32) -> Reservoir {
    return s;
}

// A sample of the last frame, with the light ids of this frame.  A light that was removed has the weight 0 and keeps its confidence.
fn in_current_frame(s: Reservoir) -> Reservoir {
    var r = s;
    r.point.light = current_light_id(s.point.light);
    r.ucw = select(s.ucw, 0.0, r.point.light == NONE);
    return r;
}
