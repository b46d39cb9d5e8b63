//! Bindless textures: one array of Bevy's own textures, if the device supports arrays of textures (`bound_textures` in
//! `shaders/scene/bindings.wgsl`).
//!
//! Temporal reuse also reads the textures of the last frame.  So an edited image with a new texture gets another index, and the old texture
//! keeps its index for one more frame.

use bevy::{
    asset::AssetId,
    image::Image,
    platform::collections::HashMap,
    render::{
        render_resource::{binding_types::texture_2d, *},
        renderer::RenderDevice,
        texture::GpuImage,
    },
};
use core::num::NonZeroU32;

/// Limit of the array: each texture in it costs a little CPU time in each pass.
const MAX_TEXTURES: u32 = 4096;

/// Size of the array on this device; `None` if the device has no arrays of textures that neighboring invocations may index differently, or
/// no bind group left.  `bind_groups`: number of groups that passes bind otherwise.
pub(crate) fn max_textures(device: &RenderDevice, bind_groups: u32) -> Option<NonZeroU32> {
    let needed = WgpuFeatures::TEXTURE_BINDING_ARRAY
        | WgpuFeatures::SAMPLED_TEXTURE_AND_STORAGE_BUFFER_ARRAY_NON_UNIFORM_INDEXING
        | WgpuFeatures::PARTIALLY_BOUND_BINDING_ARRAY;
    let limits = device.limits();
    if !device.features().contains(needed) || limits.max_bind_groups <= bind_groups {
        return None;
    }
    NonZeroU32::new(limits.max_binding_array_elements_per_shader_stage.min(MAX_TEXTURES))
}

/// Layout of the group with the array.
pub(crate) fn layout(max_textures: NonZeroU32) -> BindGroupLayoutDescriptor {
    let images = texture_2d(TextureSampleType::Float { filterable: false }).count(max_textures);
    BindGroupLayoutDescriptor::new(
        "restir bound textures",
        &BindGroupLayoutEntries::single(ShaderStages::COMPUTE | ShaderStages::FRAGMENT, images),
    )
}

/// A texture in the array.
pub(crate) struct BindlessTexture {
    pub index: u32,
    texture: Texture,
    view: TextureView,
}

impl BindlessTexture {
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.texture.width(), self.texture.height()]
    }

    pub(crate) fn levels(&self) -> u32 {
        self.texture.mip_level_count()
    }
}

/// The array of textures.
pub(crate) struct BindlessTextures {
    pub max_textures: NonZeroU32,
    images: HashMap<AssetId<Image>, BindlessTexture>,
    /// Textures to which Bevy has uploaded an edited image.  It uploads only the finest level, so the other levels are outdated.
    rewritten: HashMap<AssetId<Image>, TextureId>,
    /// Textures that only the last frame used.
    retired: Vec<BindlessTexture>,
    /// Free indices below `end`.
    free: Vec<u32>,
    /// All indices in use are below this.
    end: u32,
    /// Changes when the array does; 0 until it holds an image.
    pub revision: u64,
}

impl BindlessTextures {
    pub(crate) fn new(max_textures: NonZeroU32) -> Self {
        Self {
            max_textures,
            images: HashMap::default(),
            rewritten: HashMap::default(),
            retired: Vec::new(),
            free: Vec::new(),
            end: 0,
            revision: 0,
        }
    }

    /// Number of textures in the array, with those that only the last frame used.
    #[cfg(feature = "testing")]
    pub(crate) fn len(&self) -> usize {
        self.images.len() + self.retired.len()
    }

    pub(crate) fn get(&self, id: AssetId<Image>) -> Option<&BindlessTexture> {
        self.images.get(&id)
    }

    /// Whether the array holds the current texture of an image.
    pub(crate) fn holds(&self, id: AssetId<Image>, texture: &Texture) -> bool {
        self.images.get(&id).is_some_and(|stored| stored.texture.id() == texture.id())
    }

    /// Whether [`Self::insert`] finds that Bevy has overwritten the pixels of the last frame, or has no free index beside theirs.
    pub(crate) fn loses_pixels(&self, id: AssetId<Image>, image: &GpuImage) -> bool {
        self.holds(id, &image.texture) || (self.images.contains_key(&id) && self.is_full())
    }

    fn is_full(&self) -> bool {
        self.free.is_empty() && self.end >= self.max_textures.get()
    }

    /// Adds an image that is new or changed.  A changed image gets another index, unless the array is full.  Returns false, and removes the
    /// image, if it has no valid mip levels of its own or if the array is full.
    pub(crate) fn insert(&mut self, id: AssetId<Image>, image: &GpuImage) -> bool {
        let texture = &image.texture;
        if self.holds(id, texture) {
            self.rewritten.insert(id, texture.id());
        }
        let has_levels = texture.mip_level_count() > 1 && self.rewritten.get(&id) != Some(&texture.id());
        if has_levels && self.store(id, image) {
            return true;
        }
        self.remove(id);
        false
    }

    fn store(&mut self, id: AssetId<Image>, image: &GpuImage) -> bool {
        let index = match self.free.pop() {
            Some(index) => index,
            None if !self.is_full() => {
                self.end += 1;
                self.end - 1
            }
            None => match self.images.remove(&id) {
                Some(last) => last.index,
                None => return false,
            },
        };
        self.retired.extend(self.images.remove(&id));
        let view = image.texture.create_view(&TextureViewDescriptor {
            label: Some("restir bound texture"),
            format: Some(image.view_format()),
            dimension: Some(TextureViewDimension::D2),
            array_layer_count: Some(1),
            ..Default::default()
        });
        self.images.insert(id, BindlessTexture { index, texture: image.texture.clone(), view });
        self.revision += 1;
        true
    }

    /// Removes an image; true if the array held it.
    pub(crate) fn release(&mut self, id: AssetId<Image>) -> bool {
        self.rewritten.remove(&id);
        self.remove(id)
    }

    fn remove(&mut self, id: AssetId<Image>) -> bool {
        let Some(stored) = self.images.remove(&id) else { return false };
        self.retired.push(stored);
        self.revision += 1;
        true
    }

    /// Frees the indices that the last frame was the last to use.
    pub(crate) fn release_retired(&mut self) {
        self.revision += u64::from(!self.retired.is_empty());
        self.free.extend(self.retired.drain(..).map(|texture| texture.index));
    }

    /// Bind group of the array, with `placeholder` at the free indices.
    pub(crate) fn bind_group(
        &self,
        placeholder: &TextureView,
        device: &RenderDevice,
        pipelines: &PipelineCache,
    ) -> BindGroup {
        // An empty array cannot be bound.
        let mut views = vec![&**placeholder; self.end.max(1) as usize];
        for stored in self.images.values().chain(&self.retired) {
            views[stored.index as usize] = &stored.view;
        }
        device.create_bind_group(
            "restir bound textures",
            &pipelines.get_bind_group_layout(&layout(self.max_textures)),
            &[BindGroupEntry { binding: 0, resource: BindingResource::TextureViewArray(&views) }],
        )
    }
}
