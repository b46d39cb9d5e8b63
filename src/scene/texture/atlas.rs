//! The texture atlas on the GPU: pages of 8-bit RGBA with mip levels, a packer that places rectangles in them, and the copies that fill them
//! (`shaders/pass/atlas.wgsl`).

use bevy::{
    math::UVec2,
    render::{
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

pub(crate) const FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

/// Rectangle of a texture in the atlas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    pub layer: u32,
    pub corner: UVec2,
    pub size: UVec2,
}

impl Placement {
    /// Number of mip levels: the coarsest one has one texel on the shorter side.  Halving corners and sizes, rounded down, keeps disjoint
    /// rectangles disjoint.
    pub(crate) fn levels(&self) -> u32 {
        self.size.min_element().max(1).ilog2() + 1
    }

    fn at_level(&self, level: u32) -> Self {
        let size = UVec2::max(self.size >> UVec2::splat(level), UVec2::ONE);
        Self { corner: self.corner >> UVec2::splat(level), size, ..*self }
    }
}

/// Packs rectangles into square pages, in shelves: rows of rectangles of similar height.  It cannot free a rectangle.
#[derive(Clone, Default)]
pub(crate) struct ShelfPacker {
    /// Side length of a page, texels.
    pub page: u32,
    /// Number of pages in use.
    pub pages: u32,
    /// Texels of all placed rectangles.
    pub placed_texels: u64,
    /// (page, top, height, first free column)
    shelves: Vec<(u32, u32, u32, u32)>,
    /// First free row of every page.
    free_row: Vec<u32>,
}

impl ShelfPacker {
    pub(crate) fn with_page_size(page: u32) -> Self {
        Self { page, ..Default::default() }
    }

    /// Places a rectangle in one of `max_pages` pages; `None` if there is no space.
    pub(crate) fn place(&mut self, size: UVec2, max_pages: u32) -> Option<Placement> {
        let placement = self.place_on_shelf(size).or_else(|| self.place_on_new_shelf(size, max_pages))?;
        self.placed_texels += u64::from(size.x) * u64::from(size.y);
        Some(placement)
    }

    fn place_on_shelf(&mut self, size: UVec2) -> Option<Placement> {
        let (page, top, _, column) = self.shelves.iter_mut().find(|(_, _, height, column)| {
            *height >= size.y && *height <= size.y * 2 && *column + size.x <= self.page
        })?;
        let corner = UVec2::new(*column, *top);
        *column += size.x;
        Some(Placement { layer: *page, corner, size })
    }

    fn place_on_new_shelf(&mut self, size: UVec2, max_pages: u32) -> Option<Placement> {
        if size.max_element() > self.page {
            return None;
        }
        let open_page = (0..self.pages).find(|&p| self.free_row[p as usize] + size.y <= self.page);
        if open_page.is_none() && self.pages >= max_pages {
            return None;
        }
        let page = open_page.unwrap_or_else(|| {
            self.pages += 1;
            self.free_row.push(0);
            self.pages - 1
        });
        let top = self.free_row[page as usize];
        self.free_row[page as usize] += size.y;
        self.shelves.push((page, top, size.y, size.x));
        Some(Placement { layer: page, corner: UVec2::new(0, top), size })
    }
}

/// Encoding of a texel's color in 8 bits per channel: `ENCODING_*` in `shaders/common/texel.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Linear = 0,
    Srgb = 1,
    /// Three mantissas and, in place of alpha, their common exponent, for values above 1.
    SharedExponent = 2,
}

/// Source and target of a copy: `Copy` in `shaders/pass/atlas.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub struct GpuCopy {
    pub source_corner: [u32; 2],
    pub source_size: [u32; 2],
    pub corner: [u32; 2],
    pub size: [u32; 2],
    pub layer: u32,
    pub decode: u32,
    pub encode: u32,
    pub pad: u32,
}

/// The pages on the GPU.
pub(crate) struct Atlas {
    texture: Texture,
    view: TextureView,
    /// Write views of the mip levels.
    targets: Vec<TextureView>,
}

impl Atlas {
    pub(crate) fn new(page: u32, pages: u32, device: &RenderDevice) -> Self {
        let levels = page.max(1).ilog2() + 1;
        let texture = device.create_texture(&TextureDescriptor {
            label: Some("texture atlas"),
            size: Extent3d { width: page, height: page, depth_or_array_layers: pages },
            mip_level_count: levels,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: FORMAT,
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        let view = |base_mip_level: u32, mip_level_count: Option<u32>| {
            texture.create_view(&TextureViewDescriptor {
                dimension: Some(TextureViewDimension::D2Array),
                base_mip_level,
                mip_level_count,
                ..Default::default()
            })
        };
        Self { view: view(0, None), targets: (0..levels).map(|level| view(level, Some(1))).collect(), texture }
    }

    pub(crate) fn view(&self) -> &TextureView {
        &self.view
    }

    /// Side length and number of the pages.
    pub(crate) fn pages(&self) -> [u32; 2] {
        [self.texture.width(), self.texture.depth_or_array_layers()]
    }

    pub(crate) fn bytes(&self) -> u64 {
        let side = |level: u32| (self.texture.width() >> level).max(1) as u64;
        (0..self.texture.mip_level_count()).map(|level| side(level).pow(2) * 4).sum::<u64>() * self.pages()[1] as u64
    }
}

/// Copies images into the atlas.
pub(crate) struct Copier {
    layout: BindGroupLayoutDescriptor,
    pipeline: Option<CachedComputePipelineId>,
}

impl Default for Copier {
    fn default() -> Self {
        Self {
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
            pipeline: None,
        }
    }
}

impl Copier {
    /// The pipeline, once it is compiled.
    pub(crate) fn pipeline<'a>(
        &mut self,
        pipelines: &'a PipelineCache,
        shaders: &crate::shader_library::ShaderLibrary,
    ) -> Option<&'a ComputePipeline> {
        let id = *self.pipeline.get_or_insert_with(|| {
            pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some("restir atlas copy".into()),
                layout: vec![self.layout.clone()],
                shader: shaders.pass("pass/atlas.wgsl", &[]),
                entry_point: Some("copy".into()),
                ..Default::default()
            })
        });
        pipelines.get_compute_pipeline(id)
    }

    /// Copies images to their rectangles, and fills each further mip level from the next finer one.
    pub(crate) fn copy<'a>(
        &self,
        images: impl Iterator<Item = (&'a GpuImage, Placement, Encoding)>,
        atlas: &Atlas,
        pipeline: &ComputePipeline,
        pipelines: &PipelineCache,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        let layout = pipelines.get_bind_group_layout(&self.layout);
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir atlas") });
        for (image, placement, encoding) in images {
            for level in 0..placement.levels() {
                let to = placement.at_level(level);
                let (texture, format, base_mip_level, base_array_layer, from, decode) = match level.checked_sub(1) {
                    None => {
                        let size = UVec2::new(image.texture.width(), image.texture.height());
                        let whole = Placement { layer: 0, corner: UVec2::ZERO, size };
                        // A view of an sRGB format returns linear values.
                        (&image.texture, image.view_format(), 0, 0, whole, Encoding::Linear)
                    }
                    Some(finer) => {
                        (&atlas.texture, FORMAT, finer, placement.layer, placement.at_level(finer), encoding)
                    }
                };
                let source = texture.create_view(&TextureViewDescriptor {
                    format: Some(format),
                    dimension: Some(TextureViewDimension::D2),
                    base_mip_level,
                    mip_level_count: Some(1),
                    base_array_layer,
                    array_layer_count: Some(1),
                    ..Default::default()
                });
                let copy = GpuCopy {
                    source_corner: from.corner.to_array(),
                    source_size: from.size.to_array(),
                    corner: to.corner.to_array(),
                    size: to.size.to_array(),
                    layer: to.layer,
                    decode: decode as u32,
                    encode: encoding as u32,
                    pad: 0,
                };
                let parameters = device.create_buffer_with_data(&BufferInitDescriptor {
                    label: Some("restir atlas copy"),
                    contents: bytemuck::bytes_of(&copy),
                    usage: BufferUsages::UNIFORM,
                });
                let target = &atlas.targets[level as usize];
                let bind_group = device.create_bind_group(
                    "restir atlas copy",
                    &layout,
                    &BindGroupEntries::sequential((parameters.as_entire_binding(), &source, target)),
                );
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bind_group, &[]);
                pass.dispatch_workgroups(to.size.x.div_ceil(8), to.size.y.div_ceil(8), 1);
            }
        }
        queue.submit([encoder.finish()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placements_never_overlap_at_any_level() {
        let mut packer = ShelfPacker::with_page_size(256);
        let sizes = [64, 128, 17, 256, 30, 31, 200, 64, 100, 5];
        let all = sizes.iter().flat_map(|&w| sizes.iter().map(move |&h| UVec2::new(w, h)));
        let placed: Vec<_> = all.filter_map(|s| packer.place(s, 100)).collect();
        assert_eq!(placed.len(), 100);
        for (i, a) in placed.iter().enumerate() {
            for b in &placed[..i] {
                for level in 0..a.levels().min(b.levels()) {
                    let (a, b) = (a.at_level(level), b.at_level(level));
                    let apart = a.corner.cmpge(b.corner + b.size).any() || b.corner.cmpge(a.corner + a.size).any();
                    assert!(a.layer != b.layer || apart, "{a:?} {b:?} {level}");
                }
            }
            for level in 0..a.levels() {
                assert!((a.at_level(level).corner + a.at_level(level).size).max_element() <= 256 >> level);
            }
        }
    }
}
