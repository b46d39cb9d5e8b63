// Group 1: the view.  The only module that binds it.
#define_import_path bevy_restir::view::bindings

#import bevy_restir::view::types::ViewUniforms

@group(1) @binding(0) var<uniform> view: ViewUniforms;
// (instance, triangle) a pixel; instance = NONE where the camera sees no surface.
@group(1) @binding(1) var visibility: texture_2d<u32>;
// Equirectangular radiance, or the six faces of a cube, and the mip chain of luminance · solid angle that importance-samples it; 1x1
// where there is no map.
@group(1) @binding(2) var environment_map: texture_2d_array<f32>;
@group(1) @binding(3) var environment_importance: texture_2d<f32>;
// Rays that this frame traced for a pixel in the low 24 bits, OVERFLOW_* in the high 8.
@group(1) @binding(4) var ray_counts: texture_storage_2d<r32uint, read_write>;
