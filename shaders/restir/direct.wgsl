// The domain of direct lighting: points of lights seen from a surface.  It answers what the routine of reuse (`pass/reuse.wgsl`) asks of
// a domain, as `restir/paths.wgsl` does.
#define_import_path bevy_restir::restir::direct

#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_pdf}
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::{is_finite_3, luminance}
#import bevy_restir::light::point_on_light::light_point_at
#import bevy_restir::light::remap::light_of_this_frame
#import bevy_restir::light::types::LightSample
#import bevy_restir::path::medium::{medium_towards, transmittance}
#import bevy_restir::path::shadow::light_is_visible
#import bevy_restir::restir::reservoir::Reservoir
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::surface::Surface
#import bevy_restir::view::primary::primary_surface

// A pixel's surface and the direction to the viewer, of this frame or the last.
struct Receiver {
    surface: Surface,
    wo: vec3<f32>,
    cone: Cone,                // what the pixel covers there
    previous: bool,
}

// A point of a light from a receiver: what it would contribute, without the visibility between them.
struct Evaluated {
    f: vec3<f32>,              // f·L·|cos| per unit of the light's measure
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
    return Evaluated(select(vec3<f32>(0.0), f, is_finite_3(f)), l);
}

// The light that arrives, whatever the surface does with it: positive wherever `evaluate_sample` is.
fn evaluate_arriving(r: Receiver, l: LightSample) -> Evaluated {
    if !(l.pdf_solid_angle > 0.0) {
        return Evaluated(vec3<f32>(0.0), l);
    }
    let f = l.radiance * abs(dot(r.surface.bsdf.n, l.wi)) / l.pdf_solid_angle;
    return Evaluated(select(vec3<f32>(0.0), f, is_finite_3(f)), l);
}

// By which samples are chosen and weighed.
fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

// Density, in the light's measure, with which the receiver's BSDF finds the point, which a ray that comes there meets with probability
// `presence`: where alpha leaves no surface it passes.
fn bsdf_pdf_of(r: Receiver, l: LightSample, presence: f32) -> f32 {
    if l.delta != 0u || !(l.pdf_solid_angle > 0.0) {
        return 0.0;
    }
    return presence * bsdf_pdf(r.surface.bsdf, r.wo, l.wi) / l.pdf_solid_angle;
}

fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return light_is_visible(r.surface, e.light, alpha_seed, r.previous);
}

// The measure of a light is the same whoever looks, and in both frames: shifts have no Jacobian, and a sample stays what it is.
fn jacobian_of(e: Evaluated) -> f32 {
    return 1.0;
}

struct Arrival {
    none: u32,
}

fn arrival_of(e: Evaluated) -> Arrival {
    return Arrival(0u);
}

fn arrived(s: Reservoir, a: Arrival) -> Reservoir {
    return s;
}

// Targets are cheap: none is kept.
fn knows_own_target() -> bool {
    return false;
}

fn own_target(s: Reservoir) -> f32 {
    return 0.0;
}

fn is_handed_on() -> bool {
    return false;
}

// A sample of the last frame in this one: a light that is gone takes it with it, but not its worth.
fn of_this_frame(s: Reservoir) -> Reservoir {
    var r = s;
    r.point.light = light_of_this_frame(s.point.light);
    r.ucw = select(s.ucw, 0.0, r.point.light == NONE);
    return r;
}
