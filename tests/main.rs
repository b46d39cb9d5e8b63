//! Every claim of the crate, one module a subject; one binary, so that Bevy is linked once.

mod bsdf;
mod compensation;
mod environment;
mod geometry;
mod layout;
mod light_choice;
mod lights;
mod offset;
mod rng;
mod shaders_compose;
mod support;
mod traversal;
