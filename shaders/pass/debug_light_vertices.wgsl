// Debug view of the light vertex cache: of the light sub-paths that the invocation of a pixel traces, the number of stored vertices in red,
// and of the vertices that these stand for in green.

#import bevy_restir::restir::bdpt::light_counts::vertices_traced_by
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(3) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_light_vertices(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel_index(pixel);
    radiance[index] = vec4<f32>(vec2<f32>(vertices_traced_by(index)), 0.0, 1.0);
}
