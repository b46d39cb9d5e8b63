// Normals and tangents of the corners of triangles.
#import bevy_restir::scene::corners::{corner_normals, corner_tangents}

struct Answer {
    normal_a: vec3<f32>,
    flipped: u32,
    normal_b: vec3<f32>,
    pad_b: u32,
    normal_c: vec3<f32>,
    pad_c: u32,
    tangent_a: vec3<f32>,
    pad_d: u32,
    tangent_b: vec3<f32>,
    pad_e: u32,
    tangent_c: vec3<f32>,
    pad_f: u32,
}

@group(1) @binding(0) var<storage, read> stored: array<u32>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&stored) {
        return;
    }
    let n = corner_normals(stored[id.x]);
    let t = corner_tangents(stored[id.x]);
    answers[id.x] = Answer(n.a, u32(t.flipped), n.b, 0u, n.c, 0u, t.tangents.a, 0u, t.tangents.b, 0u, t.tangents.c, 0u);
}
