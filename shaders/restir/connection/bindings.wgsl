// Group 2 of the pass that connects vertices, in addition to `restir::bindings`.
#define_import_path bevy_restir::restir::connection::bindings

// The light vertex cache: one vertex of each light sub-path.
@group(2) @binding(4) var light_vertices: texture_2d<u32>;
