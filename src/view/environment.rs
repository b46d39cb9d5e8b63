//! Environment images: the importance map of each equirectangular image or cube in use, filled on the GPU from any float format.
//!
//! An importance map is filled once, and again when the image changes.  An image that the GPU can write (`RENDER_ATTACHMENT` or
//! `STORAGE_BINDING` among its usages: the target of a camera, a `GeneratedEnvironmentMapLight`, the maps of an atmosphere) may change in
//! every frame without notice.  Its importance map is filled in every frame, from the pixels of the frame before; that costs half a million
//! cells that each read the image, and ten reduction dispatches.  Meanwhile frames are not accumulated, and paths to the
//! environment are not taken from the last frame, as for an image that the app edits in every frame.

use bevy::{
    asset::{AssetId, AssetServer},
    ecs::prelude::*,
    image::Image,
    log::warn,
    math::UVec2,
    platform::collections::{HashMap, HashSet},
    render::{
        render_asset::RenderAssets,
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};

use super::{
    ViewPool,
    extract::{ExtractedEnvironment, ExtractedViews},
    importance_map::{ImportanceMap, ImportancePasses},
    texture,
};
use crate::{
    cpu_times::{CpuTimes, Stage},
    scene::{
        SceneFeatures,
        storage::allocation,
        texture::image_info::{is_color_texture, is_live},
        texture::textures::TexturePool,
    },
    shader_library::ShaderLibrary,
    warned::Warned,
};

/// An environment image in use.
struct Entry {
    importance: ImportanceMap,
    /// Version of the image that the importance map was filled from.
    version: u64,
    /// Changes whenever the importance map is filled.
    revision: u64,
}

/// An image, and whether it must be a cube.
type ImageKey = (AssetId<Image>, bool);

/// The environment images in use.
#[derive(Resource)]
pub(crate) struct EnvironmentPool {
    entries: HashMap<ImageKey, Entry>,
    /// Images that are being loaded.
    pending: HashSet<ImageKey>,
    /// Versions of images that cannot serve as an environment.
    rejected: HashMap<ImageKey, u64>,
    /// Images whose importance maps the device had no memory for in this frame, each with the device's message.
    without_memory: HashMap<ImageKey, String>,
    /// Images that a warning has named; each is named once, however often it changes.
    warned: Warned<ImageKey>,
    /// Black texels for the faces of a map and for its importance, bound where there is no environment image.
    placeholders: Option<(TextureView, TextureView)>,
    passes: ImportancePasses,
    /// Counts fills of importance maps.
    revision: u64,
    /// Every image that a camera uses is loaded.
    pub ready: bool,
}

impl Default for EnvironmentPool {
    fn default() -> Self {
        Self {
            entries: HashMap::default(),
            pending: HashSet::default(),
            rejected: HashMap::default(),
            without_memory: HashMap::default(),
            warned: Warned::default(),
            placeholders: None,
            passes: ImportancePasses::default(),
            revision: 0,
            ready: true,
        }
    }
}

pub(crate) fn prepare_environments(
    mut pool: ResMut<EnvironmentPool>,
    views: Res<ExtractedViews>,
    view_pool: Res<ViewPool>,
    images: Res<RenderAssets<GpuImage>>,
    mut textures: ResMut<TexturePool>,
    assets: Res<AssetServer>,
    pipelines: Res<PipelineCache>,
    shaders: Res<ShaderLibrary>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Environments);
    let pool = &mut *pool;
    pool.placeholders.get_or_insert_with(|| placeholders(&device));
    pool.warned.begin_frame();
    // The version of an image that is gone is 0.
    pool.warned.retain(|(id, _)| textures.version(*id) > 0);
    pool.rejected.retain(|(id, _), version| textures.version(*id) == *version);
    let used = pool.used_images(&views, &view_pool, &textures);
    pool.entries.retain(|key, _| used.contains(key));
    pool.pending.clear();
    pool.without_memory.clear();
    for key @ (id, is_cube) in used {
        let Some(image) = images.get(id) else {
            // The last environment of a camera needs no image: its entry has the views.
            if !pool.entries.contains_key(&key) && textures.is_coming(id, &assets) {
                pool.pending.insert(key);
            }
            continue;
        };
        // Bevy may write new pixels to the old texture, and GPU passes may write to it without notice.
        let version = textures.version(id);
        let is_current = |e: &Entry| e.importance.texture == image.texture.id() && e.version == version;
        if pool.entries.get(&key).is_some_and(is_current) && !is_live(image.texture_descriptor.usage) {
            continue;
        }
        if !is_environment(image, is_cube, &device) {
            pool.reject(key, version);
            continue;
        }
        let ids = pool.passes.pipelines(is_cube, &pipelines, &shaders);
        let [Some(finest), Some(reduce)] = ids.map(|id| pipelines.get_compute_pipeline(id)) else {
            pool.pending.insert(key);
            continue;
        };
        let layouts = pool.passes.layouts(&pipelines);
        match pool.take_map(key, image, &layouts, &device) {
            Ok(importance) => {
                importance.fill([finest, reduce], &layouts, &device, &queue);
                pool.revision += 1;
                pool.entries.insert(key, Entry { importance, version, revision: pool.revision });
            }
            Err(error) => _ = pool.without_memory.insert(key, error),
        }
    }
    pool.ready = pool.pending.is_empty();
}

fn placeholders(device: &RenderDevice) -> (TextureView, TextureView) {
    let view = |format, label, layers, dimension| {
        texture(device, label, UVec2::ONE, layers, format, TextureUsages::TEXTURE_BINDING)
            .create_view(&TextureViewDescriptor { dimension: Some(dimension), ..Default::default() })
    };
    (
        view(TextureFormat::Rgba8Unorm, "no environment", 6, TextureViewDimension::D2Array),
        view(TextureFormat::R32Float, "no environment importance", 1, TextureViewDimension::D2),
    )
}

/// Whether an image can light the scene from all directions.
fn is_environment(image: &GpuImage, is_cube: bool, device: &RenderDevice) -> bool {
    let size = image.texture_descriptor.size;
    let fits = match is_cube {
        true => size.depth_or_array_layers == 6 && size.width == size.height,
        false => size.depth_or_array_layers == 1,
    };
    fits && is_color_texture(image, device)
}

impl EnvironmentPool {
    /// The images of this frame.  Those of the last one stay until these can be rendered.
    fn used_images(&self, views: &ExtractedViews, view_pool: &ViewPool, textures: &TexturePool) -> HashSet<ImageKey> {
        let is_rejected = |key: &ImageKey| self.rejected.get(key) == Some(&textures.version(key.0));
        let environments =
            views.0.iter().flat_map(|(&camera, restir)| [restir.environment, view_pool.last_environment(camera)]);
        environments.filter_map(|environment| environment?.key()).filter(|key| !is_rejected(key)).collect()
    }

    /// Remembers, with a warning, that this version of an image cannot serve as an environment.
    fn reject(&mut self, key @ (id, is_cube): ImageKey, version: u64) {
        let (needed, consequence) = match is_cube {
            true => ("color cube", "this environment is not rendered"),
            false => ("equirectangular color image", "only the color of this environment is used"),
        };
        if self.warned.is_due(key) {
            warn!("restir: environment image {id} is not a {needed} that shaders can read; {consequence}");
        }
        self.rejected.insert(key, version);
        self.entries.remove(&key);
    }

    /// The importance map of an image, with the values of an older version or without values.  The device's message if it has no memory.
    fn take_map(
        &mut self,
        key: ImageKey,
        image: &GpuImage,
        layouts: &[BindGroupLayout; 3],
        device: &RenderDevice,
    ) -> Result<ImportanceMap, String> {
        match self.entries.remove(&key).filter(|e| e.importance.texture == image.texture.id()) {
            Some(entry) => Ok(entry.importance),
            None => {
                allocation::attempt(device, "environment importance", || ImportanceMap::new(image, layouts, device))
            }
        }
    }

    /// Whether the image of an environment is being loaded.
    pub(crate) fn is_pending(&self, environment: &ExtractedEnvironment) -> bool {
        environment.key().is_some_and(|key| self.pending.contains(&key))
    }

    fn entry(&self, environment: Option<&ExtractedEnvironment>) -> Option<&Entry> {
        self.entries.get(&environment?.key()?)
    }

    /// The map and its importance, or placeholders of one texel each.  The device's message if it has no memory for them.
    pub(crate) fn views_of(&self, environment: Option<&ExtractedEnvironment>) -> Result<[&TextureView; 2], String> {
        if let Some(Entry { importance, .. }) = self.entry(environment) {
            return Ok([&importance.map, &importance.importance]);
        }
        let error = environment.and_then(|environment| self.without_memory.get(&environment.key()?));
        match (error, &self.placeholders) {
            (None, Some((map, importance))) => Ok([map, importance]),
            (error, _) => Err(error.cloned().unwrap_or_default()),
        }
    }

    /// Features that shaders need for an environment.  An image that is being loaded counts as loaded, so that pipelines are compiled once.
    pub(crate) fn features(&self, environment: Option<&ExtractedEnvironment>) -> SceneFeatures {
        let Some(e) = environment else { return SceneFeatures::empty() };
        let has_map = self.entry(environment).is_some() || self.is_pending(e);
        // A black environment keeps its pipelines, because it may shine again.
        let mut features = SceneFeatures::ENVIRONMENT;
        features.set(SceneFeatures::ENVIRONMENT_MAP, has_map);
        features.set(SceneFeatures::ENVIRONMENT_CUBE, has_map && e.is_cube());
        // A cube without its image emits nothing.
        if has_map || !e.is_cube() { features } else { SceneFeatures::empty() }
    }

    /// Whether the camera sees an environment behind all objects.  Without its image a cube leaves the clear color, as in Bevy.
    pub(crate) fn is_seen(&self, environment: &ExtractedEnvironment) -> bool {
        environment.is_backdrop() && (!environment.is_cube() || self.entry(Some(environment)).is_some())
    }

    /// Changes whenever the image of an environment does.
    pub(crate) fn revision(&self, environment: Option<&ExtractedEnvironment>) -> u64 {
        self.entry(environment).map_or(0, |entry| entry.revision)
    }

    /// Name and bytes, for the statistics.
    pub(crate) fn memory(&self) -> (&'static str, u64) {
        ("environment importance", self.entries.values().map(|entry| entry.importance.bytes()).sum())
    }
}
