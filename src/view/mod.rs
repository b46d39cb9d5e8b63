//! Per-camera state between frames: visibility buffer, radiance, counters, uniforms, history; and when the history restarts.

pub(crate) mod bevy_handoff;
pub(crate) mod capture;
pub(crate) mod counters;
pub(crate) mod environment;
pub(crate) mod extract;
pub(crate) mod history;
mod resolution;
pub(crate) mod selection;
mod uniforms;

use bevy::{
    app::SubApp,
    camera::MainPassResolutionOverride,
    core_pipeline::core_3d::prepare_prepass_textures,
    ecs::prelude::*,
    log::warn,
    math::UVec2,
    platform::collections::{HashMap, HashSet},
    render::{
        Render, RenderSystems,
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
        view::ExtractedView,
    },
};

use crate::{
    gpu_layout::*,
    scene::{bindings::SceneBindings, geometry::render_layers, geometry::render_layers::ALL_CAMERAS},
    settings::{Direct, Restir},
    system_sets::RestirSystems,
    technique::frame::{Frame, PipelineKey},
};
use counters::CounterReadback;
use environment::EnvironmentPool;
use extract::{ExtractedEnvironment, ExtractedRestir, ExtractedViews};
use history::History;
use selection::{CompositeKey, SelectedPipelines, Selection};

/// Everything that a picture depends on besides the random numbers: while it is the same, frames may be summed.
#[derive(Clone, Debug, PartialEq)]
struct Shown {
    /// Where things are; and everything else about them.
    motion: u64,
    edits: u64,
    environment_revision: u64,
    camera: GpuCamera,
    size: UVec2,
    settings: Restir,
    environment: Option<ExtractedEnvironment>,
    layers: u32,
    background: [f32; 3],
    orthographic: bool,
    pipelines: PipelineKey,
}

/// What one camera keeps.
pub(crate) struct RestirView {
    /// Pixels of the picture that is traced.
    pub size: UVec2,
    pub origin: UVec2,
    /// Pixels of the viewport that Bevy's main pass draws to: `size`, or more where the device cannot bind as much.
    pub target_size: UVec2,
    /// Bit of its render layers.
    pub layers: u32,
    pub uniforms: Buffer,
    pub visibility: TextureView,
    pub visibility_texture: Texture,
    pub history: Option<History>,
    pub depth: TextureView,
    pub radiance: Buffer,
    pub counters: CounterReadback,
    /// Group 1 of compute passes, and of raster passes (the uniforms alone).
    pub bind_group: BindGroup,
    pub raster_bind_group: BindGroup,
    /// Frames since the history was reset.
    pub frame: u32,
    /// What this frame's random numbers go by: frames since a reset was asked for, or settings changed.
    sequence: u32,
    /// Frames that the radiance held before this one.
    pub accumulated: u32,
    /// Frames are being summed.
    summed: bool,
    previous_camera: Option<GpuCamera>,
    previous_jitter: [f32; 2],
    shown: Option<Shown>,
    /// Something moved, or a light changed, since the last frame.
    moved: bool,
    bound_environment: (TextureViewId, TextureViewId),
    /// The pipelines of this frame.
    pub key: Option<PipelineKey>,
    /// They are those that the scene asks for.
    pub key_is_requested: bool,
    /// What the last pass writes to.
    pub composite: Option<CompositeKey>,
    /// This frame's passes will run.
    pub rendered: bool,
    pub settings: Restir,
}

/// The views of all `Restir` cameras, by render entity.
#[derive(Resource, Default)]
pub(crate) struct ViewPool {
    pub views: HashMap<Entity, RestirView>,
}

/// Adds the views to the render world.
pub(crate) fn build(render_app: &mut SubApp) {
    render_app
        .init_resource::<ExtractedViews>()
        .init_resource::<ViewPool>()
        .init_resource::<EnvironmentPool>()
        .init_resource::<SelectedPipelines>()
        .add_systems(
            bevy::render::ExtractSchedule,
            (extract::extract_views.after(render_layers::extract_layers), extract::clear_reset).chain(),
        )
        .configure_sets(
            Render,
            (
                RestirSystems::MirrorScene,
                RestirSystems::PrepareEnvironments,
                RestirSystems::SelectPipelines.after(prepare_prepass_textures),
                RestirSystems::PrepareViews,
            )
                .chain()
                .in_set(RenderSystems::PrepareResources),
        )
        .add_systems(
            Render,
            (
                environment::prepare_environments.in_set(RestirSystems::PrepareEnvironments),
                prepare_views.in_set(RestirSystems::PrepareViews),
                capture::capture_radiance.in_set(RenderSystems::Cleanup),
            ),
        );
}

/// Layout of group 1 for compute passes (`shaders/view/bindings.wgsl`).
pub(crate) fn view_layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir view",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                uniform_buffer_sized(false, None),
                texture_2d(TextureSampleType::Uint),
                texture_2d_array(TextureSampleType::Float { filterable: false }),
                texture_2d(TextureSampleType::Float { filterable: false }),
                texture_storage_2d(TextureFormat::R32Uint, StorageTextureAccess::ReadWrite),
            ),
        ),
    )
}

/// Layout of group 1 for raster passes, which write what compute passes read.
pub(crate) fn raster_view_layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir raster view",
        &BindGroupLayoutEntries::sequential(ShaderStages::VERTEX_FRAGMENT, (uniform_buffer_sized(false, None),)),
    )
}

/// Format of the visibility buffer: (instance, triangle).
pub(crate) const VISIBILITY_FORMAT: TextureFormat = TextureFormat::Rg32Uint;
/// Format of its depth: reverse z.
pub(crate) const DEPTH_FORMAT: TextureFormat = TextureFormat::Depth32Float;

fn prepare_views(
    mut pool: ResMut<ViewPool>,
    mut extracted: ResMut<ExtractedViews>,
    cameras: Query<(&ExtractedCamera, &ExtractedView, Option<&TemporalJitter>, Option<&MainPassResolutionOverride>)>,
    selected: Res<SelectedPipelines>,
    scene: Res<SceneBindings>,
    environments: Res<EnvironmentPool>,
    pipelines: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut warned: Local<HashSet<(Entity, &'static str)>>,
) {
    let limit = resolution::binding_limit(&device);
    pool.views.retain(|entity, _| extracted.0.contains_key(entity));
    for (&entity, restir) in &mut extracted.0 {
        let (Some((camera, view, jitter, smaller)), Some(&selection)) =
            (cameras.get(entity).ok(), selected.0.get(&entity))
        else {
            // Older frames of this camera must not be shown, captured or counted.
            pool.views.remove(&entity);
            continue;
        };
        if let (Some(key), Some(last)) = (selection.key, pool.views.get(&entity))
            && !key.serves_settings_of(selection.requested)
        {
            // The camera keeps its settings until the pipelines of the new ones are compiled.
            restir.settings = Restir { reset: restir.settings.reset, ..last.settings.clone() };
        }
        let viewport = UVec2::new(view.viewport.z, view.viewport.w);
        // An upscaler, such as DLSS, enlarges an image that fills only the corner of the viewport.
        let target_size = smaller.map_or(viewport, |size| size.0.min(viewport)).max(UVec2::ONE);
        let size = fit_to_device(entity, restir, target_size, limit, &mut warned);
        let Some((map, importance)) = environments.views_of(restir.environment.as_ref()) else {
            continue;
        };
        let state =
            pool.views.entry(entity).or_insert_with(|| RestirView::new(size, &device, &pipelines, map, importance));
        if state.size != size || state.bound_environment != (map.id(), importance.id()) {
            let new = RestirView::new(size, &device, &pipelines, map, importance);
            let old = core::mem::replace(state, new);
            if old.size == size {
                // Only the environment has changed: motion vectors still need the last camera.
                state.previous_camera = old.previous_camera;
                state.previous_jitter = old.previous_jitter;
            }
        }
        state.origin = UVec2::new(view.viewport.x, view.viewport.y);
        state.target_size = target_size;
        state.select(restir, &selection, &scene);
        if state.rendered {
            state.update_uniforms(restir, camera, view, jitter, &scene, &environments, &queue);
            state.update_history(&device, &queue);
        }
    }
}

/// Reduces resolution and light subsets to what the device can bind, with a warning for each camera.  Returns the traced resolution.
fn fit_to_device(
    entity: Entity,
    restir: &mut ExtractedRestir,
    target_size: UVec2,
    limit: u64,
    warned: &mut HashSet<(Entity, &'static str)>,
) -> UVec2 {
    let domains = Frame::of(&restir.settings).domains();
    let size = resolution::traced_size(target_size, domains, &restir.settings, limit);
    if size != target_size && warned.insert((entity, "size")) {
        warn!(
            "restir: camera {entity} traces {} x {} pixels for its {} x {}: the device binds at most {limit} bytes",
            size.x, size.y, target_size.x, target_size.y
        );
    }
    if !domains.is_empty()
        && resolution::fit_subsets(&mut restir.settings.direct, limit)
        && warned.insert((entity, "subsets"))
    {
        let Direct { subset_count, subset_size, .. } = restir.settings.direct;
        warn!(
            "restir: camera {entity} draws {subset_count} subsets of {subset_size} lights: the device binds at most {limit} bytes"
        );
    }
    size
}

impl RestirView {
    fn new(
        size: UVec2,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        environment_map: &TextureView,
        environment_importance: &TextureView,
    ) -> Self {
        let buffer = |label, size, usage| buffer(device, label, size, usage);
        let texture = |label, format, usage| texture(device, label, size, format, usage);
        let view = |texture: &Texture| texture.create_view(&TextureViewDescriptor::default());
        let target = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
        let uniforms = buffer(
            "view uniforms",
            size_of::<GpuViewUniforms>() as u64,
            BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        );
        let visibility_texture = texture("visibility", VISIBILITY_FORMAT, target | TextureUsages::COPY_SRC);
        let visibility = view(&visibility_texture);
        let ray_counts = view(&texture("ray counts", TextureFormat::R32Uint, TextureUsages::STORAGE_BINDING));
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        Self {
            size,
            origin: UVec2::ZERO,
            target_size: size,
            layers: ALL_CAMERAS,
            depth: view(&texture("depth", DEPTH_FORMAT, target)),
            radiance: buffer("radiance", pixels(size) * 16, storage),
            counters: CounterReadback::new(device),
            bind_group: device.create_bind_group(
                "restir view",
                &pipelines.get_bind_group_layout(&view_layout()),
                &BindGroupEntries::sequential((
                    uniforms.as_entire_binding(),
                    &visibility,
                    environment_map,
                    environment_importance,
                    &ray_counts,
                )),
            ),
            raster_bind_group: device.create_bind_group(
                "restir raster view",
                &pipelines.get_bind_group_layout(&raster_view_layout()),
                &BindGroupEntries::sequential((uniforms.as_entire_binding(),)),
            ),
            uniforms,
            visibility,
            visibility_texture,
            history: None,
            frame: 0,
            sequence: 0,
            accumulated: 0,
            summed: false,
            previous_camera: None,
            previous_jitter: [0.0; 2],
            shown: None,
            moved: false,
            bound_environment: (environment_map.id(), environment_importance.id()),
            key: None,
            key_is_requested: false,
            composite: None,
            rendered: false,
            settings: Restir::default(),
        }
    }

    /// Takes settings and pipelines for this frame, and decides whether it is rendered.
    fn select(&mut self, restir: &ExtractedRestir, selection: &Selection, scene: &SceneBindings) {
        self.layers = restir.layers;
        self.settings = restir.settings.clone();
        self.key = selection.key;
        self.key_is_requested = selection.key == Some(selection.requested);
        self.composite = selection.composite;
        self.rendered = self.composite.is_some() && self.key.is_some() && scene.bind_group.is_some();
        if !self.rendered {
            // The history lacks a frame that is not rendered.
            self.shown = None;
        }
    }

    /// Creates, replaces or drops the history.
    fn update_history(&mut self, device: &RenderDevice, queue: &RenderQueue) {
        let domains = self.key.map_or(&[][..], |key| key.frame.domains());
        if domains.is_empty() {
            self.history = None;
            return;
        }
        let fits = self.history.as_ref().is_some_and(|history| history.fits(self.size, domains, &self.settings));
        if !fits {
            self.history = Some(History::new(self.size, domains, &self.settings, device));
        }
        if let Some(history) = &mut self.history {
            history.begin(&self.settings, fits && self.frame > 0, self.moved, queue);
        }
    }

    /// Names and bytes of what this view holds.
    pub(crate) fn memory(&self) -> Vec<(&'static str, u64)> {
        let pixels = pixels(self.size);
        let mut memory = vec![
            ("view uniforms", size_of::<GpuViewUniforms>() as u64),
            ("visibility", pixels * 8),
            ("depth", pixels * 4),
            ("ray counts", pixels * 4),
            ("radiance", pixels * 16),
            ("counters", 2 * size_of::<GpuCounters>() as u64),
        ];
        memory.extend(self.history.iter().flat_map(History::memory));
        memory
    }

    /// Bytes of reservoirs a pixel.
    pub(crate) fn reservoir_bytes_per_pixel(&self) -> u64 {
        self.history.as_ref().map_or(0, History::reservoir_bytes_per_pixel)
    }
}

fn buffer(device: &RenderDevice, label: &'static str, size: u64, usage: BufferUsages) -> Buffer {
    device.create_buffer(&BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

/// A texture as large as the view.
fn texture(
    device: &RenderDevice,
    label: &'static str,
    size: UVec2,
    format: TextureFormat,
    usage: TextureUsages,
) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some(label),
        size: Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

fn pixels(size: UVec2) -> u64 {
    size.x as u64 * size.y as u64
}
