//! Resampling of subsurface scattering: of direct light in ReSTIR SSS, and of all light in the paths of ReSTIR GI, PT and BDPT.

mod bust;
mod every_shift;
mod paths;
mod shifts;
mod small_scenes;
mod stale_probes;
