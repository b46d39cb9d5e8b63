// What a camera is to the shaders.  Equal by test to `GpuX` in `src/gpu_types.rs`.
#define_import_path bevy_restir::view::types

// Projection without jitter; reverse z.
struct Camera {
    clip_from_world: mat4x4<f32>,
    world_from_view: mat4x4<f32>,
    view_from_clip: mat4x4<f32>,
}

struct ViewUniforms {
    current: Camera,
    previous: Camera,
    environment_rotation: mat3x3<f32>,  // environment from world
    environment_color: vec3<f32>,       // cd/m²; times the map where there is one
    exposure: f32,                      // of debug views, which are no light, their scale
    background: vec3<f32>,              // what the camera sees where it sees no environment, cd/m²
    debug_view: u32,                    // DEBUG_* in pass/debug.wgsl
    size: vec2<u32>,                    // pixels of the picture that is traced
    jitter: vec2<f32>,                  // of this frame's primary rays, pixels, x right and y down, within half a pixel of 0
    previous_jitter: vec2<f32>,
    frame: u32,                         // of the sequence of random numbers
    seed: u32,
    bounces: u32,                       // scattering events a path may have
    flags: u32,                         // VIEW_*
    origin: vec2<u32>,                  // of the viewport in its target, pixels
    accumulated: u32,                   // frames that `radiance` holds already: 0 starts again
    layers: u32,                        // bit of the camera's set of render layers
    target_size: vec2<u32>,             // pixels of the viewport; `size`, or more
}
