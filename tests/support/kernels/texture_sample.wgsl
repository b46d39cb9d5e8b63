// A texture slot, sampled at a point and over a footprint.
#import bevy_restir::scene::texture::{sample_area, sample_texture, TextureArea}

struct Query {
    slot: vec4<u32>,
    uv: vec2<f32>,
    axis_a: vec2<f32>,
    axis_b: vec2<f32>,
    pad: vec2<f32>,
}

@group(1) @binding(0) var<storage, read> queries: array<Query>;
@group(1) @binding(1) var<storage, read_write> colors: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&queries) {
        return;
    }
    let q = queries[id.x];
    colors[2u * id.x] = sample_texture(q.slot, q.uv);
    colors[2u * id.x + 1u] = sample_area(q.slot, TextureArea(q.uv, q.axis_a, q.axis_b));
}
