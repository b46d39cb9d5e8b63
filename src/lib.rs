//! ReSTIR path tracing for Bevy.

pub mod gpu_types;
pub mod scene;
pub mod shaders;
