// Samples of the BSDF for one query.  PLANTED biases the random numbers slightly, which a test must find.
#import bevy_restir::bsdf::bsdf::{bsdf_eval, bsdf_pdf, bsdf_sample}
#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::rng::{rng_3, rng_of_key}

struct Query {
    b: Bsdf,
    wo: vec3<f32>,
    seed: u32,
    wi: vec3<f32>,
    pad: u32,
}

struct Sample {
    wi: vec3<f32>,
    pdf: f32,
    weight: vec3<f32>,
    flags: u32,            // lobe | delta << 4 | valid << 5
    ratio: vec3<f32>,      // the expected weight: eval/pdf
    eta: f32,
}

@group(0) @binding(0) var<storage, read> queries: array<Query>;
@group(0) @binding(1) var<storage, read_write> samples: array<Sample>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let q = queries[0];
    var rng = rng_of_key(id.x, q.seed, 77u, 0u);
    var u = rng_3(&rng);
#ifdef PLANTED
    u.y = pow(u.y, 1.08);
#endif
    let s = bsdf_sample(q.b, q.wo, u);
    samples[id.x] = Sample(
        s.wi, s.pdf, s.weight, s.lobe | s.delta << 4u | s.valid << 5u,
        bsdf_eval(q.b, q.wo, s.wi) / max(bsdf_pdf(q.b, q.wo, s.wi), 1.0e-37), s.eta,
    );
}
