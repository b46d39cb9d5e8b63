//! The formulas of materials, subsurface scattering, environments, textures and MIS weights in f64, written independently of the WGSL that they check.

pub mod bsdf;
pub mod environment;
pub mod mis;
pub mod quadrature;
pub mod subsurface;
pub mod texture;
