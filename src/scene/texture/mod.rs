//! Textures: an atlas that every device can bind, or the images themselves where the device has arrays of textures.

mod atlas;
mod atlas_allocator;
pub(crate) mod bindless;
pub(crate) mod textures;
