//! What the tests have for bare kernels: a composer, a device for each back end, scenes in buffers.
#![allow(dead_code, reason = "the tests use the rest")]

#[path = "../../tests/support/compose.rs"]
pub mod compose;
#[path = "../../tests/support/gpu.rs"]
pub mod gpu;
#[path = "../../tests/support/scenes.rs"]
pub mod scenes;
