// Group 1: the view.  No other module binds it.
#define_import_path bevy_restir::view::bindings

#import bevy_restir::view::types::ViewUniforms

@group(1) @binding(0) var<uniform> view: ViewUniforms;
// The visibility buffer: (instance, triangle) of each pixel; instance = NONE where the camera sees no surface.
@group(1) @binding(1) var visibility: texture_2d<u32>;
// Radiance of the environment, equirectangular or the six faces of a cube; and a mip chain of luminance · solid angle for importance
// sampling.  Without a map they are 1x1.
@group(1) @binding(2) var environment_map: texture_2d_array<f32>;
@group(1) @binding(3) var environment_importance: texture_2d<f32>;
// Of this frame and pixel: the number of traced rays (0 without COUNT_RAYS), and the bits of `trace_flags` and `raised_guards`, one layer
// each.
@group(1) @binding(4) var counts: texture_storage_2d_array<r32uint, read_write>;
const LAYER_RAYS: u32 = 0u;
const LAYER_GUARDS: u32 = 1u;
