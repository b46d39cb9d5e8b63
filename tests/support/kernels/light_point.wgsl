// Light samples packed in eight bytes and unpacked, beside the original samples; or points with given coordinates.
#import bevy_restir::common::rng::{rng_2, rng_bits, rng_of_key}
#import bevy_restir::light::environment::environment_pdf
#import bevy_restir::light::light::light_sample
#import bevy_restir::light::point_on_light::{light_point_at, light_point_sample}

struct Query {
    point: vec3<f32>,
    light: u32,
    seed: u32,
    any: u32,
    pad_a: u32,
    pad_b: u32,
}

struct Sample {
    wi: vec3<f32>,
    distance: f32,
    radiance: vec3<f32>,
    pdf: f32,
    position: vec3<f32>,
    delta: u32,
    normal: vec3<f32>,
    light: u32,
    barycentrics: vec2<f32>,
    density: f32,          // density of the environment in the direction
    rounding: f32,         // `SampledPoint::rounding`
}

@group(2) @binding(0) var<storage, read> queries: array<Query>;
@group(2) @binding(1) var<storage, read_write> samples: array<array<Sample, 2>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let q = queries[0];
    var rng = rng_of_key(id.x, q.seed, 80u, 0u);
    let u = rng_2(&rng);
    let a = light_sample(q.light, q.point, u);
    let sampled = light_point_sample(q.light, u);
    var p = sampled.point;
    if q.any != 0u {
        p.coordinates = rng_bits(&rng).x;
    }
    let b = light_point_at(p, q.point, false);
    samples[id.x][0] = Sample(a.wi, a.distance, a.radiance, a.pdf_solid_angle, a.position, a.delta, a.normal, a.light, a.barycentrics, 0.0, 0.0);
    samples[id.x][1] = Sample(
        b.wi, b.distance, b.radiance, b.pdf_solid_angle, b.position, b.delta, b.normal, b.light, b.barycentrics, environment_pdf(b.wi, false), sampled.rounding,
    );
}
