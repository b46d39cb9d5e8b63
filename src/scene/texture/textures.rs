//! Images → where shaders find their texels (`shaders/scene/texture.wgsl`), in one of two ways; how they are wrapped and filtered is one.
//!
//! **Bound as they are**, where the device has arrays of textures ([`bound`](super::bindless)): images that come with levels of their own,
//! as KTX2 files do.  They cost no memory beyond Bevy's own copy, keep their precision, and their author's levels are seen.  Where Bevy
//! writes an edited image over the old one it leaves the coarser levels as they were: such an image goes to the atlas.
//!
//! **In the atlas**, everywhere: images without levels, and on other devices all.  A compute pass reads every format that a float texture
//! can have, compressed ones too, and makes the levels from the finest one by means in linear light: 8-bit RGBA, 5.3 bytes a texel
//! whatever the source; what is kept in floats has an exponent in place of its alpha.  Levels that an image has are not read.
//!
//! **Images that the GPU writes** (`RENDER_ATTACHMENT` or `STORAGE_BINDING` among their usages: what a camera or a compute pass draws to)
//! are taken for another picture in every frame that a material uses them: nothing says when they are written.  The atlas copies them
//! before the frame's cameras draw, so that they are seen a frame late; a dispatch a level and 5.3 bytes a texel each frame.  No frames
//! are summed and no history is kept meanwhile, as with images that are edited each frame.

use bevy::{
    asset::{AssetId, AssetServer, Assets, RenderAssetUsages},
    color::{Color, LinearRgba},
    ecs::{resource::Resource, system::Res, system::ResMut},
    image::{Image, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    log::{warn, warn_once},
    math::{IVec2, UVec2},
    platform::collections::{HashMap, HashSet},
    render::{
        Extract,
        render_asset::{ExtractedAssets, RenderAssets},
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

use core::num::NonZeroU32;

use crate::scene::{
    asset_wait::Arrivals,
    extract::ExtractedScene,
    material::materials::MaterialPool,
    texture::atlas::{Atlas, Copier, Encoding},
    texture::atlas_allocator::{AtlasAllocator, Limits},
    texture::bindless::BindlessTextures,
};
use crate::{gpu_layout::NO_TEXTURE, shader_library::ShaderLibrary};

/// Flags of a slot, from bit 16 of its first word: equal to `shaders/scene/texture.wgsl`.
const CLAMP_U: u32 = 0x10000;
const MIRROR_U: u32 = 0x20000;
const CLAMP_V: u32 = 0x40000;
const MIRROR_V: u32 = 0x80000;
const NEAREST: u32 = 0x100000;
const SRGB: u32 = 0x200000;
const SHARED_EXPONENT: u32 = 0x400000;
/// Set by the material: the texture goes by the second texture coordinates.
pub(crate) const SECOND_UV: u32 = 0x800000;
/// The number of levels.
const LEVELS_SHIFT: u32 = 24;
const TWO_COMPONENTS: u32 = 0x2000_0000;
/// Bound as it is; the low 16 bits are its place in the array.
pub(crate) const BINDLESS: u32 = 0x8000_0000;

/// What is known of an image without its pixels.
#[derive(Clone, Copy)]
struct ImageInfo {
    flags: u32,
    encoding: Encoding,
    /// Mean color, where a material asked for it or nobody can later.
    mean: Option<LinearRgba>,
    /// Changes when the pixels do.
    version: u64,
}

/// The textures of the scene.
#[derive(Resource)]
pub(crate) struct TexturePool {
    info: HashMap<AssetId<Image>, ImageInfo>,
    places: AtlasAllocator,
    /// Images that cannot be read, until they change.
    refused: HashSet<AssetId<Image>>,
    /// Images that a warning named: one is enough, however often they change.
    warned: HashSet<AssetId<Image>>,
    /// A warning said that the atlas holds no more.
    is_full: bool,
    atlas: Option<Atlas>,
    copier: Copier,
    /// Where the device has arrays of textures.
    pub bindless: Option<BindlessTextures>,
    /// Images whose pixels changed since they were placed.
    changed: HashSet<AssetId<Image>>,
    /// Images that nobody loads and that are not there: nothing waits for them.
    absent: HashSet<AssetId<Image>>,
    arrivals: Arrivals,
    versions: u64,
    /// An image was removed that had a slot.
    lost: bool,
    /// All that is wanted is there.
    pub complete: bool,
    /// Counts changes of anything that is shown.
    pub revision: u64,
}

const MAX_PAGE: u32 = 8192;

impl Default for TexturePool {
    fn default() -> Self {
        Self {
            info: HashMap::default(),
            places: AtlasAllocator::default(),
            refused: HashSet::default(),
            warned: HashSet::default(),
            is_full: false,
            atlas: None,
            copier: Copier::default(),
            bindless: None,
            changed: HashSet::default(),
            absent: HashSet::default(),
            arrivals: Arrivals::default(),
            versions: 0,
            lost: false,
            complete: true,
            revision: 0,
        }
    }
}

/// Notes what an image is like while its pixels are still on the CPU.
pub(crate) fn note_images(
    mut pool: ResMut<TexturePool>,
    extracted: Res<ExtractedAssets<GpuImage>>,
    materials: Res<MaterialPool>,
    scene: Res<ExtractedScene>,
) {
    pool.arrivals.begin_frame();
    let glowing = if extracted.extracted.is_empty() { HashSet::default() } else { materials.emissive_images(&scene) };
    for (id, image) in &extracted.extracted {
        let descriptor = match &image.sampler {
            ImageSampler::Default => ImageSamplerDescriptor::linear(),
            ImageSampler::Descriptor(descriptor) => descriptor.clone(),
        };
        pool.versions += 1;
        let version = pool.versions;
        // What Bevy's materials see of it.
        let seen_as = image.texture_view_descriptor.as_ref().and_then(|view| view.format);
        let format = seen_as.unwrap_or(image.texture_descriptor.format);
        let encoding = encoding_of(format);
        let flags = flags_of(&descriptor, format, encoding);
        // It takes its time: of images that stay in the main world only those pay that some material emits.
        let is_asked = glowing.contains(id) || !image.asset_usage.contains(RenderAssetUsages::MAIN_WORLD);
        let mean = is_asked.then(|| mean_color(image));
        let info = ImageInfo { flags, encoding, mean, version };
        pool.info.insert(*id, info);
        pool.changed.insert(*id);
        pool.refused.remove(id);
    }
    for id in &extracted.removed {
        pool.info.remove(id);
        pool.warned.remove(id);
        pool.refused.remove(id);
        let had_slot = pool.forget(*id);
        pool.lost |= had_slot;
    }
}

/// Takes the mean colors of images that are in use and that materials emit from now on.
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

/// Whether the GPU may write an image of this usage at any time, and nobody says when.
pub(crate) fn is_live(usage: TextureUsages) -> bool {
    usage.intersects(TextureUsages::RENDER_ATTACHMENT | TextureUsages::STORAGE_BINDING)
}

fn encoding_of(format: TextureFormat) -> Encoding {
    use TextureFormat as F;
    match format {
        F::R16Float | F::Rg16Float | F::Rgba16Float | F::R32Float | F::Rg32Float | F::Rgba32Float => {
            Encoding::SharedExponent
        }
        F::Rgb9e5Ufloat | F::Rg11b10Ufloat | F::Bc6hRgbUfloat | F::Bc6hRgbFloat => Encoding::SharedExponent,
        F::Astc { channel: AstcChannel::Hdr, .. } => Encoding::SharedExponent,
        format if format.is_srgb() => Encoding::Srgb,
        _ => Encoding::Linear,
    }
}

fn warn_of_lost_bits(format: TextureFormat) {
    use TextureFormat as F;
    if matches!(format, F::R16Unorm | F::Rg16Unorm | F::Rgba16Unorm | F::R16Snorm | F::Rg16Snorm | F::Rgba16Snorm) {
        warn_once!("restir: of 16-bit images like {format:?} eight bits a channel are kept");
    }
}

fn flags_of(sampler: &ImageSamplerDescriptor, format: TextureFormat, encoding: Encoding) -> u32 {
    let axis = |mode, clamp, mirror| match mode {
        ImageAddressMode::Repeat => 0,
        ImageAddressMode::MirrorRepeat => mirror,
        ImageAddressMode::ClampToEdge | ImageAddressMode::ClampToBorder => clamp,
    };
    let nearest = if matches!(sampler.mag_filter, ImageFilterMode::Nearest) { NEAREST } else { 0 };
    let kept = match encoding {
        Encoding::Linear => 0,
        Encoding::Srgb => SRGB,
        Encoding::SharedExponent => SHARED_EXPONENT,
    };
    use TextureFormat::{Bc5RgUnorm, EacRg11Unorm, Rg8Unorm, Rg16Unorm};
    let is_pair = matches!(format, Rg8Unorm | Rg16Unorm | Bc5RgUnorm | EacRg11Unorm);
    let pair = if is_pair { TWO_COMPONENTS } else { 0 };
    let wrap = axis(sampler.address_mode_u, CLAMP_U, MIRROR_U) | axis(sampler.address_mode_v, CLAMP_V, MIRROR_V);
    wrap | nearest | kept | pair
}

/// Mean of up to 128 x 128 texels, white where the format cannot be read here and of what the GPU will write.  It only weighs lights against each other: any
/// positive number leaves the image unbiased, so that a texture whose sampled texels are all black still gets a little.
fn mean_color(image: &Image) -> LinearRgba {
    if is_live(image.texture_descriptor.usage) {
        return LinearRgba::WHITE;
    }
    let size = UVec2::new(image.width(), image.height());
    let step = IVec2::max(IVec2::ONE, (size.as_ivec2() + 127) / 128).as_uvec2();
    let (mut sum, mut count) = ([0.0f64; 3], 0u32);
    for y in (0..size.y).step_by(step.y as usize) {
        for x in (0..size.x).step_by(step.x as usize) {
            let Ok(color) = image.get_color_at(x, y) else {
                return LinearRgba::WHITE;
            };
            let c = Color::to_linear(&color);
            for (s, c) in sum.iter_mut().zip([c.red, c.green, c.blue]) {
                *s += if c.is_finite() { c as f64 } else { 0.0 };
            }
            count += 1;
        }
    }
    let [r, g, b] = sum.map(|s| (s / count.max(1) as f64).max(1e-4) as f32);
    LinearRgba::rgb(r, g, b)
}

impl TexturePool {
    /// A pool of a device that binds so many textures in an array.
    pub(crate) fn binding(capacity: NonZeroU32) -> Self {
        Self { bindless: Some(BindlessTextures::new(capacity)), ..Default::default() }
    }

    /// The slot that a material stores; [`NO_TEXTURE`] while the image is not there.
    pub(crate) fn slot(&self, id: AssetId<Image>) -> [u32; 4] {
        let Some(info) = self.info.get(&id) else { return NO_TEXTURE };
        if let Some(bound) = self.bindless.as_ref().and_then(|bound| bound.get(id)) {
            let [width, height] = bound.size();
            return [BINDLESS | bound.index | info.flags | bound.levels() << LEVELS_SHIFT, 0, width | height << 16, 0];
        }
        let Some(p) = self.places.get(id) else { return NO_TEXTURE };
        let layer = p.layer | info.flags | p.levels() << LEVELS_SHIFT;
        [layer, p.corner.x | p.corner.y << 16, p.size.x | p.size.y << 16, 0]
    }

    /// Mean color, linear.
    pub(crate) fn mean(&self, id: AssetId<Image>) -> LinearRgba {
        self.info.get(&id).and_then(|info| info.mean).unwrap_or(LinearRgba::WHITE)
    }

    /// A number that is another one when the pixels of an image are.
    pub(crate) fn version(&self, id: AssetId<Image>) -> u64 {
        self.info.get(&id).map_or(0, |info| info.version)
    }

    /// Whether an image is still to come.  One that failed to load, or that nobody loads, is not; the first time, a warning says so.
    pub(crate) fn is_coming(&mut self, id: AssetId<Image>, assets: &AssetServer) -> bool {
        let coming = self.info.contains_key(&id) || self.arrivals.is_coming(id, assets);
        if coming {
            self.absent.remove(&id);
        } else if self.absent.insert(id) {
            match assets.get_path(id) {
                Some(path) => warn!("restir: image {path} could not be loaded; it is left out"),
                None => warn!("restir: image {id} does not exist; it is left out"),
            }
        }
        coming
    }

    /// The atlas, once a texture was copied.
    pub(crate) fn view(&self) -> Option<&TextureView> {
        self.atlas.as_ref().map(Atlas::view)
    }

    /// Name and bytes, for the statistics.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        ("texture atlas", self.atlas.as_ref().map_or(0, Atlas::bytes))
    }

    /// Whether the image is where shaders find it.
    fn has(&self, id: AssetId<Image>, image: &GpuImage) -> bool {
        self.places.get(id).is_some() || self.bindless.as_ref().is_some_and(|bound| bound.holds(id, &image.texture))
    }

    /// Takes an image away from shaders; true where it was there.
    fn forget(&mut self, id: AssetId<Image>) -> bool {
        let was_bound = self.bindless.as_mut().is_some_and(|bound| bound.forget(id));
        self.places.forget(id) || was_bound
    }

    /// Binds, or places and copies, the images that are wanted and ready.  True where a slot changed.
    pub(crate) fn update(
        &mut self,
        wanted: impl Iterator<Item = AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        pipelines: &PipelineCache,
        shaders: &ShaderLibrary,
        assets: &AssetServer,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> bool {
        let wanted = self.wanted(wanted, images, assets, device);
        let mut moved = core::mem::take(&mut self.lost);
        self.complete = wanted.iter().all(|id| images.get(*id).is_some_and(|image| self.has(*id, image)));
        let is_new = |id: &AssetId<Image>| {
            images.get(*id).is_some_and(|image| !self.has(*id, image) || self.changed.contains(id))
        };
        let mut new: Vec<_> = wanted.iter().filter(|id| is_new(id)).copied().collect();
        new.sort_unstable();
        moved |= self.refuse_unreadable(&mut new, images, device);
        moved |= self.bind(&mut new, images);
        // What the GPU writes is another picture in every frame.
        let is_live = |id: &AssetId<Image>| images.get(*id).is_some_and(|i| is_live(i.texture_descriptor.usage));
        let live: Vec<_> = wanted.iter().filter(|id| is_live(id) && !self.refused.contains(*id)).copied().collect();
        self.revision += u64::from(!live.is_empty());
        let mut copied: HashSet<_> = live.into_iter().filter(|id| self.places.get(*id).is_some()).collect();
        if new.is_empty() && copied.is_empty() {
            return moved;
        }
        let Some(pipeline) = self.copier.pipeline(pipelines, shaders) else { return moved };
        if !new.is_empty() {
            copied.extend(self.place(&new, &wanted, images, device));
            self.revision += 1;
            moved = true;
        }
        let Some(atlas) = &self.atlas else { return moved };
        let jobs = copied
            .into_iter()
            .filter_map(|id| Some((images.get(id)?, *self.places.get(id)?, self.info.get(&id)?.encoding)));
        self.copier.copy(jobs, atlas, pipeline, pipelines, device, queue);
        moved
    }

    /// Those of some images that are there or coming, and for which there may be a place.
    fn wanted(
        &mut self,
        wanted: impl Iterator<Item = AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        assets: &AssetServer,
        device: &RenderDevice,
    ) -> HashSet<AssetId<Image>> {
        let mut wanted: HashSet<_> = wanted.filter(|id| !self.refused.contains(id)).collect();
        self.places.make_room(&wanted);
        let limit = limits(device).page;
        wanted.retain(|id| match images.get(*id) {
            Some(image) => !self.places.is_left_out(*id, size_in_atlas(image, limit)),
            None => self.is_coming(*id, assets),
        });
        wanted
    }

    /// Takes images off the list that no float texture can be read from.  True where one had a slot.
    fn refuse_unreadable(
        &mut self,
        new: &mut Vec<AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        device: &RenderDevice,
    ) -> bool {
        let is_readable = |id: &AssetId<Image>| {
            images.get(*id).is_some_and(|image| {
                let descriptor = &image.texture_descriptor;
                let kind = descriptor.format.sample_type(None, Some(device.features()));
                descriptor.dimension == TextureDimension::D2
                    && descriptor.sample_count == 1
                    && descriptor.usage.contains(TextureUsages::TEXTURE_BINDING)
                    && matches!(kind, Some(TextureSampleType::Float { .. }))
            })
        };
        let mut moved = false;
        for id in new.extract_if(.., |id| !is_readable(id)) {
            if self.warned.insert(id) {
                warn!("restir: image {id} is no 2D color texture; it is left out");
            }
            self.refused.insert(id);
            moved |= self.forget(id);
        }
        moved
    }

    /// Binds those of some images that have levels of their own and takes them off the list.  True where a slot changed.
    fn bind(&mut self, new: &mut Vec<AssetId<Image>>, images: &RenderAssets<GpuImage>) -> bool {
        let Some(bound) = &mut self.bindless else { return false };
        let before = bound.revision;
        new.retain(|id| {
            let is_bound = images.get(*id).is_some_and(|image| bound.insert(*id, image));
            if is_bound {
                self.places.forget(*id);
                self.changed.remove(id);
            }
            !is_bound
        });
        let changed = bound.revision != before;
        self.revision += u64::from(changed);
        changed
    }

    /// Gives places to images that are new or changed, in an atlas that holds them.  Those that are to be copied.
    fn place(
        &mut self,
        new: &[AssetId<Image>],
        wanted: &HashSet<AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        device: &RenderDevice,
    ) -> Vec<AssetId<Image>> {
        let limits = limits(device);
        let ready = || new.iter().filter_map(|id| Some((*id, images.get(*id)?)));
        for (id, image) in ready() {
            self.changed.remove(&id);
            warn_of_lost_bits(image.texture_descriptor.format);
            if whole_size(image).max_element() > limits.page && self.places.get(id).is_none() && self.warned.insert(id)
            {
                warn!("restir: image {id} is larger than {} pixels; it is scaled down", limits.page);
            }
        }
        let sized = ready().map(|(id, image)| (id, size_in_atlas(image, limits.page))).collect();
        let is_wanted = |id| wanted.contains(&id) && images.get(id).is_some();
        let all_moved = self.places.place(sized, limits, is_wanted);
        if self.places.left_out() > 0 && !self.is_full {
            warn!("restir: more textures than the atlas can hold; {} are left out", self.places.left_out());
            self.is_full = true;
        }
        let [page, layers] = self.places.pages();
        let fits = self.atlas.as_ref().is_some_and(|atlas| atlas.pages() == [page, layers]);
        if !fits && layers > 0 {
            self.atlas = Some(Atlas::new(page, layers, device));
        }
        if all_moved { self.places.images().collect() } else { new.to_vec() }
    }
}

/// The largest pages of the atlas and the most.
fn limits(device: &RenderDevice) -> Limits {
    let limits = device.limits();
    Limits { page: limits.max_texture_dimension_2d.min(MAX_PAGE), layers: limits.max_texture_array_layers }
}

fn whole_size(image: &GpuImage) -> UVec2 {
    UVec2::new(image.texture_descriptor.size.width, image.texture_descriptor.size.height)
}

/// Whole parts of an image that is larger than a page keep the aspect; the copy filters.
fn size_in_atlas(image: &GpuImage, page: u32) -> UVec2 {
    let whole = whole_size(image);
    (whole / whole.max_element().div_ceil(page).max(1)).max(UVec2::ONE)
}
