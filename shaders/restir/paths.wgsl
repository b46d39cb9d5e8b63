// The domain of whole paths: what the routine of reuse asks of it (`pass/reuse.wgsl`) is answered by the hybrid shift.
#define_import_path bevy_restir::restir::paths

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::light::remap::light_of_this_frame
#import bevy_restir::path::sample::END_LIGHT
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::path_reservoir::Reservoir
#import bevy_restir::restir::types::{RESAMPLE_MOVED, RESAMPLE_TRACE_BACK, RESAMPLE_TRACE_FORTH}
#import bevy_restir::shift::connect::{Connection, connection_of}
#import bevy_restir::shift::hybrid::{hybrid_shift, Shifted}
#import bevy_restir::view::camera::camera_position
#import bevy_restir::view::primary::primary_surface

// A pixel's surface, of this frame or the last, and where its paths may be reconnected.
struct Receiver {
    first: Vertex,
    connection: Connection,
    previous: bool,
}

// A path at a receiver: what it carries there, seen or nothing, and how it came there.
struct Evaluated {
    f: vec3<f32>,
    shifted: Shifted,
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    let s = primary_surface(ids, pixel, previous);
    return Receiver(Vertex(s.surface, s.wo, vec3<f32>(0.0)), connection_of(camera_position(previous), s.surface), previous);
}

// Where something moved between the frames, what follows the reconnection is traced again: in this one, or in the last.
fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    let asked = select(RESAMPLE_TRACE_FORTH, RESAMPLE_TRACE_BACK, r.previous);
    let traces = (settings.flags & RESAMPLE_MOVED) != 0u && (settings.flags & asked) != 0u;
    let shifted = hybrid_shift(s.path, r.first, r.connection, r.previous, traces);
    return Evaluated(shifted.f, shifted);
}

fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

fn jacobian_of(e: Evaluated) -> f32 {
    return e.shifted.jacobian;
}

// The sample as it is where it came to, its weight in the measure there.
fn arrived(s: Reservoir, e: Evaluated) -> Reservoir {
    var r = s;
    r.path = e.shifted.path;
    r.path.target_value = target_value(e);
    r.ucw = s.ucw * jacobian_of(e);
    return r;
}

// A path that does not change carries what it carried.
fn knows_own_target() -> bool {
    return (settings.flags & RESAMPLE_MOVED) == 0u;
}

fn own_target(s: Reservoir) -> f32 {
    return s.path.target_value;
}

// The pixel's own path needs no shift.
fn is_handed_on() -> bool {
    return true;
}

// A shift has looked.
fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return true;
}

// A path of the last frame in this one: a light that is gone takes it with it, but not its worth.
fn of_this_frame(s: Reservoir) -> Reservoir {
    var r = s;
    if s.path.end == END_LIGHT {
        r.path.light.light = light_of_this_frame(s.path.light.light);
        r.ucw = select(s.ucw, 0.0, r.path.light.light == NONE);
    }
    return r;
}
