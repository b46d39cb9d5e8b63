// Colors for debug views.
#define_import_path bevy_restir::view::false_color

#import bevy_restir::common::rng::{pcg4d, unit_float}

// A pseudorandom color for each pair of ids.
fn false_color(ids: vec2<u32>) -> vec3<f32> {
    return unit_float(pcg4d(vec4<u32>(ids, 17u, 42u))).xyz;
}
