//! Environments of images, equirectangular ones and cubes: the mip chain of importance that their light is drawn by, made on the GPU
//! from any float format.
//!
//! It is made once, and again when the image changes.  An image that the GPU writes (`RENDER_ATTACHMENT` or `STORAGE_BINDING` among its
//! usages: a camera's target, a `GeneratedEnvironmentMapLight`, the maps of an atmosphere) may change in every frame and nothing says so:
//! its chain is made anew in each, half a million cells that each look into the map and ten dispatches that sum them up, from what the GPU
//! wrote up to the frame before.  No frames are summed and no history is kept meanwhile, as with an image that is edited each frame.

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
    scene::{
        SceneFeatures,
        texture::textures::{TexturePool, is_live},
    },
    shader_library::ShaderLibrary,
};

/// Width of the finest level; the height is half of it.
const WIDTH: u32 = 1024;

/// Levels of the chain.
const LEVELS: u32 = WIDTH.ilog2() + 1;

struct Entry {
    source: TextureId,
    version: u64,
    /// Another one whenever the chain was made anew.
    revision: u64,
    map: TextureView,
    importance: TextureView,
    /// Groups 1, and 2 of every level.
    map_group: BindGroup,
    level_groups: Vec<BindGroup>,
}

/// An image, and whether it is to be a cube.
type ImageKey = (AssetId<Image>, bool);

/// The environments in use.
#[derive(Resource)]
pub(crate) struct EnvironmentPool {
    entries: HashMap<ImageKey, Entry>,
    /// Images that are no environments, as they were then.
    refused: HashMap<ImageKey, u64>,
    none: Option<(TextureView, TextureView)>,
    /// Of equirectangular images and of cubes.
    pipelines: [Option<[CachedComputePipelineId; 2]>; 2],
    /// Groups 0 to 2: nothing, the map at its place among the view's bindings, and the levels.
    layouts: [BindGroupLayoutDescriptor; 3],
    /// Counts chains that were made.
    revision: u64,
    /// Every image that a camera asks for is there.
    pub ready: bool,
}

impl Default for EnvironmentPool {
    fn default() -> Self {
        Self {
            entries: HashMap::default(),
            refused: HashMap::default(),
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
    shaders: Res<ShaderLibrary>,
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
    let is_refused = |key: &ImageKey| pool.refused.get(key) == Some(&textures.version(key.0));
    let wanted: HashSet<_> =
        views.0.values().filter_map(|v| v.environment?.key()).filter(|key| !is_refused(key)).collect();
    pool.entries.retain(|key, _| wanted.contains(key));
    pool.ready = true;
    for key @ (id, is_cube) in wanted {
        let Some(image) = images.get(id) else {
            pool.ready &= !textures.is_coming(id, &assets);
            continue;
        };
        // Bevy may write new pixels to the old texture, and passes may without a word.
        let version = textures.version(id);
        let is_known = |e: &Entry| e.source == image.texture.id() && e.version == version;
        if pool.entries.get(&key).is_some_and(is_known) && !is_live(image.texture_descriptor.usage) {
            continue;
        }
        if !is_environment(image, is_cube, &device) {
            let (wanted, used) = match is_cube {
                true => ("color cube", "nothing of it is shown"),
                false => ("equirectangular color image", "only the color is used"),
            };
            warn!("restir: environment image {id} is no {wanted}; {used}");
            pool.refused.insert(key, version);
            pool.entries.remove(&key);
            continue;
        }
        let ids = pool.pipelines(is_cube, &pipelines, &shaders);
        let [Some(importance), Some(reduce)] = ids.map(|id| pipelines.get_compute_pipeline(id)) else {
            pool.ready = false;
            continue;
        };
        let layouts = pool.layouts.each_ref().map(|layout| pipelines.get_bind_group_layout(layout));
        let old = pool.entries.remove(&key).filter(|e| e.source == image.texture.id());
        let mut entry = old.unwrap_or_else(|| Entry::new(image, &layouts, &device));
        entry.fill([importance, reduce], &layouts, &device, &queue);
        pool.revision += 1;
        (entry.version, entry.revision) = (version, pool.revision);
        pool.entries.insert(key, entry);
    }
}

/// Whether light may come from an image all round.
fn is_environment(image: &GpuImage, is_cube: bool, device: &RenderDevice) -> bool {
    let descriptor = &image.texture_descriptor;
    let kind = descriptor.format.sample_type(None, Some(device.features()));
    let size = descriptor.size;
    let fits = match is_cube {
        true => size.depth_or_array_layers == 6 && size.width == size.height,
        false => size.depth_or_array_layers == 1,
    };
    descriptor.dimension == TextureDimension::D2
        && descriptor.sample_count == 1
        && descriptor.usage.contains(TextureUsages::TEXTURE_BINDING)
        && matches!(kind, Some(TextureSampleType::Float { .. }))
        && fits
}

impl Entry {
    fn new(image: &GpuImage, layouts: &[BindGroupLayout; 3], device: &RenderDevice) -> Self {
        let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::STORAGE_BINDING;
        let chain = texture(device, "environment importance", TextureFormat::R32Float, WIDTH, WIDTH / 2, LEVELS, usage);
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
            // The finest level reads the map alone, and is bound the coarsest in place of a level below it.
            let (source, target) = (level(if mip == 0 { LEVELS - 1 } else { mip - 1 }), level(mip));
            let views = BindGroupEntries::sequential((&source, &target));
            device.create_bind_group("restir environment importance", &layouts[2], &views)
        };
        let maps = BindGroupEntries::with_indices(((2, &map),));
        Self {
            source: image.texture.id(),
            version: 0,
            revision: 0,
            importance: chain.create_view(&TextureViewDescriptor::default()),
            map_group: device.create_bind_group("restir environment map", &layouts[1], &maps),
            level_groups: (0..LEVELS).map(level_group).collect(),
            map,
        }
    }

    /// Fills the mip chain: the finest level from the image, every other one from the level below.
    fn fill(
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
            let (width, height) = ((WIDTH >> mip).max(1), ((WIDTH / 2) >> mip).max(1));
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_pipeline(if mip == 0 { importance } else { reduce });
            pass.set_bind_group(0, &nothing, &[]);
            pass.set_bind_group(1, &self.map_group, &[]);
            pass.set_bind_group(2, level_group, &[]);
            pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
        }
        queue.submit([encoder.finish()]);
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
    /// Those that fill the finest level, and all others, of a chain.
    fn pipelines(
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
        self.entry(environment).map_or(0, |entry| entry.revision)
    }

    /// Name and bytes, for the statistics.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        let texels = |mip: u32| (WIDTH >> mip).max(1) * ((WIDTH / 2) >> mip).max(1);
        let chain: u64 = (0..LEVELS).map(|mip| u64::from(texels(mip)) * 4).sum();
        ("environment importance", chain * self.entries.len() as u64)
    }
}
