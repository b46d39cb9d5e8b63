//! Code that the tests share: the app, the GPU harness, scenes, statistics, and the f64 oracle.
#![allow(dead_code, reason = "not every test uses every helper")]

pub mod agreement;
pub mod app;
pub mod asset_scenes;
pub mod bad_numbers;
pub mod bodies;
pub mod brute_force;
pub mod change_of_measure;
pub mod cli;
pub mod closed_form_plane;
pub mod devices;
pub mod equivalence;
pub mod expected_radiance;
pub mod gltf;
pub mod images;
pub mod light_scene;
pub mod log;
pub mod long_run;
pub mod materials;
pub mod matrix;
pub mod oracle;
pub mod picture;
pub mod proof;
pub mod proof_rows;
pub mod random_edits;
pub mod reuse_settings;
pub mod small_scenes;
pub mod start;
pub mod stats;
pub mod stored_results;

pub use bevy_restir_support::{compose, gpu, scenes};
