//! Every claim of the crate, one module a subject; one binary, so that Bevy is linked once.

mod layout;
mod shaders_compose;
mod support;
