// Uniforms of a view.  A test holds each struct X equal to `GpuX` in `src/gpu_layout.rs`.
#define_import_path bevy_restir::view::types

// A camera without jitter; reverse z.
struct Camera {
    clip_from_offset: mat4x4<f32>,      // of offsets from the position of the camera, along the axes of the world
    world_from_view: mat4x4<f32>,
    view_from_clip: mat4x4<f32>,
    image_normal: vec3<f32>,   // unit normal of the image in world space
    image_area: f32,           // of the image at a distance of 1 m from a perspective camera, or of the orthographic image; m²
}

struct ViewUniforms {
    current: Camera,
    previous: Camera,
    environment_rotation: mat3x3<f32>,  // from world to environment
    previous_environment_rotation: mat3x3<f32>,
    environment_color: vec3<f32>,       // cd/m²; factor of the map if there is one
    exposure: f32,                      // exposure of the camera; for debug views the scale of their values
    previous_environment_color: vec3<f32>,
    firefly_limit: f32,                 // greatest luminance of a pixel's scattered light, relative to the pixels around; 0: none
    background: vec3<f32>,              // radiance of pixels without a surface if the camera does not see the environment, cd/m²
    debug_view: u32,                    // DEBUG_* of the debug passes
    size: vec2<u32>,                    // of the traced picture, pixels
    jitter: vec2<f32>,                  // of this frame's primary rays: offset from the pixel center, pixels, x right, y down
    previous_jitter: vec2<f32>,
    frame: u32,                         // index in the sequence of random numbers
    seed: u32,
    bounces: u32,                       // greatest number of scattering events of a path
    flags: u32,                         // VIEW_*
    origin: vec2<u32>,                  // corner of the viewport in the render target, pixels
    accumulated: u32,                   // frames that `radiance` sums up so far; 0 restarts the sum
    layers: u32,                        // bit of the camera's set of render layers
    target_size: vec2<u32>,             // of the viewport, pixels; at least `size`
    background_alpha: f32,              // of pixels without a surface if the camera does not see the environment
    band_rows: u32,                     // rows of pixels of the band that the pass runs over; those of the picture if it runs over all of it
    first_pixel: vec2<u32>,             // of this band
}
