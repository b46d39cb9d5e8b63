//! The formulas of materials, subsurface scattering, environments, textures, MIS weights and reconnections in f64, written independently of
//! the WGSL that they check.

pub mod bidirectional;
pub mod bsdf;
pub mod directional_albedo;
pub mod enumeration;
pub mod environment;
pub mod light_choice;
pub mod mis;
pub mod pairs;
pub mod quadrature;
pub mod reconnection;
pub mod roulette;
pub mod subsurface;
pub mod texture;
