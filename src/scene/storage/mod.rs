//! GPU memory of the scene: growable buffers with a range allocator, and arrays that are read as textures.

pub(crate) mod data_texture;
pub mod growable_buffer;
