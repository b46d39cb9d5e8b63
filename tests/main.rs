//! Every claim of the crate, one module a subject; one binary, so that Bevy is linked once.

mod geometry;
mod layout;
mod offset;
mod shaders_compose;
mod support;
mod traversal;
