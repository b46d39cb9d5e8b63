//! ReSTIR path tracing for Bevy.

pub mod gpu_types;
pub mod shaders;
