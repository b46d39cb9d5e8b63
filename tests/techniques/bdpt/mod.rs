//! Bidirectional path tracing.  `reference::mitsuba` compares it with an independent renderer.

mod input;
pub mod light_reuse;
mod long_run;
mod small_scenes;
mod techniques;
