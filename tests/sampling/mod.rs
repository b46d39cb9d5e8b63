//! Random numbers, materials, lights and environments: values equal the f64 oracle, and samples follow their densities.

mod analytic_area_lights;
mod bidirectional_mis;
mod bsdf;
mod emission;
mod energy_compensation;
mod environment;
mod light_choice;
mod light_scattering;
mod lights;
mod rng;
mod subsurface;
