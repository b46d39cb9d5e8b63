// Counts of light sub-paths, for debug views and statistics: what the invocation of a pixel has stored of those that it traces
// (`pass/light_paths.wgsl`), and what has landed in its pixel.
#define_import_path bevy_restir::restir::bdpt::light_counts

#import bevy_restir::restir::bdpt::count_bindings::{light_map, light_vertices}
#import bevy_restir::restir::bdpt::light_map::{LINK_MASK, MAX_ENTRIES, word_of}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::connection::count::CONNECTS
#import bevy_restir::restir::connection::light_vertex::light_vertex_at
#import bevy_restir::view::bindings::view

// Number of the vertices in the light vertex cache, and of those that they stand for: the vertices that can be connected.  0 without
// connections, because no pass writes the cache then.
fn vertices_traced_by(pixel: u32) -> vec2<u32> {
    let paths = select(0u, settings.light_paths, CONNECTS);
    var vertices = vec2<u32>(0u);
    for (var path = pixel; path < paths; path += view.size.x * view.size.y) {
        let v = light_vertex_at(light_vertices, path);
        vertices += vec2<u32>(u32(v.events > 0u), v.count);
    }
    return vertices;
}

// Number of entries in the list of a pixel.
fn splats_landed_in(pixel: u32) -> u32 {
    var count = 0u;
    // Without splats, the light map has no lists.
    if settings.splats > 0u {
        for (var next = light_map[pixel]; next != 0u && count < MAX_ENTRIES; count++) {
            next = light_map[word_of(next)] & LINK_MASK;
        }
    }
    return count;
}
