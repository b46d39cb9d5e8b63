// The reservoir of ReSTIR DI: a point of a light, its unbiased contribution weight, its confidence, and its visibility.  16 bytes.
#define_import_path bevy_restir::restir::di::reservoir

#import bevy_restir::common::guard::{GUARD_RESERVOIR, guard_holds, is_sound}
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}

struct Reservoir {
    point: LightPoint,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the light; 0: no sample
    confidence: f32,       // in frames' worth of candidates
    seen: bool,            // the sample was visible when it was shaded
}

// The reservoir as it is stored.
struct PackedReservoir {
    words: vec4<u32>,
}

const UNSEEN: u32 = 0x80000000u;

fn no_reservoir() -> Reservoir {
    return Reservoir(no_light_point(), 0.0, 0.0, false);
}

// Confidence is never negative: its sign bit stores the visibility.
fn reservoir_pack(r: Reservoir) -> PackedReservoir {
    let unseen = select(UNSEEN, 0u, r.seen);
    let confidence = select(0.0, r.confidence, guard_holds(is_sound(r.confidence), GUARD_RESERVOIR));
    return PackedReservoir(vec4<u32>(r.point.light, r.point.coordinates, bitcast<u32>(r.ucw), bitcast<u32>(confidence) | unseen));
}

// Reservoirs that hold the same candidate have the same identity, wherever it was shifted.
fn identity_of(p: PackedReservoir) -> vec2<u32> {
    return p.words.xy;
}

// A reservoir with a value that is negative or not finite is dropped, so that it cannot spread over the screen.  Its confidence is dropped,
// too: kept confidence would make the picture dark.
fn reservoir_unpack(p: PackedReservoir) -> Reservoir {
    let words = p.words;
    let ucw = bitcast<f32>(words.z);
    let confidence = bitcast<f32>(words.w & ~UNSEEN);
    if !guard_holds(is_sound(ucw) && is_sound(confidence), GUARD_RESERVOIR) {
        return no_reservoir();
    }
    return Reservoir(LightPoint(words.x, words.y), ucw, confidence, (words.w & UNSEEN) == 0u);
}
