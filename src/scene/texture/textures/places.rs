//! Gives new and edited images their places: indices in the array of textures, or rectangles in the atlas.

use bevy::{
    asset::AssetId,
    image::Image,
    log::warn,
    platform::collections::HashSet,
    render::{render_asset::RenderAssets, renderer::RenderDevice, texture::GpuImage},
};

use super::{TexturePool, limits};
use crate::scene::{
    storage::allocation,
    texture::atlas::Atlas,
    texture::atlas_allocator::{Item, Limits, Moves},
    texture::image_info::{is_live, size_in_atlas, warn_of_lost_bits, whole_size},
};

/// Number of frames between two attempts to create an atlas that the device has no memory for.
const RETRY: u32 = 60;

impl TexturePool {
    /// Binds images that have their own mip levels and removes them from the list.  `shown`: images that an instance shows.  True if a slot has
    /// changed.
    pub(super) fn bind(
        &mut self,
        new: &mut Vec<AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        shown: &HashSet<AssetId<Image>>,
    ) -> bool {
        let Some(bindless) = &mut self.bindless else { return false };
        let before = bindless.revision;
        let mut has_lost_pixels = false;
        new.retain(|id| {
            let Some(image) = images.get(*id) else { return true };
            has_lost_pixels |= shown.contains(id) && bindless.loses_pixels(*id, image);
            let is_bound = bindless.insert(*id, image);
            if is_bound {
                self.allocator.release(*id);
                self.changed.remove(id);
            }
            !is_bound
        });
        self.edit_revision += u64::from(has_lost_pixels);
        bindless.revision != before
    }

    /// Places new and edited images in the atlas, which is replaced if its size must change.  Returns the images to copy.
    pub(super) fn place(
        &mut self,
        new: &[AssetId<Image>],
        used: &HashSet<AssetId<Image>>,
        shown: &HashSet<AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        device: &RenderDevice,
    ) -> Vec<AssetId<Image>> {
        let limits = limits(device);
        let sized = self.sized(new, images, limits);
        let is_used = |id| used.contains(&id) && images.get(id).is_some();
        let had_images = self.allocator.images().next().is_some();
        let moves = self.allocate(sized, limits, is_used, device);
        let left_out = self.allocator.left_out();
        if left_out > 0 && !self.warned_full {
            warn!(
                "restir: {left_out} textures do not fit into the largest texture atlas of this device; materials are rendered without them"
            );
            self.warned_full = true;
        }
        let pages = self.allocator.pages();
        if !self.has_pages() && pages[1] > 0 {
            // Drops the old atlas first, because the memory may not hold both.
            self.atlas = None;
            match new_atlas(pages, device) {
                Ok(atlas) => (self.atlas, self.warned_memory) = (Some(atlas), false),
                Err(error) => {
                    self.reject_all(&error);
                    self.edit_revision += u64::from(had_images);
                    return Vec::new();
                }
            }
        }
        let has_lost_pixels = (moves.all && had_images) || moves.overwritten.iter().any(|id| shown.contains(id));
        self.edit_revision += u64::from(has_lost_pixels);
        if moves.all { self.allocator.images().collect() } else { new.to_vec() }
    }

    /// Images that need a rectangle, with their sizes.  Those that the GPU writes keep theirs, because they are copied in every frame.
    fn sized(&mut self, new: &[AssetId<Image>], images: &RenderAssets<GpuImage>, limits: Limits) -> Vec<Item> {
        let mut sized = Vec::new();
        for (id, image) in new.iter().filter_map(|id| Some((*id, images.get(*id)?))) {
            self.changed.remove(&id);
            warn_of_lost_bits(image.texture_descriptor.format);
            if whole_size(image).max_element() > limits.page
                && self.allocator.get(id).is_none()
                && self.warned.is_due(id)
            {
                warn!("restir: image {id} is larger than {} pixels on a side; it is scaled down", limits.page);
            }
            let size = size_in_atlas(image, limits.page);
            let stays = is_live(image.texture_descriptor.usage) && self.allocator.has_place(id, size);
            if !stays {
                sized.push((id, size));
            }
        }
        sized
    }

    /// Gives new and edited images their rectangles.  For the second rectangles of edited images, the atlas grows only if the device's memory
    /// holds the old one and the new one: no image is lost because another one is edited.
    fn allocate(
        &mut self,
        sized: Vec<Item>,
        limits: Limits,
        is_used: impl Fn(AssetId<Image>) -> bool,
        device: &RenderDevice,
    ) -> Moves {
        let doubles = sized.iter().any(|(id, size)| self.allocator.needs_second(*id, *size));
        let Some(mut last) = doubles.then(|| self.allocator.clone()) else {
            return self.allocator.place(sized, limits, is_used);
        };
        let moves = self.allocator.place(sized.clone(), limits, &is_used);
        if self.has_pages() {
            return moves;
        }
        match new_atlas(self.allocator.pages(), device) {
            Ok(atlas) => {
                self.atlas = Some(atlas);
                moves
            }
            Err(_) => {
                last.stop_doubling();
                self.allocator = last;
                self.allocator.place(sized, limits, is_used)
            }
        }
    }

    /// Whether the atlas has the pages that the images need.
    fn has_pages(&self) -> bool {
        self.atlas.as_ref().is_some_and(|atlas| atlas.pages() == self.allocator.pages())
    }

    /// Renders materials without the images of the atlas, because the device has no memory for it.
    fn reject_all(&mut self, error: &str) {
        let images: Vec<_> = self.allocator.images().collect();
        if !core::mem::replace(&mut self.warned_memory, true) {
            warn!(
                "restir: no memory for the texture atlas; materials are rendered without {} textures: {error}",
                images.len()
            );
        }
        for id in images {
            self.allocator.release(id);
            self.rejected.insert(id);
            self.without_memory.insert(id);
        }
        self.wait = RETRY;
    }
}

fn new_atlas([page, layers]: [u32; 2], device: &RenderDevice) -> Result<Atlas, String> {
    allocation::attempt(device, "texture atlas", || Atlas::new(page, layers, device))
}
