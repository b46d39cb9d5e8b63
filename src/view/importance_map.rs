//! Importance of an environment image: a mip chain by which shaders sample directions, and the passes that fill it
//! (`shaders/pass/environment.wgsl`).

use bevy::render::{
    render_resource::{binding_types::*, *},
    renderer::{RenderDevice, RenderQueue},
    texture::GpuImage,
};

use super::mipmapped_texture;
use crate::{
    scene::{SceneFeatures, texture::image_info::is_live},
    shader_library::ShaderLibrary,
};

/// Least and greatest width of the finest level; the height is half of it.
const WIDTHS: [u32; 2] = [1024, 4096];

/// An environment image and its mip chain of importance.
pub(super) struct ImportanceMap {
    /// Texture that the map views.
    pub texture: TextureId,
    pub map: TextureView,
    pub importance: TextureView,
    /// Width of the finest level, in cells.
    width: u32,
    /// Group 1 of the passes.
    map_group: BindGroup,
    /// Group 2 for each level.
    level_groups: Vec<BindGroup>,
}

impl ImportanceMap {
    pub(super) fn new(image: &GpuImage, layouts: &[BindGroupLayout; 3], device: &RenderDevice) -> Self {
        let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING;
        let width = width_of(image, device);
        let levels = levels_of(width);
        let size = Extent3d { width, height: width / 2, depth_or_array_layers: 1 };
        let format = TextureFormat::R32Float;
        let chain = mipmapped_texture(device, "environment importance", size, levels, format, usage);
        let level = |mip| {
            chain.create_view(&TextureViewDescriptor {
                base_mip_level: mip,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        let map = image.texture.create_view(&TextureViewDescriptor {
            format: Some(image.view_format()),
            dimension: Some(TextureViewDimension::D2Array),
            mip_level_count: Some(1),
            ..Default::default()
        });
        let level_group = |mip| {
            // The finest level reads only the map.  The binding of a finer level must not be empty, so it gets the coarsest level.
            let (source, target) = (level(if mip == 0 { levels - 1 } else { mip - 1 }), level(mip));
            let views = BindGroupEntries::sequential((&source, &target));
            device.create_bind_group("restir environment importance", &layouts[2], &views)
        };
        let maps = BindGroupEntries::with_indices(((2, &map),));
        Self {
            texture: image.texture.id(),
            importance: chain.create_view(&TextureViewDescriptor::default()),
            map_group: device.create_bind_group("restir environment map", &layouts[1], &maps),
            level_groups: (0..levels).map(level_group).collect(),
            width,
            map,
        }
    }

    /// Fills the mip chain: the finest level from the image, each other level from the next finer one.
    pub(super) fn fill(
        &self,
        [importance, reduce]: [&ComputePipeline; 2],
        layouts: &[BindGroupLayout; 3],
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        let nothing = device.create_bind_group("restir nothing", &layouts[0], &[]);
        let mut encoder =
            device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir environment importance") });
        for (mip, level_group) in self.level_groups.iter().enumerate() {
            let [width, height] = level_size(self.width, mip as u32);
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_pipeline(if mip == 0 { importance } else { reduce });
            pass.set_bind_group(0, &nothing, &[]);
            pass.set_bind_group(1, &self.map_group, &[]);
            pass.set_bind_group(2, level_group, &[]);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        }
        queue.submit([encoder.finish()]);
    }

    /// Bytes of the mip chain.
    pub(super) fn bytes(&self) -> u64 {
        let texels = |mip| level_size(self.width, mip).into_iter().map(u64::from).product::<u64>();
        (0..levels_of(self.width)).map(|mip| texels(mip) * 4).sum()
    }
}

/// Width of the finest level: cells are as small as the pixels of the image, so that a small sun is sampled apart from the sky around it.
/// An image that the GPU can write has the least width, because its map is filled in every frame.
fn width_of(image: &GpuImage, device: &RenderDevice) -> u32 {
    let descriptor = &image.texture_descriptor;
    if is_live(descriptor.usage) {
        return WIDTHS[0];
    }
    // Four faces of a cube surround the viewer.
    let faces = if descriptor.size.depth_or_array_layers == 6 { 4 } else { 1 };
    let greatest = WIDTHS[1].min(device.limits().max_texture_dimension_2d);
    width_for(faces * descriptor.size.width, greatest)
}

/// A power of two, at least the width of the image if the device allows it.
fn width_for(image_width: u32, greatest: u32) -> u32 {
    let power_below = 1 << greatest.ilog2();
    image_width.min(power_below).next_power_of_two().max(WIDTHS[0])
}

fn levels_of(width: u32) -> u32 {
    width.ilog2() + 1
}

fn level_size(width: u32, mip: u32) -> [u32; 2] {
    [width, width / 2].map(|side| (side >> mip).max(1))
}

/// The passes that fill importance maps.
pub(super) struct ImportancePasses {
    /// For equirectangular images and for cubes: the pipeline of the finest level, and that of the other levels.
    pipelines: [Option<[CachedComputePipelineId; 2]>; 2],
    /// Groups 0 to 2: nothing, the map at the index that it has among the view's bindings, and the levels.
    layouts: [BindGroupLayoutDescriptor; 3],
}

impl Default for ImportancePasses {
    fn default() -> Self {
        Self {
            pipelines: [None; 2],
            layouts: [
                BindGroupLayoutDescriptor::new("restir nothing", &[]),
                BindGroupLayoutDescriptor::new(
                    "restir environment map",
                    &BindGroupLayoutEntries::with_indices(
                        ShaderStages::COMPUTE,
                        ((2, texture_2d_array(TextureSampleType::Float { filterable: false })),),
                    ),
                ),
                BindGroupLayoutDescriptor::new(
                    "restir environment importance",
                    &BindGroupLayoutEntries::sequential(
                        ShaderStages::COMPUTE,
                        (
                            texture_2d(TextureSampleType::Float { filterable: false }),
                            texture_storage_2d(TextureFormat::R32Float, StorageTextureAccess::WriteOnly),
                        ),
                    ),
                ),
            ],
        }
    }
}

impl ImportancePasses {
    /// Requests the pipeline of the finest level and that of the other levels.
    pub(super) fn pipelines(
        &mut self,
        is_cube: bool,
        pipelines: &PipelineCache,
        shaders: &ShaderLibrary,
    ) -> [CachedComputePipelineId; 2] {
        *self.pipelines[is_cube as usize].get_or_insert_with(|| {
            let mut features = SceneFeatures::ENVIRONMENT | SceneFeatures::ENVIRONMENT_MAP;
            features.set(SceneFeatures::ENVIRONMENT_CUBE, is_cube);
            ["importance", "reduce"].map(|entry| {
                pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
                    label: Some(format!("restir environment {entry}").into()),
                    layout: self.layouts.to_vec(),
                    shader: shaders.pass("pass/environment.wgsl", &[]),
                    shader_defs: features.shader_defs(),
                    entry_point: Some(entry.into()),
                    ..Default::default()
                })
            })
        })
    }

    pub(super) fn layouts(&self, pipelines: &PipelineCache) -> [BindGroupLayout; 3] {
        self.layouts.each_ref().map(|layout| pipelines.get_bind_group_layout(layout))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_as_small_as_pixels_within_limits() {
        for (image, device, width) in
            [(16, 8192, 1024), (2048, 4096, 2048), (3000, 4096, 4096), (16_384, 4096, 4096), (4096, 3000, 2048)]
        {
            assert_eq!(width_for(image, device), width, "{image} on a device with {device}");
        }
        assert_eq!([0, 1, 10, 11].map(|mip| level_size(2048, mip)), [[2048, 1024], [1024, 512], [2, 1], [1, 1]]);
        assert_eq!(levels_of(2048), 12);
    }
}
