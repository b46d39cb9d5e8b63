//! Code that the examples, the measurements and the tests share: headless rendering of glTF scenes, command lines, settings by name,
//! environments, pictures as files, and bare compute kernels over the crate's own WGSL.

pub mod arguments;
pub mod bodies;
pub mod compose;
pub mod environment;
pub mod exposure;
pub mod exr_file;
pub mod fields;
pub mod files;
pub mod frame_sum;
pub mod framing;
pub mod front;
pub mod gpu;
pub mod headless;
pub mod mutant;
pub mod panics;
pub mod picture;
pub mod progress;
pub mod scene;
pub mod scenes;
pub mod skinned;
pub mod sky;
pub mod subsurface;
pub mod times;
