// Counter-based random numbers: pcg4d of (key, frame, stream, dimension) (Jarzynski and Olano 2020, "Hash Functions for GPU
// Rendering").  There is no state but the counter, so that a path can be replayed, and each pass has a stream of its own.
#define_import_path bevy_restir::common::rng

struct Rng {
    key: u32,        // y << 16 | x of a pixel; for paths and light sub-paths, their seed or index
    frame: u32,
    stream: u32,     // STREAM_*, `seeded`
    dimension: u32,  // of the next number
}

// Streams: no two uses share numbers.  Each has streams of its own, except that the uses of STREAM_SPLATS differ in dimensions.
const STREAM_ALPHA: u32 = 2u;
const STREAM_REFERENCE: u32 = 3u;
const STREAM_PRESAMPLE: u32 = 4u;
const STREAM_DI_CANDIDATES: u32 = 5u;
// Stream of the first iteration of reuse in the first domain of a technique; the next iterations, at most four, use the next streams.
const STREAM_REUSE: u32 = 6u;
// Distance between the streams of reuse of one domain and those of the next one: more than all other streams.
const STREAMS_PER_DOMAIN: u32 = 32u;
// Numbers that generate paths, and replay them.
const STREAM_PATH: u32 = 16u;
// Numbers that select among the paths of a pixel.
const STREAM_PATH_CANDIDATES: u32 = 17u;
// Light sub-paths.
const STREAM_LIGHT_PATHS: u32 = 18u;
// Probes through bodies, and the lights of their hits.
const STREAM_SSS_CANDIDATES: u32 = 19u;
// Choices among the vertices of light sub-paths, and among splats.
const STREAM_SPLATS: u32 = 21u;
// Probes of paths, and whether a path takes one.
const STREAM_PATH_PROBES: u32 = 22u;
// Pairs of the first iteration of reuse in the first domain of a technique; others are as far apart as those of STREAM_REUSE.
const STREAM_PAIRS: u32 = 23u;

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

// A stream, mixed with the user's seed.
fn seeded(stream: u32, seed: u32) -> u32 {
    return stream + seed * 0x9e3779b9u;
}

// The numbers of a pixel in a frame.
fn rng_new(pixel: vec2<u32>, frame: u32, stream: u32, seed: u32) -> Rng {
    return rng_of_key((pixel.y << 16u) | pixel.x, frame, stream, seed);
}

// The numbers of anything that has a number of its own: a path, a light sub-path, a reservoir.
fn rng_of_key(key: u32, frame: u32, stream: u32, seed: u32) -> Rng {
    return Rng(key, frame, seeded(stream, seed), 0u);
}

// Uniform in [0, 1), 24 bits.
fn unit_float(bits: vec4<u32>) -> vec4<f32> {
    return vec4<f32>(bits >> vec4<u32>(8u)) * 0x1p-24;
}

// Each call uses one dimension, however many components it returns.
fn rng_bits(rng: ptr<function, Rng>) -> vec4<u32> {
    let bits = pcg4d(vec4<u32>((*rng).key, (*rng).frame, (*rng).stream, (*rng).dimension));
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
