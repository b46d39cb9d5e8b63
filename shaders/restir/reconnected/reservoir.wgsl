// The reservoir of a light path that the camera sees and whose last edge can be reconnected.  The sample is a light sub-path up to x2, the
// vertex before the one that the camera sees, and a place in a pixel.  64 bytes.
#define_import_path bevy_restir::restir::reconnected::reservoir

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, guarded_3, is_sound}
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::path::bidirectional_mis::MisState
#import bevy_restir::restir::path_sample::{decode_barycentrics, encode_barycentrics}
#import bevy_restir::restir::stored_path::{pack_radiance, unpack_radiance}

struct Reservoir {
    path: u32,                 // index of the light sub-path in its frame, below 2^24
    frame: u32,                // frame in which it was traced first
    events: u32,               // scattering events up to the vertex that the camera sees, 2 to 64
    light: u32,                // light that emits it; the density of the sample does not contain its probability
    place: vec2<f32>,          // from the corner of a pixel, pixels
    instance: u32,             // of x2
    triangle: u32,
    barycentrics: vec2<f32>,
    towards_light: vec3<f32>,  // direction from x2 to the vertex before
    power: vec3<f32>,          // that arrives at x2, over the density of the sub-path, given the light
    state: MisState,           // of x2
    target_value: f32,         // p̂ in the pixel that stores it
    ucw: f32,                  // W: E[f(X) W] = radiance; 0: no sample
    confidence: f32,           // in frames' worth of candidates
    seen: bool,                // always true: a path that is occluded is not stored
}

// The reservoir as it is stored.
struct PackedReservoir {
    path: vec4<u32>,           // 24 bits of `path` and 8 of `events`; frame, light, W
    vertex: vec4<u32>,         // x2
    arriving: vec4<u32>,       // power, direction, place
    weights: vec4<f32>,        // state, p̂, confidence
}

// Steps of a place in a pixel.
const PLACES: f32 = 65536.0;

fn no_reservoir() -> Reservoir {
    return Reservoir(
        0u, 0u, 2u, NONE, vec2<f32>(0.0), NONE, NONE, vec2<f32>(0.0), vec3<f32>(0.0, 0.0, 1.0), vec3<f32>(0.0), MisState(0.0, 0.0), 0.0, 0.0,
        0.0, true,
    );
}

fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let place = vec2<u32>(clamp(r.place * PLACES, vec2<f32>(0.0), vec2<f32>(PLACES - 1.0)));
    let power = pack_radiance(guarded_3(r.power, GUARD_RESERVOIR));
    return PackedReservoir(
        vec4<u32>(r.path | (r.events << 24u), r.frame, r.light, bitcast<u32>(r.ucw)),
        vec4<u32>(r.instance, r.triangle, encode_barycentrics(r.barycentrics)),
        vec4<u32>(power, octahedral_encode(r.towards_light), place.x | (place.y << 16u)),
        vec4<f32>(r.state.last, r.state.earlier, r.target_value, r.confidence),
    );
}

// Reservoirs that hold the same candidate have the same identity, wherever it was shifted.
fn identity_of(p: PackedReservoir) -> vec2<u32> {
    return p.path.xy;
}

// A reservoir with a value that is negative or not finite is dropped with its confidence: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let ucw = bitcast<f32>(p.path.w);
    let w = p.weights;
    if !guard_holds(is_sound(ucw) && is_sound(w.x) && is_sound(w.y) && is_sound(w.z) && is_sound(w.w), GUARD_RESERVOIR) {
        return no_reservoir();
    }
    let place = vec2<u32>(p.arriving.w & 0xffffu, p.arriving.w >> 16u);
    return Reservoir(
        p.path.x & 0xffffffu,
        p.path.y,
        p.path.x >> 24u,
        p.path.z,
        (vec2<f32>(place) + 0.5) / PLACES,
        p.vertex.x,
        p.vertex.y,
        decode_barycentrics(p.vertex.zw),
        octahedral_decode(p.arriving.z),
        unpack_radiance(p.arriving.xy),
        MisState(w.x, w.y),
        w.z,
        ucw,
        w.w,
        true,
    );
}
