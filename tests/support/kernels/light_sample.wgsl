// Samples of one light from one point.  PLANTED scales the density, which a test must find.
#import bevy_restir::common::rng::{rng_2, rng_of_key}
#import bevy_restir::light::light::light_sample
#import bevy_restir::light::triangle::triangle_light_pdf_solid_angle
#import bevy_restir::scene::bindings::lights

struct Query {
    point: vec3<f32>,
    light: u32,
    seed: u32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
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
    hit_pdf: f32,          // the density for a BSDF ray that hits the same point
    pad: f32,
}

@group(2) @binding(0) var<storage, read> queries: array<Query>;
@group(2) @binding(1) var<storage, read_write> samples: array<Sample>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let q = queries[0];
    var rng = rng_of_key(id.x, q.seed, 78u, 0u);
    let s = light_sample(q.light, q.point, rng_2(&rng));
    var pdf = s.pdf_solid_angle;
    let data = lights[min(q.light, arrayLength(&lights) - 1u)].data;
    let hit_pdf = triangle_light_pdf_solid_angle(data.x, data.y, q.point, s.position, false);
#ifdef PLANTED
    pdf *= 1.03;
#endif
    samples[id.x] = Sample(
        s.wi, s.distance, s.radiance, pdf, s.position, s.delta, s.normal, s.light, s.barycentrics, hit_pdf, 0.0,
    );
}
