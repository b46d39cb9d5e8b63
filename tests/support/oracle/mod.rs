//! The formulas of design 2 in f64, written apart from the WGSL that they judge.

pub mod bsdf;
pub mod environment;
pub mod mis;
pub mod quadrature;
pub mod texture;
