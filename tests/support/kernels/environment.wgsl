// Samples of the environment, and its radiance and density in given directions.
#import bevy_restir::common::rng::{rng_2, rng_of_key}
#import bevy_restir::light::environment::{environment_pdf, environment_radiance, environment_sample}

struct Sample {
    direction: vec3<f32>,
    pdf: f32,
    radiance: vec3<f32>,
    pdf_again: f32,
}

@group(2) @binding(0) var<storage, read> seed: array<u32>;
// pdf > 0 on entry: evaluate this direction; 0: sample one.
@group(2) @binding(1) var<storage, read_write> samples: array<Sample>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&samples) {
        return;
    }
    var direction = samples[id.x].direction;
    var pdf = 0.0;
    if samples[id.x].pdf == 0.0 {
        var rng = rng_of_key(id.x, seed[0], 80u, 0u);
        let s = environment_sample(rng_2(&rng), false);
        direction = s.direction;
        pdf = s.pdf_solid_angle;
    }
    samples[id.x] = Sample(direction, pdf, environment_radiance(direction, false), environment_pdf(direction, false));
}
