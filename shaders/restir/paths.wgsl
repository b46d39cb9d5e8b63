// The domain of whole paths: what the routine of reuse asks of it (`pass/reuse.wgsl`) is answered by the hybrid shift.
#define_import_path bevy_restir::restir::paths

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::light::remap::light_of_this_frame
#import bevy_restir::path::sample::{Arrival, arrived_path, END_LIGHT, PathSample}
#import bevy_restir::path::tree::Chosen
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::kept_path::Reservoir
#import bevy_restir::restir::types::{RESAMPLE_MOVED, RESAMPLE_TRACE_BACK, RESAMPLE_TRACE_FORTH}
#import bevy_restir::shift::connect::{Connection, connection_of}
#import bevy_restir::shift::hybrid::{hybrid_shift, is_free, Shifted}
#import bevy_restir::view::camera::camera_position
#import bevy_restir::view::primary::primary_surface

// A pixel's surface, of this frame or the last, and where its paths may be reconnected.
struct Receiver {
    first: Vertex,
    connection: Connection,
    previous: bool,
}

// A path at a receiver: what it carries there, and how it came there.
struct Evaluated {
    f: vec3<f32>,              // if nothing stands in its way
    shifted: Shifted,
}

fn receiver_of(ids: vec2<u32>, pixel: vec2<u32>, previous: bool) -> Receiver {
    let s = primary_surface(ids, pixel, previous);
    return Receiver(Vertex(s.surface, s.wo, vec3<f32>(0.0), s.cone), connection_of(camera_position(previous), s.surface), previous);
}

// A candidate in the measure of this domain.
fn measured(c: Chosen, r: Receiver) -> Chosen {
    return c;
}

// Where something moved between the frames, what follows the reconnection is traced again: in this one, or in the last.
fn shifted_to(r: Receiver, path: PathSample) -> Shifted {
    let asked = select(RESAMPLE_TRACE_FORTH, RESAMPLE_TRACE_BACK, r.previous);
    let traces = (settings.flags & RESAMPLE_MOVED) != 0u && (settings.flags & asked) != 0u;
    return hybrid_shift(path, r.first, r.connection, r.previous, traces);
}

fn evaluate(r: Receiver, s: Reservoir) -> Evaluated {
    let shifted = shifted_to(r, s.path);
    return Evaluated(shifted.f, shifted);
}

fn target_value(e: Evaluated) -> f32 {
    return luminance(e.f);
}

fn jacobian_of(e: Evaluated) -> f32 {
    return e.shifted.jacobian;
}

fn arrival_of(e: Evaluated) -> Arrival {
    return e.shifted.arrival;
}

fn arrived(s: Reservoir, a: Arrival) -> Reservoir {
    return Reservoir(arrived_path(s.path, a), s.ucw, s.confidence, s.seen);
}

// A path that does not change carries what it carried.
fn knows_own_target() -> bool {
    return (settings.flags & RESAMPLE_MOVED) == 0u;
}

fn own_target(s: Reservoir) -> f32 {
    return s.path.target_value;
}

// The pixel's own path needs no shift: what it carries is handed on.
fn is_handed_on() -> bool {
    return true;
}

// Blended surfaces let it see by the path's own chances, whoever looks.
fn is_visible(r: Receiver, e: Evaluated, alpha_seed: u32) -> bool {
    return is_free(e.shifted, r.previous);
}

// A path of the last frame in this one: a light that is gone takes it with it, but not its worth.
fn of_this_frame(s: Reservoir) -> Reservoir {
    let path = path_of_this_frame(s.path);
    return Reservoir(path, select(0.0, s.ucw, path.length > 0u), s.confidence, s.seen);
}

fn path_of_this_frame(path: PathSample) -> PathSample {
    var p = path;
    if path.end == END_LIGHT || path.light.light != NONE {
        p.light.light = light_of_this_frame(path.light.light);
        p.length = select(path.length, 0u, p.light.light == NONE);
    }
    return p;
}
