//! What the tests share: the composer, the GPU harness, statistics, and the f64 oracle.
#![allow(dead_code, reason = "not every test uses every helper")]

pub mod app;
pub mod brute_force;
pub mod cli;
pub mod compose;
pub mod corner;
pub mod direct;
pub mod equivalence;
pub mod gltf;
pub mod gpu;
pub mod lit;
pub mod loaded;
pub mod log;
pub mod materials;
pub mod matrix;
pub mod oracle;
pub mod plane;
pub mod proof;
pub mod scenes;
pub mod stats;
