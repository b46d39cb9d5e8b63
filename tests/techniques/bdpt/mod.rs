//! Bidirectional path tracing.  `reference::mitsuba` compares it with an independent renderer.

mod copied_weights;
mod input;
mod light_passes;
mod light_paths_alone;
pub mod light_reuse;
mod long_run;
mod matrix;
pub mod reconnected;
pub mod shifts;
mod small_scenes;
mod techniques;
