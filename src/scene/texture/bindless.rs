//! Images that shaders read as they are, where the device binds arrays of textures (`bound_textures` in `shaders/scene/bindings.wgsl`).

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

/// Most that are bound; every one costs each pass a little on the CPU.
const MAX_TEXTURES: u32 = 4096;

/// How many images the device binds in an array that neighboring invocations index differently, in one more group than
/// `bind_groups`; `None` where it has no such arrays.
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

/// The layout of the group that holds so many.
pub(crate) fn layout(max_textures: NonZeroU32) -> BindGroupLayoutDescriptor {
    let images = texture_2d(TextureSampleType::Float { filterable: false }).count(max_textures);
    BindGroupLayoutDescriptor::new(
        "restir bound textures",
        &BindGroupLayoutEntries::single(ShaderStages::COMPUTE | ShaderStages::FRAGMENT, images),
    )
}

/// One of them.
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

/// The array.
pub(crate) struct BindlessTextures {
    pub max_textures: NonZeroU32,
    images: HashMap<AssetId<Image>, BindlessTexture>,
    /// Textures that Bevy wrote again in place: it writes the finest level only, the others are those of the old picture.
    rewritten: HashMap<AssetId<Image>, TextureId>,
    /// AtlasAllocator below `end` that hold none.
    free: Vec<u32>,
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
            free: Vec::new(),
            end: 0,
            revision: 0,
        }
    }

    pub(crate) fn get(&self, id: AssetId<Image>) -> Option<&BindlessTexture> {
        self.images.get(&id)
    }

    /// Whether it holds an image as it is now.
    pub(crate) fn holds(&self, id: AssetId<Image>, texture: &Texture) -> bool {
        self.images.get(&id).is_some_and(|bound| bound.texture.id() == texture.id())
    }

    /// Takes an image that is new or changed, in the place that it had.  False where it has no levels of its own or there is no room; it
    /// then has no place.
    pub(crate) fn insert(&mut self, id: AssetId<Image>, image: &GpuImage) -> bool {
        let texture = &image.texture;
        if self.holds(id, texture) {
            self.rewritten.insert(id, texture.id());
        }
        let has_levels = texture.mip_level_count() > 1 && self.rewritten.get(&id) != Some(&texture.id());
        if has_levels && self.place(id, image) {
            return true;
        }
        self.remove(id);
        false
    }

    fn place(&mut self, id: AssetId<Image>, image: &GpuImage) -> bool {
        let index = match self.images.get(&id) {
            Some(bound) => bound.index,
            None => match self.free.pop() {
                Some(index) => index,
                None if self.end < self.max_textures.get() => {
                    self.end += 1;
                    self.end - 1
                }
                None => return false,
            },
        };
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

    /// Lets go of an image that is no more.  True where it held it.
    pub(crate) fn forget(&mut self, id: AssetId<Image>) -> bool {
        self.rewritten.remove(&id);
        self.remove(id)
    }

    fn remove(&mut self, id: AssetId<Image>) -> bool {
        let Some(bound) = self.images.remove(&id) else { return false };
        self.free.push(bound.index);
        self.revision += 1;
        true
    }

    /// The group that holds them all, `none` in the places that hold no image.
    pub(crate) fn bind_group(&self, none: &TextureView, device: &RenderDevice, pipelines: &PipelineCache) -> BindGroup {
        // An array of nothing cannot be bound.
        let mut views = vec![&**none; self.end.max(1) as usize];
        for bound in self.images.values() {
            views[bound.index as usize] = &bound.view;
        }
        device.create_bind_group(
            "restir bound textures",
            &pipelines.get_bind_group_layout(&layout(self.max_textures)),
            &[BindGroupEntry { binding: 0, resource: BindingResource::TextureViewArray(&views) }],
        )
    }
}
