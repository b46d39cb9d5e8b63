//! Every claim of the crate, one module a subject; one binary, so that Bevy is linked once.

mod support;

mod bsdf;
mod environment;
mod light_choice;
mod lights;
mod rng;
