// Light sub-paths of ReSTIR BDPT.  Their random numbers depend on their index and on the frame alone, so that each of them can be replayed.
// The MIS state of a vertex includes the factors of `LightShares`.
#define_import_path bevy_restir::restir::connection::light_sub_path

#import bevy_restir::common::rng::{Rng, rng_bits, rng_of_key, STREAM_LIGHT_PATHS}
#import bevy_restir::path::bidirectional_mis::MisState
#import bevy_restir::path::light_path::{advance_light_path, begin_light_path, LightWalk}
#import bevy_restir::restir::connection::count::connections_of_vertex
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view

fn sub_path_rng(path: u32, frame: u32, stream: u32) -> Rng {
    return rng_of_key(path, frame, stream, view.seed);
}

// The newest vertex of a sub-path.
struct SubPath {
    walk: LightWalk,
    alpha_seed: u32,           // for the shadow ray to the camera
}

// The first vertex of a sub-path from a light, now or (`previous`) in the last frame.
fn begin_sub_path(light: u32, rng: ptr<function, Rng>, previous: bool) -> SubPath {
    var w = begin_light_path(light, rng, previous);
    w.state = over_share(w.state, settings.nee_share);
    return SubPath(w, rng_bits(rng).x);
}

fn continue_sub_path(walk: LightWalk, rng: ptr<function, Rng>, previous: bool) -> SubPath {
    var w = advance_light_path(walk, rng, previous);
    if walk.events == 1u && w.by_delta {
        w.state = over_share(w.state, settings.caustic_share / settings.nee_share);
    }
    w.state.last *= connections_of_vertex();
    return SubPath(w, rng_bits(rng).x);
}

// Random numbers that `begin_sub_path` and `continue_sub_path` take.
const NUMBERS_OF_EVENT: u32 = 4u;
// Number of those of an event before the alpha seed of its ray, and before that of the ray to the camera.
const ALPHA_NUMBER: u32 = 1u;
const CAMERA_ALPHA_NUMBER: u32 = 3u;

// Random numbers from this event of a sub-path on; events are counted from 1.
fn event_rng(path: u32, frame: u32, event: u32) -> Rng {
    var rng = sub_path_rng(path, frame, STREAM_LIGHT_PATHS);
    rng.dimension = NUMBERS_OF_EVENT * (event - 1u);
    return rng;
}

// Alpha seeds of the ray that arrives at the vertex of an event, from the second on, and of the shadow ray from there to the camera.
fn alpha_seeds_of(path: u32, frame: u32, event: u32) -> vec2<u32> {
    var rng = event_rng(path, frame, event);
    rng.dimension += ALPHA_NUMBER;
    let arriving = rng_bits(&rng).x;
    rng.dimension += CAMERA_ALPHA_NUMBER - ALPHA_NUMBER - 1u;
    return vec2<u32>(arriving, rng_bits(&rng).x);
}

// A sub-path that is replayed from its light up to the vertex with this number of scattering events; it may end before.
fn replayed_sub_path(path: u32, frame: u32, light: u32, events: u32, previous: bool) -> SubPath {
    var rng = sub_path_rng(path, frame, STREAM_LIGHT_PATHS);
    var p = begin_sub_path(light, &rng, previous);
    for (var event = 1u; event < events && p.walk.events > 0u; event++) {
        p = continue_sub_path(p.walk, &rng, previous);
    }
    return p;
}

// The state holds ratios of the densities of other techniques to that of the light sub-path.  MIS weights multiply the latter by this share
// (`LightShares`), so that the ratios are divided by it.
fn over_share(s: MisState, share: f32) -> MisState {
    return MisState(s.last / share, s.earlier / share);
}
