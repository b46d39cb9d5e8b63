//! Subsurface scattering, resampled beside ReSTIR DI.

mod shifts;
mod small_scenes;
