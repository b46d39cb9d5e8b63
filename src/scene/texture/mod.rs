//! Textures: bindless where the device has arrays of textures, and copied to an atlas otherwise.

pub(crate) mod atlas;
mod atlas_allocator;
pub(crate) mod bindless;
pub(crate) mod image_info;
pub(crate) mod textures;
