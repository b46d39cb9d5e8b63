//! GPU memory of the scene: growable buffers, the allocator of ranges in them, and arrays that shaders read as textures.

pub mod allocation;
pub(crate) mod data_texture;
pub(crate) mod dirty_runs;
pub(crate) mod growable_buffer;
pub(crate) mod overflow_warning;
pub(crate) mod range_allocator;
pub(crate) mod uploads;
