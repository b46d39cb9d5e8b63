// Encodes and decodes directions (octahedral, equirectangular) and builds a frame.
#import bevy_restir::common::math::{equirectangular_direction, equirectangular_uv, octahedral_decode, octahedral_encode, orthonormal_basis}

struct Out {
    octahedral: vec3<f32>,
    u: f32,
    equirectangular: vec3<f32>,
    v: f32,
    t: vec3<f32>,
    pad_a: f32,
    b: vec3<f32>,
    pad_b: f32,
}

@group(0) @binding(0) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> results: array<Out>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&directions) {
        return;
    }
    let d = directions[id.x].xyz;
    let uv = equirectangular_uv(d);
    let frame = orthonormal_basis(d);
    results[id.x] = Out(
        octahedral_decode(octahedral_encode(d)), uv.x, equirectangular_direction(uv), uv.y, frame[0], 0.0, frame[1], 0.0,
    );
}
