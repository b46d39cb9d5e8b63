// Buffers of light sub-paths that are counted (`restir/bdpt/light_counts.wgsl`).
#define_import_path bevy_restir::restir::bdpt::count_bindings

@group(2) @binding(1) var light_vertices: texture_2d<u32>;
@group(2) @binding(2) var<storage, read> light_map: array<u32>;
