// Uniforms of the denoiser.  A test holds the struct equal to `GpuDenoiserSettings` in `src/gpu_layout.rs`.
#define_import_path bevy_restir::denoiser::types

struct DenoiserSettings {
    step: u32,                 // distance of the pixels that an iteration of the filter combines
    history: u32,              // greatest number of frames in the mean
    has_history: u32,          // 1: the last frame left a mean
    pad: u32,
}

// Layers of a signal, by the kind of light; denoised apart, because textures, normals and motion blur them differently.
const DIFFUSE: u32 = 0u;
const SPECULAR: u32 = 1u;
