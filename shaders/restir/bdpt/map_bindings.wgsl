// The light map, in passes that choose among its entries (`restir/bdpt/landed.wgsl`).
#define_import_path bevy_restir::restir::bdpt::map_bindings

@group(2) @binding(1) var<storage, read> light_map: array<u32>;
