//! Subsurface scattering, resampled: of direct light beside ReSTIR DI, and of all light in the paths of ReSTIR GI and PT.

mod paths;
mod shifts;
mod small_scenes;
