//! Every claim of the crate, one module a subject; one binary, so that Bevy is linked once.

mod accumulation;
mod analytic_light;
mod bad_input;
mod bsdf;
mod compensation;
mod direct_bias;
mod direct_light;
mod direct_measure;
mod direct_motion;
mod environment;
mod extremes;
mod geometry;
mod layout;
mod light_choice;
mod lights;
mod motion_vectors;
mod offset;
mod references;
mod render_cli;
mod resampling;
mod rng;
mod scene_mirror;
mod shaders_compose;
mod support;
mod traversal;
mod visibility_buffer;
