// What a pixel of direct lighting keeps: a point of a light, its unbiased contribution weight, how much it is worth, and whether it
// was seen.  16 bytes.
#define_import_path bevy_restir::restir::reservoir

#import bevy_restir::common::math::is_finite
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}
#import bevy_restir::restir::types::{TILING_COLUMNS, TILING_ROWS}

struct Reservoir {
    point: LightPoint,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the light; 0: nothing was found
    confidence: f32,       // candidates' worth that it stands for
    seen: bool,            // when it was shaded
}

const UNSEEN: u32 = 0x80000000u;

fn no_reservoir() -> Reservoir {
    return Reservoir(no_light_point(), 0.0, 0.0, false);
}

// Confidence is never negative: its sign bit says whether the sample was seen.
fn reservoir_pack(r: Reservoir) -> vec4<u32> {
    let unseen = select(UNSEEN, 0u, r.seen);
    return vec4<u32>(r.point.light, r.point.coordinates, bitcast<u32>(r.ucw), bitcast<u32>(abs(r.confidence)) | unseen);
}

// A number that is not finite must not spread over the screen (trap T23).
fn reservoir_unpack(words: vec4<u32>) -> Reservoir {
    let ucw = bitcast<f32>(words.z);
    let confidence = bitcast<f32>(words.w & ~UNSEEN);
    if !is_finite(ucw) || !is_finite(confidence) || !(ucw >= 0.0) {
        return no_reservoir();
    }
    return Reservoir(LightPoint(words.x, words.y), ucw, confidence, (words.w & UNSEEN) == 0u);
}

// Where a pixel's reservoir lies: by rows, by columns, or by square tiles with rows within (paper 002, 4.5.3).
fn reservoir_index(pixel: vec2<u32>, size: vec2<u32>, tiling: u32) -> u32 {
    if tiling == TILING_ROWS {
        return pixel.y * size.x + pixel.x;
    }
    if tiling == TILING_COLUMNS {
        return pixel.x * size.y + pixel.y;
    }
    let tile = pixel / tiling;
    let within = pixel % tiling;
    let across = (size.x + tiling - 1u) / tiling;
    return ((tile.y * across + tile.x) * tiling + within.y) * tiling + within.x;
}
