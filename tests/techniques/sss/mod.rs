//! Subsurface scattering, resampled beside ReSTIR DI.

mod small_scenes;
