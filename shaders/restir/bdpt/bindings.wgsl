// Group 2 of the pass that joins sub-paths, in addition to `restir::bindings`.
#define_import_path bevy_restir::restir::bdpt::bindings

#import bevy_restir::restir::bdpt::light_vertex::PackedLightVertex

// The light vertex cache: one vertex of each light sub-path.
@group(2) @binding(1) var<storage, read> light_vertices: array<PackedLightVertex>;
