// Each invocation runs one stream with given weights, and estimates ∫x² over [0, 1] by four candidates of density 2(1 - x) and target x.
#import bevy_restir::common::rng::{rng_1, rng_of_key}
#import bevy_restir::restir::reservoir_sampling::{Stream, stream_add, stream_ucw}

struct Outcome {
    selected: u32,
    sum: f32,
    toy: f32,
    accepted: u32,       // bit i: `stream_add` accepted input i
}

// The seed, then the weights.
@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var<storage, read_write> outcomes: array<Outcome>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    var rng = rng_of_key(id.x, bitcast<u32>(weights[0]), 79u, 0u);
    var stream = Stream(0.0, 0xffffffffu);
    var accepted = 0u;
    for (var i = 1u; i < arrayLength(&weights); i++) {
        accepted |= u32(stream_add(&stream, i - 1u, weights[i], rng_1(&rng))) << (i - 1u);
    }

    var toy = Stream(0.0, 0xffffffffu);
    var chosen = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let x = 1.0 - sqrt(1.0 - rng_1(&rng));
        let density = 2.0 * (1.0 - x);
        if stream_add(&toy, i, x / (4.0 * density), rng_1(&rng)) {
            chosen = x;
        }
    }
    outcomes[id.x] = Outcome(stream.selected, stream.sum, chosen * chosen * stream_ucw(toy, chosen), accepted);
}
