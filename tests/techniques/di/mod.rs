//! ReSTIR DI.

mod asset_scenes;
mod bias;
mod matrix;
mod motion;
mod settings;
mod small_scenes;
