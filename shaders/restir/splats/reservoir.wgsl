// The reservoir of light that a pixel receives from light sub-paths (Hedstrom et al. 2025, 5.1: caustic reservoirs).  The sample is the
// light and the random numbers of a sub-path, and one of its vertices.  44 bytes.
#define_import_path bevy_restir::restir::splats::reservoir

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, guarded_3, is_sound}

struct Reservoir {
    path: u32,                 // index of the light sub-path in its frame, below 2^24
    frame: u32,                // frame in which it was traced first
    events: u32,               // scattering events up to the vertex, 1 to 64
    light: u32,                // light that emits it; the density of the sample does not contain its probability
    f: vec3<f32>,              // contribution to the pixel: radiance over the density of the sub-path, given the light
    ucw: f32,                  // W: E[f(X) W] = radiance; 0: no sample
    confidence: f32,           // in frames' worth of candidates
    diffuse: u32,              // `Splat::diffuse` of the vertex, as of the frame that stored it
    seen: bool,                // always true: a vertex that the camera does not see is not stored
}

// The reservoir as it is stored.
struct PackedReservoir {
    vertex: u32,               // 24 bits of `path`, 8 of `events`
    frame: u32,
    light: u32,
    ucw: f32,
    red: f32,                  // `f`
    green: f32,
    blue: f32,
    confidence: f32,
    diffuse: u32,
    // The list of samples of the last frame that land in this pixel of this frame: index plus 1 of its first reservoir and, in each
    // reservoir of a list, of the next one.
    head: u32,
    next: u32,
}

// Words of the stored reservoir, for the pass that joins lists.
const WORDS: u32 = 11u;
const WORD_FRAME: u32 = 1u;
const WORD_LIGHT: u32 = 2u;
const WORD_UCW: u32 = 3u;
const WORD_RED: u32 = 4u;
const WORD_CONFIDENCE: u32 = 7u;
const WORD_DIFFUSE: u32 = 8u;
const WORD_HEAD: u32 = 9u;
const WORD_NEXT: u32 = 10u;

fn no_reservoir() -> Reservoir {
    return Reservoir(0u, 0u, 1u, NONE, vec3<f32>(0.0), 0.0, 0.0, 0u, true);
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let f = guarded_3(r.f, GUARD_RESERVOIR);
    return PackedReservoir(r.path | (r.events << 24u), r.frame, r.light, r.ucw, f.x, f.y, f.z, r.confidence, r.diffuse, 0u, 0u);
}

// Reservoirs that hold the same candidate have the same identity, wherever it was shifted.
fn identity_of(p: PackedReservoir) -> vec2<u32> {
    return vec2<u32>(p.vertex, p.frame);
}

// A reservoir with a value that is negative or not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let f = vec3<f32>(p.red, p.green, p.blue);
    if !guard_holds(is_sound(p.ucw) && is_sound(p.confidence) && is_sound(f.x) && is_sound(f.y) && is_sound(f.z), GUARD_RESERVOIR) {
        return no_reservoir();
    }
    return Reservoir(p.vertex & 0xffffffu, p.frame, p.vertex >> 24u, p.light, f, p.ucw, p.confidence, p.diffuse, true);
}
