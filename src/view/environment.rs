//! Environments of images, equirectangular ones and cubes: the mip chain of importance that their light is drawn by, made on the GPU
//! from any float format.

use bevy::{
    asset::{AssetId, AssetServer},
    ecs::prelude::*,
    image::Image,
    log::warn,
    platform::collections::{HashMap, HashSet},
    render::{
        render_asset::RenderAssets,
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

use super::extract::{ExtractedEnvironment, ExtractedViews};
use crate::{
    scene::{SceneFeatures, textures::TexturePool},
    shaders::ShaderTable,
};

/// Width of the finest level; the height is half of it.
const WIDTH: u32 = 1024;

struct Entry {
    source: TextureId,
    version: u64,
    map: TextureView,
    importance: TextureView,
    bytes: u64,
}

/// An image, and whether it is to be a cube.
type ImageKey = (AssetId<Image>, bool);

/// The environments in use.
#[derive(Resource)]
pub(crate) struct EnvironmentPool {
    entries: HashMap<ImageKey, Entry>,
    refused: HashSet<ImageKey>,
    none: Option<(TextureView, TextureView)>,
    /// Of equirectangular images and of cubes.
    pipelines: [Option<[CachedComputePipelineId; 2]>; 2],
    /// Groups 0 to 2: nothing, the map at its place among the view's bindings, and the levels.
    layouts: [BindGroupLayoutDescriptor; 3],
    revision: u64,
    /// Every image that a camera asks for is there.
    pub ready: bool,
}

impl Default for EnvironmentPool {
    fn default() -> Self {
        Self {
            entries: HashMap::default(),
            refused: HashSet::default(),
            none: None,
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
            revision: 0,
            ready: true,
        }
    }
}

#[expect(clippy::too_many_arguments, reason = "a system: each is a resource")]
pub(crate) fn prepare_environments(
    mut pool: ResMut<EnvironmentPool>,
    views: Res<ExtractedViews>,
    images: Res<RenderAssets<GpuImage>>,
    mut textures: ResMut<TexturePool>,
    assets: Res<AssetServer>,
    pipelines: Res<PipelineCache>,
    shaders: Res<ShaderTable>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let pool = &mut *pool;
    pool.none.get_or_insert_with(|| {
        let view = |format, label, dimension| {
            texture(&device, label, format, 1, 1, 1, TextureUsages::TEXTURE_BINDING)
                .create_view(&TextureViewDescriptor { dimension: Some(dimension), ..Default::default() })
        };
        (
            view(TextureFormat::Rgba8Unorm, "no environment", TextureViewDimension::D2Array),
            view(TextureFormat::R32Float, "no environment importance", TextureViewDimension::D2),
        )
    });
    let wanted: HashSet<_> =
        views.0.values().filter_map(|v| v.environment?.key()).filter(|key| !pool.refused.contains(key)).collect();
    pool.entries.retain(|key, _| wanted.contains(key));
    pool.ready = true;
    for key @ (id, is_cube) in wanted {
        let Some(image) = images.get(id) else {
            pool.ready &= !textures.is_coming(id, &assets);
            continue;
        };
        // Bevy may write new pixels to the old texture.
        let version = textures.version(id);
        if pool.entries.get(&key).is_some_and(|e| e.source == image.texture.id() && e.version == version) {
            continue;
        }
        let descriptor = &image.texture_descriptor;
        let float = matches!(
            descriptor.format.sample_type(None, Some(device.features())),
            Some(TextureSampleType::Float { .. })
        );
        let size = descriptor.size;
        let fits = match is_cube {
            true => size.depth_or_array_layers == 6 && size.width == size.height,
            false => size.depth_or_array_layers == 1,
        };
        if descriptor.dimension != TextureDimension::D2 || !fits || !float {
            let (wanted, used) = match is_cube {
                true => ("colour cube", "nothing of it is shown"),
                false => ("equirectangular colour image", "only the colour is used"),
            };
            warn!("restir: environment image {id} is no {wanted}; {used}");
            pool.refused.insert(key);
            continue;
        }
        let ids = *pool.pipelines[is_cube as usize].get_or_insert_with(|| {
            let mut features = SceneFeatures::ENVIRONMENT | SceneFeatures::ENVIRONMENT_MAP;
            features.set(SceneFeatures::ENVIRONMENT_CUBE, is_cube);
            ["importance", "reduce"].map(|entry| {
                pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
                    label: Some(format!("restir environment {entry}").into()),
                    layout: pool.layouts.to_vec(),
                    shader: shaders.pass("pass/environment.wgsl"),
                    shader_defs: features.shader_defs(),
                    entry_point: Some(entry.into()),
                    ..Default::default()
                })
            })
        });
        let [Some(importance), Some(reduce)] = ids.map(|id| pipelines.get_compute_pipeline(id)) else {
            pool.ready = false;
            continue;
        };
        let layouts = pool.layouts.each_ref().map(|layout| pipelines.get_bind_group_layout(layout));
        let entry = build(image, version, importance, reduce, &layouts, &device, &queue);
        pool.entries.insert(key, entry);
        pool.revision += 1;
    }
}

/// Fills the mip chain: the finest level from the image, every other one from the level below.
fn build(
    image: &GpuImage,
    version: u64,
    importance: &ComputePipeline,
    reduce: &ComputePipeline,
    layouts: &[BindGroupLayout; 3],
    device: &RenderDevice,
    queue: &RenderQueue,
) -> Entry {
    let levels = WIDTH.ilog2() + 1;
    let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING;
    let chain = texture(device, "environment importance", TextureFormat::R32Float, WIDTH, WIDTH / 2, levels, usage);
    let level = |mip| {
        chain.create_view(&TextureViewDescriptor {
            base_mip_level: mip,
            mip_level_count: Some(1),
            ..Default::default()
        })
    };
    let map = image.texture.create_view(&TextureViewDescriptor {
        dimension: Some(TextureViewDimension::D2Array),
        mip_level_count: Some(1),
        ..Default::default()
    });
    let nothing = device.create_bind_group("restir nothing", &layouts[0], &[]);
    let map_group =
        device.create_bind_group("restir environment map", &layouts[1], &BindGroupEntries::with_indices(((2, &map),)));
    let mut encoder =
        device.create_command_encoder(&CommandEncoderDescriptor { label: Some("restir environment importance") });
    for mip in 0..levels {
        // The finest level reads the map alone, and is bound the coarsest in place of a level below it.
        let source = level(if mip == 0 { levels - 1 } else { mip - 1 });
        let bind_group = device.create_bind_group(
            "restir environment importance",
            &layouts[2],
            &BindGroupEntries::sequential((&source, &level(mip))),
        );
        let (width, height) = ((WIDTH >> mip).max(1), ((WIDTH / 2) >> mip).max(1));
        let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
        pass.set_pipeline(if mip == 0 { importance } else { reduce });
        pass.set_bind_group(0, &nothing, &[]);
        pass.set_bind_group(1, &map_group, &[]);
        pass.set_bind_group(2, &bind_group, &[]);
        pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
    }
    queue.submit([encoder.finish()]);
    Entry {
        source: image.texture.id(),
        version,
        map,
        importance: chain.create_view(&TextureViewDescriptor::default()),
        bytes: (0..levels).map(|m| ((WIDTH >> m).max(1) * ((WIDTH / 2) >> m).max(1)) as u64 * 4).sum(),
    }
}

fn texture(
    device: &RenderDevice,
    label: &'static str,
    format: TextureFormat,
    width: u32,
    height: u32,
    mip_level_count: u32,
    usage: TextureUsages,
) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some(label),
        size: Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

impl EnvironmentPool {
    fn entry(&self, environment: Option<&ExtractedEnvironment>) -> Option<&Entry> {
        self.entries.get(&environment?.key()?)
    }

    /// The map and its importance, one texel of nothing each where there is none.
    pub(crate) fn views_of(&self, environment: Option<&ExtractedEnvironment>) -> Option<(&TextureView, &TextureView)> {
        match self.entry(environment) {
            Some(entry) => Some((&entry.map, &entry.importance)),
            None => self.none.as_ref().map(|(map, importance)| (map, importance)),
        }
    }

    /// What an environment asks of the shaders.
    pub(crate) fn features(&self, environment: Option<&ExtractedEnvironment>) -> SceneFeatures {
        let has_map = self.entry(environment).is_some();
        match environment {
            // Without its image a cube is nothing.
            Some(e) if e.color.max_element() > 0.0 && (has_map || !e.is_cube()) => {
                let mut features = SceneFeatures::ENVIRONMENT;
                features.set(SceneFeatures::ENVIRONMENT_MAP, has_map);
                features.set(SceneFeatures::ENVIRONMENT_CUBE, has_map && e.is_cube());
                features
            }
            _ => SceneFeatures::empty(),
        }
    }

    /// Changes when the image of an environment does.
    pub(crate) fn revision(&self, environment: Option<&ExtractedEnvironment>) -> u64 {
        self.entry(environment).map_or(0, |_| self.revision)
    }

    /// Name and bytes, for the statistics.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        ("environment importance", self.entries.values().map(|e| e.bytes).sum())
    }
}
