// Counter-based random numbers on (pixel, frame, stream, dimension): no state but the counter, so that a path can be replayed and
// no two passes of a frame share a stream.  The mixer is pcg4d (Jarzynski and Olano 2020, "Hash Functions for GPU Rendering").
#define_import_path bevy_restir::common::rng

struct Rng {
    pixel: u32,      // y << 16 | x
    frame: u32,
    stream: u32,     // the pass, mixed with the user's seed: see `rng_new`
    dimension: u32,
}

// One stream a pass.
const STREAM_ALPHA: u32 = 2u;
const STREAM_REFERENCE: u32 = 3u;
const STREAM_PRESAMPLE: u32 = 4u;
const STREAM_CANDIDATES: u32 = 5u;
// And one a round, five at most.
const STREAM_REUSE: u32 = 6u;
// Numbers that paths are replayed from; and those that only choose among them.
const STREAM_PATH: u32 = 16u;
const STREAM_TREE: u32 = 17u;

fn pcg4d(seed: vec4<u32>) -> vec4<u32> {
    var v = seed * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v = v ^ (v >> vec4<u32>(16u));
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

fn rng_new(pixel: vec2<u32>, frame: u32, stream: u32, seed: u32) -> Rng {
    return Rng(pixel.y << 16u | pixel.x, frame, stream + seed * 0x9e3779b9u, 0u);
}

// Uniform in [0, 1): 24 bits, so that 1 is never reached.
fn unit_float(bits: vec4<u32>) -> vec4<f32> {
    return vec4<f32>(bits >> vec4<u32>(8u)) * 0x1p-24;
}

// Each call takes one dimension, whatever its width.
fn rng_bits(rng: ptr<function, Rng>) -> vec4<u32> {
    let bits = pcg4d(vec4<u32>((*rng).pixel, (*rng).frame, (*rng).stream, (*rng).dimension));
    (*rng).dimension += 1u;
    return bits;
}

fn rng_4(rng: ptr<function, Rng>) -> vec4<f32> {
    return unit_float(rng_bits(rng));
}

fn rng_3(rng: ptr<function, Rng>) -> vec3<f32> {
    return rng_4(rng).xyz;
}

fn rng_2(rng: ptr<function, Rng>) -> vec2<f32> {
    return rng_4(rng).xy;
}

fn rng_1(rng: ptr<function, Rng>) -> f32 {
    return rng_4(rng).x;
}
