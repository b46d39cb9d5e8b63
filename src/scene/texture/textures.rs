//! Makes images readable for shaders (`shaders/scene/texture.wgsl`) in one of two ways.  Shaders wrap and filter both in the same way.
//!
//! **Bindless** ([`bindless`](super::bindless)), if the device has arrays of textures: images with their own mip levels, as KTX2 files have.
//! They need no memory beyond Bevy's copy, keep their precision, and show the mip levels of their author.  Bevy uploads an edited image to
//! the old texture if its usage has `COPY_DST`, and leaves the coarser levels outdated; such an image moves to the atlas.
//!
//! **In the atlas**: images without mip levels, and all images on other devices.  A compute pass reads every format that a float texture can
//! have, including compressed ones, and computes the mip levels from the finest one by averaging in linear light.  The atlas has 8-bit RGBA
//! texels, which is 5.3 bytes per texel of the image with all levels.  Images of float formats are stored with a shared exponent in place
//! of alpha.  Their own mip levels are ignored.
//!
//! **Edited images** get another place: another rectangle or another index.  The old place stays for at least one frame, because temporal
//! reuse traces the scene of the last frame.  The materials that use an edited image count as edited (`material::materials`), and histories
//! go on.  Histories restart where the old pixels are lost: where Bevy has overwritten a bound texture, or where there is no room for two
//! places.
//!
//! **Images that the GPU writes** (`RENDER_ATTACHMENT` or `STORAGE_BINDING` among their usages: targets of cameras and compute passes)
//! count as changed in every frame in which a material uses them, because Bevy does not report when they are written.  The atlas copies
//! them before the cameras of the frame draw, so they appear one frame late; the copy costs one dispatch per level and 5.3 bytes per texel
//! in each frame.  Meanwhile frames are not accumulated and no history is kept, because their old pixels are lost.

mod places;

use bevy::{
    asset::{AssetId, AssetServer, Assets, RenderAssetUsages},
    color::LinearRgba,
    ecs::{resource::Resource, system::Res, system::ResMut},
    image::Image,
    log::warn,
    platform::collections::{HashMap, HashSet},
    render::{
        Extract,
        render_asset::{ExtractedAssets, RenderAssetBytesPerFrameLimiter, RenderAssets},
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

use core::num::NonZeroU32;

use crate::scene::{
    asset_wait::AssetWait,
    extract::ExtractedScene,
    texture::atlas::{Atlas, Copier},
    texture::atlas_allocator::{AtlasAllocator, Limits},
    texture::bindless::BindlessTextures,
    texture::image_info::{BINDLESS, ImageInfo, LEVELS_SHIFT, is_color_texture, is_live, mean_color, size_in_atlas},
};
use crate::{
    cpu_times::{CpuTimes, Stage},
    gpu_layout::NO_TEXTURE,
    shader_library::ShaderLibrary,
    warned::Warned,
};

/// The textures of the scene.
#[derive(Resource)]
pub(crate) struct TexturePool {
    info: HashMap<AssetId<Image>, ImageInfo>,
    allocator: AtlasAllocator,
    /// Images that shaders cannot read, until they change.
    rejected: HashSet<AssetId<Image>>,
    /// Those of them that the device had no memory for.  They are tried again after `wait` frames.
    without_memory: HashSet<AssetId<Image>>,
    wait: u32,
    /// A warning has said that the device has no memory for the atlas.
    warned_memory: bool,
    /// Images that a warning has named; each is named once, however often it changes.
    warned: Warned<AssetId<Image>>,
    /// A warning has said that the atlas is full.
    warned_full: bool,
    atlas: Option<Atlas>,
    copier: Copier,
    /// Exists if the device has arrays of textures.
    pub bindless: Option<BindlessTextures>,
    /// Images whose pixels have changed since they were bound or copied.
    changed: HashSet<AssetId<Image>>,
    /// Images that failed to load or that do not exist, and that a warning has named.
    absent: Warned<AssetId<Image>>,
    asset_wait: AssetWait,
    versions: u64,
    /// Images that were removed in this frame.  Temporal reuse still reads them.
    retired: Vec<AssetId<Image>>,
    /// An image with a slot was removed.
    lost_slot: bool,
    /// Images that the materials in use name, as of the last update that looked at them.
    used: HashSet<AssetId<Image>>,
    /// The next update must look at all images in use, although no material has changed.
    due: bool,
    /// Images that were looked at in this frame.
    pub visited: u64,
    /// Shaders can read every image in use, or none will become readable.
    pub complete: bool,
    /// Counts the frames in which pixels that the last frame could read were lost.
    pub edit_revision: u64,
}

/// Largest side of a page of the atlas, texels.
const MAX_PAGE: u32 = 8192;

impl Default for TexturePool {
    fn default() -> Self {
        Self {
            info: HashMap::default(),
            allocator: AtlasAllocator::default(),
            rejected: HashSet::default(),
            without_memory: HashSet::default(),
            wait: 0,
            warned_memory: false,
            warned: Warned::default(),
            warned_full: false,
            atlas: None,
            copier: Copier::default(),
            bindless: None,
            changed: HashSet::default(),
            absent: Warned::default(),
            asset_wait: AssetWait::default(),
            versions: 0,
            retired: Vec::new(),
            lost_slot: false,
            used: HashSet::default(),
            due: true,
            visited: 0,
            complete: true,
            edit_revision: 0,
        }
    }
}

/// Records the properties of new and changed images while their pixels are still on the CPU.
pub(crate) fn record_images(
    mut pool: ResMut<TexturePool>,
    extracted: Res<ExtractedAssets<GpuImage>>,
    default_sampler: Res<DefaultImageSamplerDescriptor>,
    limiter: Option<Res<RenderAssetBytesPerFrameLimiter>>,
    scene: Res<ExtractedScene>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Textures);
    let pool = &mut *pool;
    pool.asset_wait.begin_frame();
    pool.warned.begin_frame();
    pool.absent.begin_frame();
    // Where Bevy limits the bytes of a frame, an image may arrive on the GPU long after this.
    pool.due |= limiter.is_some_and(|limiter| limiter.max_bytes.is_some());
    // An app also changes images of other things: pages of a font, or a film in the user interface.
    let mut changed = extracted.extracted.iter().map(|(id, _)| id).chain(&extracted.removed);
    pool.due |= changed.any(|id| pool.used.contains(id));
    pool.release_retired();
    pool.due |= pool.lost_slot;
    let emissive = if extracted.extracted.is_empty() { HashSet::default() } else { scene.emissive_images() };
    for (id, image) in &extracted.extracted {
        pool.versions += 1;
        // The mean color is expensive.  If the main world keeps the pixels, it can wait until a material emits the image.
        let needs_mean = emissive.contains(id) || !image.asset_usage.contains(RenderAssetUsages::MAIN_WORLD);
        let info = ImageInfo::new(image, &default_sampler.0, needs_mean, pool.versions);
        pool.info.insert(*id, info);
        pool.changed.insert(*id);
        pool.rejected.remove(id);
    }
    for id in &extracted.removed {
        pool.info.remove(id);
        pool.warned.forget(id);
        pool.rejected.remove(id);
        pool.changed.remove(id);
        pool.retired.push(*id);
    }
}

/// Computes the mean colors of loaded images that new or changed materials emit.
pub(crate) fn extract_mean_colors(
    mut pool: ResMut<TexturePool>,
    scene: Res<ExtractedScene>,
    images: Extract<Option<Res<Assets<Image>>>>,
) {
    let Some(images) = images.as_ref() else { return };
    for handle in scene.materials.values().filter_map(|m| m.emissive_texture.as_ref()) {
        if let Some(info) = pool.info.get_mut(&handle.id())
            && let Some(image) = images.get(handle).filter(|_| info.mean.is_none())
        {
            info.mean = Some(mean_color(image));
        }
    }
}

impl TexturePool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("images", self.info.len()),
            ("rejected images", self.rejected.len()),
            ("changed images", self.changed.len()),
            ("bound textures", self.bindless.as_ref().map_or(0, BindlessTextures::len)),
            ("warnings of images", self.warned.len() + self.absent.len()),
        ]
    }

    /// A pool that binds up to `max_textures` bindless textures.
    pub(crate) fn with_bindless(max_textures: NonZeroU32) -> Self {
        Self { bindless: Some(BindlessTextures::new(max_textures)), ..Default::default() }
    }

    /// The slot that a material stores; [`NO_TEXTURE`] if shaders cannot read the image (yet).
    pub(crate) fn slot(&self, id: AssetId<Image>) -> [u32; 4] {
        let Some(info) = self.info.get(&id) else { return NO_TEXTURE };
        if let Some(texture) = self.bindless.as_ref().and_then(|bindless| bindless.get(id)) {
            let [width, height] = texture.size();
            return [
                BINDLESS | texture.index | info.flags | texture.levels() << LEVELS_SHIFT,
                0,
                width | height << 16,
                0,
            ];
        }
        let Some(p) = self.allocator.get(id) else { return NO_TEXTURE };
        let layer = p.layer | info.flags | p.levels() << LEVELS_SHIFT;
        [layer, p.corner.x | p.corner.y << 16, p.size.x | p.size.y << 16, 0]
    }

    /// Mean color, linear; white if it is unknown.
    pub(crate) fn mean(&self, id: AssetId<Image>) -> LinearRgba {
        self.info.get(&id).and_then(|info| info.mean).unwrap_or(LinearRgba::WHITE)
    }

    /// Changes whenever the pixels of an image do.
    pub(crate) fn version(&self, id: AssetId<Image>) -> u64 {
        self.info.get(&id).map_or(0, |info| info.version)
    }

    /// Whether an image will reach the render world.  Warns once about one that failed to load or does not exist.
    pub(crate) fn is_coming(&mut self, id: AssetId<Image>, assets: &AssetServer) -> bool {
        let coming = self.info.contains_key(&id) || self.asset_wait.is_pending(id, assets);
        if coming {
            self.absent.forget(&id);
        } else if self.absent.is_due(id) {
            match assets.get_path(id) {
                Some(path) => warn!(
                    "restir: image {path} could not be loaded; materials and environments are rendered without it"
                ),
                None => warn!("restir: image {id} does not exist; materials and environments are rendered without it"),
            }
        }
        coming
    }

    /// The atlas, once it exists.
    pub(crate) fn view(&self) -> Option<&TextureView> {
        self.atlas.as_ref().map(Atlas::view)
    }

    /// Name and bytes, for the statistics.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        ("texture atlas", self.atlas.as_ref().map_or(0, Atlas::bytes))
    }

    /// Whether shaders can read an image: its current texture is in the array, or some version of it is in the atlas.
    fn is_readable(&self, id: AssetId<Image>, image: &GpuImage) -> bool {
        self.allocator.get(id).is_some()
            || self.bindless.as_ref().is_some_and(|bindless| bindless.holds(id, &image.texture))
    }

    /// Removes the images that the last frame was the last to use, unless they exist again.
    fn release_retired(&mut self) {
        for id in core::mem::take(&mut self.retired) {
            if !self.info.contains_key(&id) {
                let had_slot = self.release(id);
                self.lost_slot |= had_slot;
            }
        }
        if let Some(bindless) = &mut self.bindless {
            bindless.release_retired();
        }
    }

    /// Removes an image from atlas and array; true if it was in one of them.
    fn release(&mut self, id: AssetId<Image>) -> bool {
        let was_bound = self.bindless.as_mut().is_some_and(|bindless| bindless.release(id));
        self.allocator.release(id) || was_bound
    }

    /// Starts to compile the shader that copies images to the atlas.
    pub(crate) fn prepare_pipeline(&mut self, pipelines: &PipelineCache, shaders: &ShaderLibrary) {
        self.copier.pipeline(pipelines, shaders);
    }

    /// Binds the images that are used and loaded, or copies them to the atlas.  Does nothing where neither the used images nor their pixels
    /// can have changed.  `used`: each image, and whether an instance shows it.  True if a slot was added, moved or lost.
    pub(crate) fn update(
        &mut self,
        used_changed: bool,
        used: impl Iterator<Item = (AssetId<Image>, bool)>,
        images: &RenderAssets<GpuImage>,
        pipelines: &PipelineCache,
        shaders: &ShaderLibrary,
        assets: &AssetServer,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> bool {
        self.visited = 0;
        self.retry();
        if !self.due && !used_changed {
            return false;
        }
        let mut shown = HashSet::new();
        let used = used.inspect(|&(id, is_shown)| _ = is_shown && shown.insert(id)).map(|(id, _)| id);
        let (used, all_usable) = self.usable(used, images, assets, device);
        self.visited = used.len() as u64;
        let mut moved = core::mem::take(&mut self.lost_slot);
        self.complete = used.iter().all(|id| images.get(*id).is_some_and(|image| self.is_readable(*id, image)));
        let is_new = |id: &AssetId<Image>| {
            images.get(*id).is_some_and(|image| !self.is_readable(*id, image) || self.changed.contains(id))
        };
        let mut new: Vec<_> = used.iter().filter(|id| is_new(id)).copied().collect();
        new.sort_unstable();
        moved |= self.reject_unsupported(&mut new, images, device);
        moved |= self.bind(&mut new, images, &shown);
        // Images that the GPU writes count as changed in every frame.
        let is_live = |id: &AssetId<Image>| images.get(*id).is_some_and(|i| is_live(i.texture_descriptor.usage));
        let live: Vec<_> = used.iter().filter(|id| is_live(id) && !self.rejected.contains(*id)).copied().collect();
        self.edit_revision += u64::from(live.iter().any(|id| shown.contains(id)));
        self.due =
            !(self.complete && all_usable && new.is_empty() && live.is_empty() && self.allocator.left_out() == 0);
        let is_copied = |id: &AssetId<Image>| shown.contains(id) && self.allocator.get(*id).is_some();
        let mut copied: HashSet<_> = live.into_iter().filter(is_copied).collect();
        if new.is_empty() && copied.is_empty() {
            return moved;
        }
        let Some(pipeline) = self.copier.pipeline(pipelines, shaders) else { return moved };
        if !new.is_empty() {
            copied.extend(self.place(&new, &used, &shown, images, device));
            moved = true;
        }
        let Some(atlas) = &self.atlas else { return moved };
        let jobs = copied
            .into_iter()
            .filter_map(|id| Some((images.get(id)?, *self.allocator.get(id)?, self.info.get(&id)?.encoding)));
        self.copier.copy(jobs, atlas, pipeline, pipelines, device, queue);
        moved
    }

    /// Takes back the rejection of images that the device had no memory for, once enough frames have passed.
    fn retry(&mut self) {
        if self.wait == 1 {
            let without_memory = core::mem::take(&mut self.without_memory);
            self.rejected.retain(|id| !without_memory.contains(id));
            self.due = true;
        }
        self.wait = self.wait.saturating_sub(1);
    }

    /// Filters images: keeps those that are loaded or will be, that shaders can read, and that may fit into the atlas.  Returns them, and
    /// whether all images that shaders can read are among them.
    fn usable(
        &mut self,
        used: impl Iterator<Item = AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        assets: &AssetServer,
        device: &RenderDevice,
    ) -> (HashSet<AssetId<Image>>, bool) {
        self.used = used.collect();
        let mut used: HashSet<_> = self.used.iter().filter(|id| !self.rejected.contains(*id)).copied().collect();
        self.allocator.make_room(&used);
        let limit = limits(device).page;
        let count = used.len();
        used.retain(|id| match images.get(*id) {
            Some(image) => !self.allocator.is_left_out(*id, size_in_atlas(image, limit)),
            None => self.is_coming(*id, assets),
        });
        let all_usable = used.len() == count;
        (used, all_usable)
    }

    /// Removes images from the list that cannot be bound as 2D float textures.  True if one of them had a slot.
    fn reject_unsupported(
        &mut self,
        new: &mut Vec<AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        device: &RenderDevice,
    ) -> bool {
        let is_supported = |id: &AssetId<Image>| images.get(*id).is_some_and(|image| is_color_texture(image, device));
        let mut moved = false;
        for id in new.extract_if(.., |id| !is_supported(id)) {
            if self.warned.is_due(id) {
                warn!(
                    "restir: image {id} is not a 2D color texture that shaders can read; materials are rendered without it"
                );
            }
            self.rejected.insert(id);
            moved |= self.release(id);
        }
        moved
    }
}

/// Largest side of a page and largest number of pages.
fn limits(device: &RenderDevice) -> Limits {
    let limits = device.limits();
    Limits { page: limits.max_texture_dimension_2d.min(MAX_PAGE), layers: limits.max_texture_array_layers }
}
