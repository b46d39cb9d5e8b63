// Random numbers of a block of counters: id = dimension | x << 2 | y << 8 | frame << 14 | stream << 16.
#import bevy_restir::common::rng::{rng_bits, rng_new, unit_float}

struct Out {
    bits: vec4<u32>,
    unit: vec4<f32>,
}

@group(0) @binding(0) var<storage, read> seed: array<u32>;
@group(0) @binding(1) var<storage, read_write> samples: array<Out>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    var rng = rng_new(vec2<u32>(i >> 2u & 63u, i >> 8u & 63u), i >> 14u & 3u, i >> 16u, seed[0]);
    rng.dimension = i & 3u;
    let bits = rng_bits(&rng);
    samples[i] = Out(bits, unit_float(bits));
}
