//! Images → where shaders find their texels (`shaders/scene/texture.wgsl`), in one of two ways; how they are wrapped and filtered is one.
//!
//! **Bound as they are**, where the device has arrays of textures ([`bound`](super::bound)): images that come with levels of their own,
//! as KTX2 files do.  They cost no memory beyond Bevy's own copy, keep their precision, and their author's levels are seen.  Where Bevy
//! writes an edited image over the old one it leaves the coarser levels as they were: such an image goes to the atlas.
//!
//! **In the atlas**, everywhere: images without levels, and on other devices all.  A compute pass reads every format that a float texture
//! can have, compressed ones too, and makes the levels from the finest one by means in linear light: 8-bit RGBA, 5.3 bytes a texel
//! whatever the source; what is kept in floats has an exponent in place of its alpha.  Levels that an image has are not read.

use bevy::{
    asset::{AssetId, AssetServer},
    color::{Color, LinearRgba},
    ecs::{resource::Resource, system::Res, system::ResMut},
    image::{Image, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    log::{warn, warn_once},
    math::{IVec2, UVec2},
    platform::collections::{HashMap, HashSet},
    render::{
        render_asset::{ExtractedAssets, RenderAssets},
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

use core::num::NonZeroU32;

use super::{
    arrivals::Arrivals,
    atlas::{Atlas, Copier, Encoding, Placement, ShelfPacker},
    bound::BoundTextures,
};
use crate::{gpu_types::NO_TEXTURE, shaders::ShaderTable};

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
pub(super) const BOUND: u32 = 0x8000_0000;

/// What is known of an image without its pixels.
#[derive(Clone, Copy)]
struct ImageInfo {
    flags: u32,
    encoding: Encoding,
    mean: LinearRgba,
    /// Changes when the pixels do.
    version: u64,
}

/// The textures of the scene.
#[derive(Resource)]
pub(crate) struct TexturePool {
    info: HashMap<AssetId<Image>, ImageInfo>,
    placed: HashMap<AssetId<Image>, Placement>,
    refused: HashSet<AssetId<Image>>,
    packer: ShelfPacker,
    atlas: Option<Atlas>,
    copier: Copier,
    /// Where the device has arrays of textures.
    pub bound: Option<BoundTextures>,
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
            placed: HashMap::default(),
            refused: HashSet::default(),
            packer: ShelfPacker::default(),
            atlas: None,
            copier: Copier::default(),
            bound: None,
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
pub(crate) fn note_images(mut pool: ResMut<TexturePool>, extracted: Res<ExtractedAssets<GpuImage>>) {
    pool.arrivals.begin_frame();
    for (id, image) in &extracted.extracted {
        let descriptor = match &image.sampler {
            ImageSampler::Default => ImageSamplerDescriptor::linear(),
            ImageSampler::Descriptor(descriptor) => descriptor.clone(),
        };
        pool.versions += 1;
        let version = pool.versions;
        let encoding = encoding_of(image.texture_descriptor.format);
        let flags = flags_of(&descriptor, image.texture_descriptor.format, encoding);
        let info = ImageInfo { flags, encoding, mean: mean_color(image), version };
        pool.info.insert(*id, info);
        pool.changed.insert(*id);
        pool.refused.remove(id);
    }
    for id in &extracted.removed {
        pool.info.remove(id);
        let had_slot = pool.forget(*id);
        pool.lost |= had_slot;
    }
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

/// Mean of up to 128 x 128 texels, white where the format cannot be read here.  It only weighs lights against each other: any
/// positive number leaves the image unbiased, so that a texture whose sampled texels are all black still gets a little.
fn mean_color(image: &Image) -> LinearRgba {
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
        Self { bound: Some(BoundTextures::new(capacity)), ..Default::default() }
    }

    /// The slot that a material stores; [`NO_TEXTURE`] while the image is not there.
    pub(crate) fn slot(&self, id: AssetId<Image>) -> [u32; 4] {
        let Some(info) = self.info.get(&id) else { return NO_TEXTURE };
        if let Some(bound) = self.bound.as_ref().and_then(|bound| bound.get(id)) {
            let [width, height] = bound.size();
            return [BOUND | bound.index | info.flags | bound.levels() << LEVELS_SHIFT, 0, width | height << 16, 0];
        }
        let Some(p) = self.placed.get(&id) else { return NO_TEXTURE };
        let layer = p.layer | info.flags | p.levels() << LEVELS_SHIFT;
        [layer, p.corner.x | p.corner.y << 16, p.size.x | p.size.y << 16, 0]
    }

    /// Mean colour, linear.
    pub(crate) fn mean(&self, id: AssetId<Image>) -> LinearRgba {
        self.info.get(&id).map_or(LinearRgba::WHITE, |info| info.mean)
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
        self.placed.contains_key(&id) || self.bound.as_ref().is_some_and(|bound| bound.holds(id, &image.texture))
    }

    /// Takes an image away from shaders; true where it was there.
    fn forget(&mut self, id: AssetId<Image>) -> bool {
        let was_bound = self.bound.as_mut().is_some_and(|bound| bound.forget(id));
        self.placed.remove(&id).is_some() || was_bound
    }

    /// Binds those of some images that have levels of their own and takes them off the list.  True where a slot changed.
    fn bind(&mut self, new: &mut Vec<AssetId<Image>>, images: &RenderAssets<GpuImage>) -> bool {
        let Some(bound) = &mut self.bound else { return false };
        let before = bound.revision;
        new.retain(|id| {
            let is_bound = images.get(*id).is_some_and(|image| bound.insert(*id, &image.texture));
            if is_bound {
                self.placed.remove(id);
                self.changed.remove(id);
            }
            !is_bound
        });
        let changed = bound.revision != before;
        self.revision += u64::from(changed);
        changed
    }

    /// Binds, or places and copies, the images that are wanted and ready.  True where a slot changed.
    pub(crate) fn update(
        &mut self,
        wanted: impl Iterator<Item = AssetId<Image>>,
        images: &RenderAssets<GpuImage>,
        pipelines: &PipelineCache,
        shaders: &ShaderTable,
        assets: &AssetServer,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> bool {
        let mut wanted: HashSet<_> = wanted.filter(|id| !self.refused.contains(id)).collect();
        wanted.retain(|id| images.get(*id).is_some() || self.is_coming(*id, assets));
        let mut moved = core::mem::take(&mut self.lost);
        let ready = |id: &AssetId<Image>| images.get(*id).is_some();
        self.complete = wanted.iter().all(|id| images.get(*id).is_some_and(|image| self.has(*id, image)));
        let is_new = |id: &AssetId<Image>| {
            images.get(*id).is_some_and(|image| !self.has(*id, image) || self.changed.contains(id))
        };
        let mut new: Vec<_> = wanted.iter().filter(|id| is_new(id)).copied().collect();
        if new.is_empty() {
            return moved;
        }
        new.sort_unstable();

        // Images that no float texture can be read from.
        let is_readable = |id: &AssetId<Image>| {
            images.get(*id).is_some_and(|image| {
                let descriptor = &image.texture_descriptor;
                let kind = descriptor.format.sample_type(None, Some(device.features()));
                descriptor.dimension == TextureDimension::D2 && matches!(kind, Some(TextureSampleType::Float { .. }))
            })
        };
        for id in new.extract_if(.., |id| !is_readable(id)) {
            warn!("restir: image {id} is no 2D colour texture; it is left out");
            self.refused.insert(id);
            moved |= self.forget(id);
        }
        moved |= self.bind(&mut new, images);
        if new.is_empty() {
            return moved;
        }
        let Some(pipeline) = self.copier.pipeline(pipelines, shaders) else { return moved };

        let limit = device.limits().max_texture_dimension_2d.min(MAX_PAGE);
        let whole = |id: &AssetId<Image>| {
            images
                .get(*id)
                .map_or(UVec2::ONE, |i| UVec2::new(i.texture_descriptor.size.width, i.texture_descriptor.size.height))
        };
        // Whole parts keep the aspect; the copy filters.
        let size_of = |id: &AssetId<Image>| whole(id) / whole(id).max_element().div_ceil(limit).max(1);
        for id in new.iter().filter(|id| whole(id).max_element() > limit && !self.placed.contains_key(*id)) {
            warn!("restir: image {id} is larger than {limit} pixels; it is scaled down");
        }

        // A larger page moves everything.
        let largest = new.iter().map(|id| size_of(id).max_element()).max().unwrap_or(1);
        let page = largest.next_power_of_two().max(256).min(limit.max(largest));
        if page > self.packer.page {
            new = self.placed.drain().map(|(id, _)| id).filter(ready).chain(new).collect();
            new.sort_unstable();
            new.dedup();
            self.packer = ShelfPacker::of_page(page);
            self.atlas = None;
        }
        for id in &new {
            let size = size_of(id).max(UVec2::ONE);
            if self.placed.get(id).is_none_or(|p| p.size != size) {
                let placement = self.packer.place(size);
                self.placed.insert(*id, placement);
            }
            self.changed.remove(id);
            if let Some(image) = images.get(*id) {
                warn_of_lost_bits(image.texture_descriptor.format);
            }
        }
        if self.packer.pages > device.limits().max_texture_array_layers {
            warn!("restir: more textures than the atlas can hold; those of this scene are left out");
            self.refused.extend(new.iter().copied());
            for id in &new {
                self.placed.remove(id);
            }
            return true;
        }

        // More pages than the atlas has: a new one, and everything is copied again.
        if self.atlas.as_ref().is_none_or(|a| a.layers() < self.packer.pages) {
            self.atlas = Some(Atlas::new(self.packer.page, self.packer.pages, device));
            new = self.placed.keys().copied().filter(ready).collect();
        }
        let Some(atlas) = &self.atlas else { return false };
        let jobs = new
            .iter()
            .filter_map(|id| Some((&images.get(*id)?.texture, *self.placed.get(id)?, self.info.get(id)?.encoding)));
        self.copier.copy(jobs, atlas, pipeline, pipelines, device, queue);
        self.revision += 1;
        true
    }
}
