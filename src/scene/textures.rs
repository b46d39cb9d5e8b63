//! Images → one array of atlas pages (`shaders/scene/texture.wgsl`): every format that a float texture can have, compressed ones
//! too, is read by a compute pass, so that neither the CPU's copy of the pixels nor binding arrays are needed.
//!
//! The portable tier: 8-bit RGBA, full resolution, no mip chain (level of detail is a later issue).

use bevy::{
    asset::{AssetId, AssetServer},
    color::{Color, LinearRgba},
    ecs::{resource::Resource, system::Res, system::ResMut},
    image::{Image, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    log::warn,
    math::{IVec2, UVec2},
    platform::collections::{HashMap, HashSet},
    render::{
        render_asset::{ExtractedAssets, RenderAssets},
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

use crate::{gpu_types::NO_TEXTURE, shaders::ShaderTable};

/// Flags of a slot, from bit 16 of its first word: equal to `shaders/scene/texture.wgsl`.
const CLAMP_U: u32 = 0x10000;
const MIRROR_U: u32 = 0x20000;
const CLAMP_V: u32 = 0x40000;
const MIRROR_V: u32 = 0x80000;
const NEAREST: u32 = 0x100000;

/// What is known of an image without its pixels.
#[derive(Clone, Copy)]
struct ImageInfo {
    flags: u32,
    mean: LinearRgba,
    two_components: bool,
    /// Changes when the pixels do.
    version: u64,
}

/// Where a texture lies.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Placement {
    layer: u32,
    corner: UVec2,
    size: UVec2,
}

/// Rows of rectangles of one height, in square pages.
#[derive(Default)]
struct ShelfPacker {
    page: u32,
    pages: u32,
    /// (page, top, height, first free column)
    shelves: Vec<(u32, u32, u32, u32)>,
    /// First free row of every page.
    free_row: Vec<u32>,
}

impl ShelfPacker {
    fn place(&mut self, size: UVec2) -> Placement {
        for (page, top, height, column) in &mut self.shelves {
            if *height >= size.y && *height <= size.y * 2 && *column + size.x <= self.page {
                let corner = UVec2::new(*column, *top);
                *column += size.x;
                return Placement { layer: *page, corner, size };
            }
        }
        let page = (0..self.pages).find(|&p| self.free_row[p as usize] + size.y <= self.page).unwrap_or_else(|| {
            self.pages += 1;
            self.free_row.push(0);
            self.pages - 1
        });
        let top = self.free_row[page as usize];
        self.free_row[page as usize] += size.y;
        self.shelves.push((page, top, size.y, size.x));
        Placement { layer: page, corner: UVec2::new(0, top), size }
    }
}

/// The textures of the scene.
#[derive(Resource)]
pub(crate) struct TexturePool {
    info: HashMap<AssetId<Image>, ImageInfo>,
    placed: HashMap<AssetId<Image>, Placement>,
    refused: HashSet<AssetId<Image>>,
    packer: ShelfPacker,
    atlas: Option<Texture>,
    atlas_view: Option<TextureView>,
    pipeline: Option<CachedComputePipelineId>,
    layout: BindGroupLayoutDescriptor,
    /// Images whose pixels changed since they were copied.
    changed: HashSet<AssetId<Image>>,
    /// Images that nobody loads and that are not there: nothing waits for them.
    absent: HashSet<AssetId<Image>>,
    versions: u64,
    /// All that is wanted is there.
    pub complete: bool,
    /// Counts changes of anything that is shown.
    pub revision: u64,
}

const FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;
const MAX_PAGE: u32 = 8192;

impl Default for TexturePool {
    fn default() -> Self {
        Self {
            info: HashMap::default(),
            placed: HashMap::default(),
            refused: HashSet::default(),
            packer: ShelfPacker::default(),
            atlas: None,
            atlas_view: None,
            pipeline: None,
            layout: BindGroupLayoutDescriptor::new(
                "restir atlas copy",
                &BindGroupLayoutEntries::sequential(
                    ShaderStages::COMPUTE,
                    (
                        uniform_buffer_sized(false, None),
                        texture_2d(TextureSampleType::Float { filterable: false }),
                        texture_storage_2d_array(FORMAT, StorageTextureAccess::WriteOnly),
                    ),
                ),
            ),
            changed: HashSet::default(),
            absent: HashSet::default(),
            versions: 0,
            complete: true,
            revision: 0,
        }
    }
}

/// Where a copy goes: `Copy` in `shaders/pass/atlas.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct GpuCopy {
    corner: [u32; 2],
    size: [u32; 2],
    layer: u32,
    encode_srgb: u32,
    pad: [u32; 2],
}

/// Notes what an image is like while its pixels are still on the CPU.
pub(crate) fn note_images(mut pool: ResMut<TexturePool>, extracted: Res<ExtractedAssets<GpuImage>>) {
    for (id, image) in &extracted.extracted {
        let descriptor = match &image.sampler {
            ImageSampler::Default => ImageSamplerDescriptor::linear(),
            ImageSampler::Descriptor(descriptor) => descriptor.clone(),
        };
        let two_components = matches!(
            image.texture_descriptor.format,
            TextureFormat::Rg8Unorm | TextureFormat::Rg16Unorm | TextureFormat::Bc5RgUnorm | TextureFormat::EacRg11Unorm
        );
        pool.versions += 1;
        let version = pool.versions;
        let info = ImageInfo { flags: flags_of(&descriptor), mean: mean_color(image), two_components, version };
        pool.info.insert(*id, info);
        pool.changed.insert(*id);
        pool.refused.remove(id);
    }
    for id in &extracted.removed {
        pool.info.remove(id);
        pool.placed.remove(id);
    }
}

fn flags_of(sampler: &ImageSamplerDescriptor) -> u32 {
    let axis = |mode, clamp, mirror| match mode {
        ImageAddressMode::Repeat => 0,
        ImageAddressMode::MirrorRepeat => mirror,
        ImageAddressMode::ClampToEdge | ImageAddressMode::ClampToBorder => clamp,
    };
    let nearest = if matches!(sampler.mag_filter, ImageFilterMode::Nearest) { NEAREST } else { 0 };
    axis(sampler.address_mode_u, CLAMP_U, MIRROR_U) | axis(sampler.address_mode_v, CLAMP_V, MIRROR_V) | nearest
}

/// Mean of up to 128 x 128 texels, white where the format cannot be read here.  It only weighs lights against each other: any
/// positive number leaves the image unbiased, so that a texture whose sampled texels are all black still gets a little.
fn mean_color(image: &Image) -> LinearRgba {
    let size = UVec2::new(image.width(), image.height());
    let step = IVec2::max(IVec2::ONE, (size.as_ivec2() + 127) / 128).as_uvec2();
    let (mut sum, mut count) = ([0.0f64; 3], 0u32);
    for y in (0..size.y).step_by(step.y as usize) {
        for x in (0..size.x).step_by(step.x as usize) {
            let Ok(color) = image.get_color_at(x, y) else { return LinearRgba::WHITE };
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
    /// The slot that a material stores; [`NO_TEXTURE`] while the image is not there.
    pub fn slot(&self, id: AssetId<Image>) -> [u32; 4] {
        match (self.placed.get(&id), self.info.get(&id)) {
            (Some(p), Some(info)) => {
                [p.layer | info.flags, p.corner.x | p.corner.y << 16, p.size.x | p.size.y << 16, 0]
            }
            _ => NO_TEXTURE,
        }
    }

    /// Mean colour, linear.
    pub fn mean(&self, id: AssetId<Image>) -> LinearRgba {
        self.info.get(&id).map_or(LinearRgba::WHITE, |info| info.mean)
    }

    /// The image holds two components: the third of a normal is theirs to give.
    pub fn has_two_components(&self, id: AssetId<Image>) -> bool {
        self.info.get(&id).is_some_and(|info| info.two_components)
    }

    /// A number that is another one when the pixels of an image are.
    pub fn version(&self, id: AssetId<Image>) -> u64 {
        self.info.get(&id).map_or(0, |info| info.version)
    }

    /// Whether an image is still to come.  One that failed to load, or that nobody loads, is not; the first time, a warning says so.
    pub fn is_coming(&mut self, id: AssetId<Image>, assets: &AssetServer) -> bool {
        let coming = self.info.contains_key(&id) || assets.load_state(id).is_loading();
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
    pub fn view(&self) -> Option<&TextureView> {
        self.atlas_view.as_ref()
    }

    /// Name and bytes, for the statistics.
    pub fn memory(&self) -> (&'static str, u64) {
        let bytes = self.atlas.as_ref().map_or(0, |a| a.width() as u64 * a.height() as u64 * 4 * layers(a) as u64);
        ("texture atlas", bytes)
    }

    /// Places and copies the images that are wanted and ready.  True where a slot changed.
    #[expect(clippy::too_many_arguments, reason = "one call site; each is a resource of the caller's system")]
    pub fn update(
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
        if wanted.is_empty() {
            self.complete = true;
            return false;
        }
        let id = *self.pipeline.get_or_insert_with(|| {
            pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some("restir atlas copy".into()),
                layout: vec![self.layout.clone()],
                shader: shaders.pass("pass/atlas.wgsl"),
                entry_point: Some("copy".into()),
                ..Default::default()
            })
        });
        let ready = |id: &AssetId<Image>| images.get(*id).is_some();
        self.complete = wanted.iter().all(|id| ready(id) && self.placed.contains_key(id));
        let mut new: Vec<_> = wanted
            .iter()
            .filter(|id| ready(id) && (!self.placed.contains_key(*id) || self.changed.contains(*id)))
            .copied()
            .collect();
        let Some(pipeline) = pipelines.get_compute_pipeline(id) else { return false };
        if new.is_empty() {
            return false;
        }
        new.sort_unstable();

        // Images that no float texture can be read from.
        new.retain(|id| {
            let readable = images.get(*id).is_some_and(|i| {
                i.texture_descriptor.dimension == TextureDimension::D2
                    && matches!(
                        i.texture_descriptor.format.sample_type(None, Some(device.features())),
                        Some(TextureSampleType::Float { .. })
                    )
            });
            if !readable {
                warn!("restir: image {id} is no 2D colour texture; it is left out");
                self.refused.insert(*id);
            }
            readable
        });

        let limit = device.limits().max_texture_dimension_2d.min(MAX_PAGE);
        let size_of = |id: &AssetId<Image>| {
            let size = images.get(*id).map_or(UVec2::ONE, |i| {
                UVec2::new(i.texture_descriptor.size.width, i.texture_descriptor.size.height)
            });
            if size.max_element() > limit {
                warn!("restir: image {id} is larger than {limit} pixels; it is scaled down");
            }
            // Halving keeps the aspect; the copy filters.
            size / (size.max_element().div_ceil(limit)).max(1)
        };

        // A larger page moves everything.
        let largest = new.iter().map(|id| size_of(id).max_element()).max().unwrap_or(1);
        let page = largest.next_power_of_two().max(256).min(limit.max(largest));
        if page > self.packer.page {
            new = self.placed.drain().map(|(id, _)| id).filter(ready).chain(new).collect();
            new.sort_unstable();
            new.dedup();
            self.packer = ShelfPacker { page, ..Default::default() };
            self.atlas = None;
        }
        for id in &new {
            let size = size_of(id).max(UVec2::ONE);
            if self.placed.get(id).is_none_or(|p| p.size != size) {
                let placement = self.packer.place(size);
                self.placed.insert(*id, placement);
            }
            self.changed.remove(id);
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
        if self.atlas.as_ref().is_none_or(|a| layers(a) < self.packer.pages) {
            let atlas = device.create_texture(&TextureDescriptor {
                label: Some("texture atlas"),
                size: Extent3d { width: page_size(&self.packer), height: page_size(&self.packer), depth_or_array_layers: self.packer.pages },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: FORMAT,
                usage: TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING,
                view_formats: &[],
            });
            self.atlas_view = Some(atlas.create_view(&TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2Array),
                ..Default::default()
            }));
            self.atlas = Some(atlas);
            new = self.placed.keys().copied().filter(ready).collect();
        }
        let Some(target) = &self.atlas_view else { return false };

        let layout = pipelines.get_bind_group_layout(&self.layout);
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir atlas") });
        for id in new {
            let (Some(image), Some(place)) = (images.get(id), self.placed.get(&id)) else { continue };
            let source = image.texture.create_view(&TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2),
                mip_level_count: Some(1),
                array_layer_count: Some(1),
                ..Default::default()
            });
            let copy = GpuCopy {
                corner: place.corner.to_array(),
                size: place.size.to_array(),
                layer: place.layer,
                encode_srgb: image.texture_descriptor.format.is_srgb() as u32,
                pad: [0; 2],
            };
            let parameters = device.create_buffer_with_data(&BufferInitDescriptor {
                label: Some("restir atlas copy"),
                contents: bytemuck::bytes_of(&copy),
                usage: BufferUsages::UNIFORM,
            });
            let bind_group = device.create_bind_group(
                "restir atlas copy",
                &layout,
                &BindGroupEntries::sequential((parameters.as_entire_binding(), &source, target)),
            );
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &bind_group, &[]);
            pass.dispatch_workgroups(place.size.x.div_ceil(8), place.size.y.div_ceil(8), 1);
        }
        queue.submit([encoder.finish()]);
        self.revision += 1;
        true
    }
}

fn page_size(packer: &ShelfPacker) -> u32 {
    packer.page
}

fn layers(texture: &Texture) -> u32 {
    texture.depth_or_array_layers()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placements_never_overlap() {
        let mut packer = ShelfPacker { page: 256, ..Default::default() };
        let sizes = [64, 128, 17, 256, 30, 31, 200, 64, 100, 5];
        let placed: Vec<_> =
            sizes.iter().flat_map(|&w| sizes.iter().map(move |&h| UVec2::new(w, h))).map(|s| packer.place(s)).collect();
        for (i, a) in placed.iter().enumerate() {
            assert!((a.corner + a.size).max_element() <= 256);
            for b in &placed[..i] {
                let apart = a.corner.cmpge(b.corner + b.size).any() || b.corner.cmpge(a.corner + a.size).any();
                assert!(a.layer != b.layer || apart, "{a:?} {b:?}");
            }
        }
    }
}
