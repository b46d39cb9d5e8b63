// The random numbers of a path: a block of dimensions for every vertex, so that a path is replayed from any of them.
#define_import_path bevy_restir::path::random

#import bevy_restir::common::rng::{pcg4d, Rng, rng_3, rng_bits, rng_new, STREAM_PATH}
#import bevy_restir::view::bindings::view

const DIMENSIONS: u32 = 3u;
const OF_BSDF: u32 = 0u;          // direction and lobe
const OF_RAY: u32 = 1u;           // which blended surfaces the ray to the next vertex meets
const OF_LIGHT_RAY: u32 = 2u;     // and the ray to a light

// Of this frame's paths of a pixel: 32 bits of its own.
fn path_seed(pixel: vec2<u32>) -> u32 {
    return pcg4d(vec4<u32>(pixel, view.frame, STREAM_PATH)).x;
}

fn path_rng(seed: u32, vertex: u32, dimension: u32) -> Rng {
    var rng = rng_new(vec2<u32>(seed & 0xffffu, seed >> 16u), 0u, STREAM_PATH, view.seed);
    rng.dimension = vertex * DIMENSIONS + dimension;
    return rng;
}

fn path_random(seed: u32, vertex: u32) -> vec3<f32> {
    var rng = path_rng(seed, vertex, OF_BSDF);
    return rng_3(&rng);
}

fn path_alpha_seed(seed: u32, vertex: u32, dimension: u32) -> u32 {
    var rng = path_rng(seed, vertex, dimension);
    return rng_bits(&rng).x;
}
