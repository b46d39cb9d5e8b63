// What a pixel of direct lighting keeps: a point of a light, its unbiased contribution weight, and how much it is worth.  16 bytes.
#define_import_path bevy_restir::restir::reservoir

#import bevy_restir::common::math::is_finite
#import bevy_restir::light::point_on_light::{LightPoint, no_light_point}

struct Reservoir {
    point: LightPoint,
    ucw: f32,              // W: E[f(X) W] = ∫ f, in the measure of the light; 0: nothing was found
    confidence: f32,       // candidates' worth that it stands for
}

fn no_reservoir() -> Reservoir {
    return Reservoir(no_light_point(), 0.0, 0.0);
}

fn reservoir_pack(r: Reservoir) -> vec4<u32> {
    return vec4<u32>(r.point.light, r.point.coordinates, bitcast<u32>(r.ucw), bitcast<u32>(r.confidence));
}

// A number that is not finite must not spread over the screen (trap T23).
fn reservoir_unpack(words: vec4<u32>) -> Reservoir {
    let ucw = bitcast<f32>(words.z);
    let confidence = bitcast<f32>(words.w);
    if !is_finite(ucw) || !is_finite(confidence) || !(ucw >= 0.0) || !(confidence >= 0.0) {
        return no_reservoir();
    }
    return Reservoir(LightPoint(words.x, words.y), ucw, confidence);
}
