//! All tests of the crate.  They form one binary, so that Bevy is linked once; each folder is a room with one subject.

mod bevy;
mod mutants;
mod sampling;
mod scene;
mod shaders;
mod support;
mod techniques;
mod tools;
mod tracing;
mod viewer;
