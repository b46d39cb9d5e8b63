// Random numbers of a path.  Each vertex has its own block of dimensions, so that replay can start at any vertex.
#define_import_path bevy_restir::path::random

#import bevy_restir::common::rng::{pcg4d, Rng, rng_3, rng_4, rng_bits, rng_of_key, STREAM_PATH, STREAM_PATH_PROBES, unit_float}
#import bevy_restir::view::bindings::view

const DIMENSIONS_PER_VERTEX: u32 = 3u;
const DIMENSION_BSDF: u32 = 0u;          // direction and lobe
const DIMENSION_RAY: u32 = 1u;           // alpha tests of the ray to the next vertex
const DIMENSION_SHADOW_RAY: u32 = 2u;    // alpha tests of the shadow ray of NEE

// Seed of this frame's paths of a pixel.
fn path_seed(pixel: vec2<u32>) -> u32 {
    return pcg4d(vec4<u32>(pixel, view.frame, STREAM_PATH)).x;
}

fn path_rng(seed: u32, vertex: u32, dimension: u32) -> Rng {
    var rng = rng_of_key(seed, 0u, STREAM_PATH, view.seed);
    rng.dimension = vertex * DIMENSIONS_PER_VERTEX + dimension;
    return rng;
}

fn path_random(seed: u32, vertex: u32) -> vec3<f32> {
    var rng = path_rng(seed, vertex, DIMENSION_BSDF);
    return rng_3(&rng);
}

fn path_alpha_seed(seed: u32, vertex: u32, dimension: u32) -> u32 {
    var rng = path_rng(seed, vertex, dimension);
    return rng_bits(&rng).x;
}

const PROBE_DIMENSIONS_PER_VERTEX: u32 = 2u;

// Random numbers of the probe at a vertex.
struct ProbeNumbers {
    choice: f32,               // between the surface and the body below it
    alpha_seed: u32,
    probe: vec4<f32>,
}

fn path_probe_numbers(seed: u32, vertex: u32) -> ProbeNumbers {
    var rng = rng_of_key(seed, 0u, STREAM_PATH_PROBES, view.seed);
    rng.dimension = vertex * PROBE_DIMENSIONS_PER_VERTEX;
    let bits = rng_bits(&rng);
    return ProbeNumbers(unit_float(bits).x, bits.y, rng_4(&rng));
}
