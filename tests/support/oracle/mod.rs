//! The formulas of materials, the environment, textures and MIS weights in f64, written apart from the WGSL that they judge.

pub mod bsdf;
pub mod environment;
pub mod mis;
pub mod quadrature;
pub mod texture;
