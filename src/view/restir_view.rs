//! GPU resources and counters that one camera keeps between frames.

use bevy::{
    math::UVec2,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};

use core::sync::atomic::AtomicBool;

use super::{
    DEPTH_FORMAT,
    bands::Bands,
    bind_groups::{BindGroups, Bound},
    buffer,
    counters::CounterReadback,
    extract::{ExtractedEnvironment, ExtractedRestir},
    history::{FrameInputs, History, traces_light},
    image_state::{ImageState, Reset, ResetCounts},
    light_paths::{LightPathCounts, LightPaths},
    pixels, raster_view_layout,
    selection::{CompositeKey, Selection},
    shown_surfaces::Surfaces,
    texture,
    uniforms::EnvironmentPlacement,
    view_layout, visibility_buffer,
    visible_draws::VisibleDraws,
};
use crate::{
    gpu_layout::*,
    scene::{
        bindings::SceneBindings,
        geometry::{instances::InstancePool, render_layers::ALL_CAMERAS},
        storage::allocation,
    },
    settings::Restir,
    technique::{frame::PipelineKey, reuse_schedule::LastFrame},
};

/// The view of one `Restir` camera.
pub(crate) struct RestirView {
    /// Traced resolution.
    pub size: UVec2,
    pub origin: UVec2,
    /// Resolution of Bevy's main pass: `size`, or more where fewer pixels are traced.
    pub target_size: UVec2,
    /// `Camera::invert_culling`, for the rasterizer, which sees mirrored transforms and projections by itself.  Rays need
    /// [`VIEW_SEES_BACK_FACES`].
    pub inverts_culling: bool,
    /// Bit of the camera's render layers ([`LayerSets`](crate::scene::geometry::render_layers::LayerSets)).
    pub layers: u32,
    pub uniforms: Buffer,
    /// Rays of a dispatch and of a submission in this frame, if possible.
    pub rays_per_dispatch: u32,
    /// The bands of the picture, if a pass of this frame runs over them.
    pub bands: Option<Bands>,
    /// The visibility buffer of this frame.
    pub visibility: TextureView,
    /// Counts that passes add up for each pixel.
    counts: TextureView,
    pub history: Option<History>,
    pub depth: TextureView,
    /// The surfaces of the shown pixels, if fewer are traced.
    pub shown: Option<Surfaces>,
    pub radiance: Buffer,
    pub counters: CounterReadback,
    /// Groups 1 of compute passes.
    pub(super) view_groups: BindGroups,
    /// Group 1 of raster passes: the uniforms alone.
    pub raster_bind_group: BindGroup,
    /// Group 2 of all passes.
    pub bind_groups: BindGroups,
    /// Draw calls of the visibility pass.
    pub visible: VisibleDraws,
    /// Frames since the history was reset.
    pub frame: u32,
    /// Number of restarts of the history, by reason.
    pub resets: ResetCounts,
    /// Reason to count when the history starts without a last frame.
    pub(super) beginning: Reset,
    /// Index of this frame in the random sequence: frames since an explicit reset or a change of settings.
    pub(super) sequence: u32,
    /// Index at which the random sequence continues in a new view, or after frames that were not rendered.  From 0 it would repeat its noise.
    pub(super) first_sequence: u32,
    /// Frames in the radiance buffer before this one.
    pub accumulated: u32,
    /// This frame is added to the radiance buffer.
    pub(super) accumulates: bool,
    pub(super) previous_camera: Option<GpuCamera>,
    pub(super) previous_environment: Option<EnvironmentPlacement>,
    pub(super) previous_jitter: [f32; 2],
    /// Successive frames in which Bevy has not jittered the camera.
    pub(super) frames_without_bevy_jitter: u32,
    /// State of the last frame; `None` if it was not rendered.
    pub(super) image_state: Option<ImageState>,
    /// An instance has moved or a light has changed since the last frame.
    pub(super) moved: bool,
    /// The environment and the shaders are those of the last frame.
    pub(super) same_environment: bool,
    /// The image of the environment is that of the last frame.
    pub(super) same_environment_image: bool,
    /// Nothing that the image depends on has changed since the last frame.
    pub(super) still: bool,
    /// The jitter is that of the last frame.
    pub(super) has_last_jitter: bool,
    /// The image of this frame's environment, and its importance.
    environment_views: [TextureView; 2],
    /// Pipelines of this frame.
    pub key: Option<PipelineKey>,
    /// `key` shows the pictures that scene and settings request; otherwise pipelines for them are still being compiled.
    pub key_is_requested: bool,
    /// Targets of the composite pass.
    pub composite: Option<CompositeKey>,
    /// The passes of this frame run, unless the executor finds that a resource is missing.
    pub rendered: bool,
    /// Bevy has an image to draw this frame into.
    pub has_target: bool,
    /// The passes of the last frame did run.
    pub ran: AtomicBool,
    /// Settings of this frame.
    pub settings: Restir,
    /// The settings that the app asked for, from which those are made.
    pub asked: Restir,
    /// The environment of this frame.
    pub environment: Option<ExtractedEnvironment>,
}

/// The state of a view that was dropped, for the camera's next view.
pub(crate) struct PausedView {
    /// Guards are counted over the whole run of a camera.
    pub counters: CounterReadback,
    /// Number of restarts of the history, by reason.
    pub resets: ResetCounts,
    /// Index of the next frame in the random sequence.
    sequence: u32,
    /// The camera of the last frame, for motion vectors: Bevy's effects keep their history of a camera whose traced resolution changes.
    previous_camera: Option<GpuCamera>,
    /// Pipelines of the last frame.
    pub key: Option<PipelineKey>,
    /// Settings of the last frame.
    pub settings: Restir,
    /// The settings that the app asked for then.
    pub asked: Restir,
    /// The environment of the last frame.
    pub environment: Option<ExtractedEnvironment>,
}

impl RestirView {
    pub(super) fn new(
        size: UVec2,
        target_size: UVec2,
        environment: [&TextureView; 2],
        device: &RenderDevice,
        pipelines: &PipelineCache,
    ) -> Self {
        let buffer = |label, size, usage| buffer(device, label, size, usage);
        let texture = |label, layers, format, usage| {
            texture(device, label, size, layers, format, usage).create_view(&TextureViewDescriptor::default())
        };
        let target = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
        let counts = texture("counts of pixels", 2, TextureFormat::R32Uint, TextureUsages::STORAGE_BINDING);
        let uniforms = buffer(
            "view uniforms",
            size_of::<GpuViewUniforms>() as u64,
            BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        );
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        Self {
            size,
            origin: UVec2::ZERO,
            target_size,
            inverts_culling: false,
            layers: ALL_CAMERAS,
            depth: texture("depth", 1, DEPTH_FORMAT, target),
            shown: Surfaces::shown(size, target_size, device),
            radiance: buffer("radiance", pixels(size) * 16, storage),
            counters: CounterReadback::new(device),
            view_groups: BindGroups::default(),
            raster_bind_group: device.create_bind_group(
                "restir raster view",
                &pipelines.get_bind_group_layout(&raster_view_layout()),
                &BindGroupEntries::sequential((uniforms.as_entire_binding(),)),
            ),
            bind_groups: BindGroups::default(),
            visible: VisibleDraws::default(),
            uniforms,
            rays_per_dispatch: u32::MAX,
            bands: None,
            visibility: visibility_buffer(device, "visibility", size),
            counts,
            history: None,
            resets: ResetCounts::default(),
            beginning: Reset::Start,
            frame: 0,
            sequence: 0,
            first_sequence: 0,
            accumulated: 0,
            accumulates: false,
            previous_camera: None,
            previous_environment: None,
            previous_jitter: [0.0; 2],
            frames_without_bevy_jitter: u32::MAX,
            image_state: None,
            moved: false,
            same_environment: false,
            same_environment_image: false,
            still: false,
            has_last_jitter: false,
            environment_views: environment.map(TextureView::clone),
            key: None,
            key_is_requested: false,
            composite: None,
            rendered: false,
            has_target: true,
            ran: AtomicBool::new(false),
            settings: Restir::default(),
            asked: Restir::default(),
            environment: None,
        }
    }

    /// Takes the environment image of this frame.
    pub(super) fn set_environment(&mut self, environment: [&TextureView; 2]) {
        if self.environment_views.each_ref().map(|view| view.id()) != environment.map(|view| view.id()) {
            // Bind groups would keep the old image alive.
            self.view_groups.clear();
            self.environment_views = environment.map(TextureView::clone);
        }
    }

    /// Group 1 of compute passes.
    pub(crate) fn bind_group(&self, device: &RenderDevice, pipelines: &PipelineCache) -> BindGroup {
        self.bind_group_with(Bound::Buffer(&self.uniforms), device, pipelines)
    }

    /// Group 1 of compute passes over a band.
    pub(crate) fn bind_group_of_band(
        &self,
        bands: &Bands,
        band: u32,
        device: &RenderDevice,
        pipelines: &PipelineCache,
    ) -> BindGroup {
        self.bind_group_with(bands.uniforms_of(band), device, pipelines)
    }

    /// There are two groups in turn, because the visibility buffers of this frame and the last one change roles.
    fn bind_group_with(&self, uniforms: Bound, device: &RenderDevice, pipelines: &PipelineCache) -> BindGroup {
        let [map, importance] = &self.environment_views;
        let views = [&self.visibility, map, importance, &self.counts].map(Bound::View);
        let bound = [uniforms, views[0], views[1], views[2], views[3]];
        self.view_groups.get("view", &bound, || {
            let [uniforms, visibility, map, importance, counts] = bound.map(Bound::resource);
            device.create_bind_group(
                "restir view",
                &pipelines.get_bind_group_layout(&view_layout()),
                &BindGroupEntries::sequential((uniforms, visibility, map, importance, counts)),
            )
        })
    }

    /// The state that the camera's next view takes over.
    pub(super) fn into_paused(self) -> PausedView {
        let sequence = match self.first_sequence {
            0 => self.sequence.wrapping_add(1),
            // No frame was rendered since this index was set.
            first => first,
        };
        let Self { counters, resets, previous_camera, key, settings, asked, environment, .. } = self;
        PausedView { counters, resets, sequence, previous_camera, key, settings, asked, environment }
    }

    /// This new view with the state of the last one.  `beginning`: why the history restarts.
    pub(super) fn resumed_from(self, last: PausedView, beginning: Reset) -> Self {
        let PausedView { counters, resets, sequence, previous_camera, key, settings, asked, environment } = last;
        let first_sequence = sequence;
        Self { counters, resets, first_sequence, previous_camera, key, settings, asked, environment, beginning, ..self }
    }

    /// Takes settings and pipelines for this frame, and decides whether it is rendered.
    pub(super) fn select(&mut self, restir: &ExtractedRestir, selection: &Selection, scene: &SceneBindings) {
        self.layers = restir.layers;
        self.settings = restir.settings.clone();
        self.asked = restir.asked.clone();
        self.environment = restir.environment;
        self.key = selection.key;
        self.key_is_requested = selection.key.is_some_and(|key| key.shows_pictures_of(selection.requested));
        self.composite = selection.composite;
        self.has_target = selection.has_target;
        self.rendered =
            self.composite.is_some() && self.key.is_some() && scene.bind_group.is_some() && !scene.lacks_memory;
        // A frame that was not rendered is missing from the history.
        if !core::mem::take(self.ran.get_mut()) && self.image_state.take().is_some() {
            self.first_sequence = self.sequence.wrapping_add(1);
        }
    }

    /// Creates, replaces or drops the history.  `limit`: bytes that the device can bind.  If the device has no memory for it, the frame is
    /// not rendered.
    pub(super) fn update_history(
        &mut self,
        scene: &SceneBindings,
        limit: u64,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Result<(), String> {
        let domains = self.key.map_or(&[][..], |key| key.frame.domains());
        if domains.is_empty() {
            self.drop_history();
            return Ok(());
        }
        let counts = self.light_path_counts(scene, limit);
        let has_images = self.key.is_some_and(|key| key.frame.has_images());
        let fits =
            self.history.as_ref().is_some_and(|history| history.fits(self.size, domains, &self.settings, counts));
        if !fits {
            // Drops the old history first, because the memory may not hold both.
            self.drop_history();
            let create = || History::new(self.size, domains, &self.settings, counts, has_images, device);
            let created = allocation::attempt(device, "history", create);
            let history = created.inspect_err(|_| self.rendered = false)?;
            self.history = Some(history);
        }
        let replaced = self.history.as_mut().filter(|history| !history.fits_passes(&self.settings, has_images));
        if let Some(history) = replaced {
            // Bind groups would keep the old textures alive.
            self.bind_groups.clear();
            history.replace_passes(&self.settings, has_images, device).inspect_err(|_| self.rendered = false)?;
        }
        let last = LastFrame {
            has_history: fits && self.frame > 0,
            moved: self.moved,
            same_densities: self.same_environment && scene.keeps_light_probabilities,
            still: self.still,
            same_rays: self.still && self.has_last_jitter,
        };
        let inputs = FrameInputs { last, counts };
        if let Some(history) = &mut self.history {
            // The visibility pass draws over the older of the two.
            core::mem::swap(&mut self.visibility, &mut history.previous_visibility);
            history.begin(&self.settings, inputs, queue);
        }
        Ok(())
    }

    /// Chooses the draw calls of the visibility pass.
    pub(super) fn update_draws(&mut self, scene: &SceneBindings, instances: &InstancePool, camera: GpuCamera) {
        self.visible.update(scene, instances, camera, self.size, self.layers);
    }

    fn drop_history(&mut self) {
        if self.history.take().is_some() {
            self.bind_groups.clear();
            self.view_groups.clear();
        }
    }

    /// Numbers of light sub-paths of this frame.  The camera does not see their vertices (no splats) in a scene with objects that only the
    /// camera sees (`NotShadowCaster`) or that only other rays see (`RestirMaterial`), because shadow rays there do not tell whether the
    /// camera sees a vertex.
    pub(super) fn light_path_counts(&self, scene: &SceneBindings, limit: u64) -> LightPathCounts {
        if !self.traces_light() {
            return LightPathCounts::default();
        }
        LightPathCounts::new(&self.settings.bdpt, self.size, limit, !scene.has_camera_dependent_objects)
    }

    /// Whether the passes of this frame trace light sub-paths.
    pub(super) fn traces_light(&self) -> bool {
        self.key.is_some_and(|key| traces_light(key.frame.domains()))
    }

    /// Names and bytes of the buffers and textures of this view.
    pub(crate) fn memory(&self) -> Vec<(&'static str, u64)> {
        let pixels = pixels(self.size);
        let mut memory = vec![
            ("view uniforms", size_of::<GpuViewUniforms>() as u64),
            ("visibility", pixels * 8),
            ("depth", pixels * 4),
            ("counts of pixels", pixels * 8),
            ("radiance", pixels * 16),
            ("counters", 2 * size_of::<GpuCounters>() as u64),
        ];
        memory.extend(self.bands.iter().map(|bands| ("uniforms of bands", bands.bytes())));
        memory.extend(self.shown.iter().map(|_| ("shown surfaces", Surfaces::bytes(self.target_size))));
        memory.extend(self.history.iter().flat_map(History::memory));
        memory
    }

    /// Number of light sub-paths of a frame.
    pub(crate) fn light_paths(&self) -> u64 {
        self.history.as_ref().and_then(|history| history.light_paths.as_ref()).map_or(0, LightPaths::count)
    }

    /// Bytes of reservoirs per pixel.
    pub(crate) fn reservoir_bytes_per_pixel(&self) -> u64 {
        self.history.as_ref().map_or(0, History::reservoir_bytes_per_pixel)
    }
}
