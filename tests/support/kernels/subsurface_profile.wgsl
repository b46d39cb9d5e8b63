// The profile and its inverse for every radius and random number, and the frame about a normal.
#import bevy_restir::subsurface::probe::probe_frame
#import bevy_restir::subsurface::profile::{profile, profile_inverse, profile_pdf, profile_sample}

struct Query {
    normal: vec3<f32>,
    radius: f32,
    u: f32,
    pad_a: u32,
    pad_b: u32,
    pad_c: u32,
}

struct Answer {
    tangent: vec3<f32>,
    value: f32,
    bitangent: vec3<f32>,
    pdf: f32,
    radius: f32,
    inverse: f32,
    pad_a: u32,
    pad_b: u32,
}

@group(1) @binding(0) var<storage, read> queries: array<Query>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&queries) {
        return;
    }
    let q = queries[id.x];
    let frame = probe_frame(q.normal);
    answers[id.x] = Answer(
        frame[0], profile(q.radius), frame[1], profile_pdf(q.radius),
        profile_sample(q.u), profile_inverse(q.radius), 0u, 0u,
    );
}
