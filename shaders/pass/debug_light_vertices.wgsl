// Debug view of the light vertex cache: of the light sub-paths that the invocation of a pixel traces (`pass/light_paths.wgsl`), the number of
// stored vertices in red, and of the vertices that these stand for in green.

#import bevy_restir::restir::connection::light_vertex::light_vertex_at
#import bevy_restir::restir::connection::count::CONNECTS
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(1) var light_vertices: texture_2d<u32>;
@group(2) @binding(2) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_light_vertices(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel_index(pixel);
    // Without connections, no pass writes the cache.
    let paths = select(0u, settings.light_paths, CONNECTS);
    var vertices = vec2<u32>(0u);
    for (var path = index; path < paths; path += view.size.x * view.size.y) {
        let v = light_vertex_at(light_vertices, path);
        vertices += vec2<u32>(u32(v.events > 0u), v.count);
    }
    radiance[index] = vec4<f32>(vec2<f32>(vertices), 0.0, 1.0);
}
