//! A whole Bevy app without a window: the plugin as users run it, one camera, and its radiance read back in full precision.

use bevy::{
    asset::UnapprovedPathMode,
    camera::{Exposure, ImageRenderTarget, RenderTarget},
    ecs::{
        component::Mutable,
        schedule::{ScheduleLabel, Schedules, SingleThreadedExecutor},
    },
    log::LogPlugin,
    prelude::*,
    render::{
        ExtractSchedule, RenderApp, RenderPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        render_resource::{CachedPipelineState, PipelineCache, PollType},
        renderer::RenderDevice,
        settings::{Backends, WgpuFeatures, WgpuLimits, WgpuSettings},
    },
    shader::ShaderCacheError,
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_restir::{
    DebugView, Denoiser, Direct, EmissiveLuminance, Jitter, Paths, RadianceCapture, RayBackend, Restir,
    RestirEnvironment, RestirPlugin, RestirReport, RestirStatistics, Reuse, Technique,
    testing::{
        check_mirror, geometry::world_tree::share_a_tree_at_rest, plant_shader_edits, shader_library::ShaderEdit,
    },
};
use bevy_restir_support::mutant;
use std::time::{Duration, Instant};

use super::{devices::Lease, reuse_settings::paths};
pub use super::{images::*, picture::Picture, stats::mean_and_error};

/// The start of the message of a test that ends because of an error in a shader.
pub const SHADER_ERROR: &str = "a shader does not compile";

/// The number of frames within which a small scene must be loaded, built and compiled.
const PATIENCE: u32 = 2000;
/// The time that they may take where pipelines compile in the background.
const PATIENT_TIME: Duration = Duration::from_secs(300);

/// The app, its `Restir` camera and the target of that camera.
pub struct Rig {
    pub app: App,
    pub camera: Entity,
    pub target: Handle<Image>,
    pub capture: RadianceCapture,
    /// The name of a scene whose references are shared by the tests of this process.
    pub shared: Option<String>,
    /// The device goes to the next test when the app is gone: fields are dropped in order.
    _device: Lease,
}

/// The settings of most tests: the reference, no jitter, direct light only, no energy compensation, no limit of bright pixels.  Other techniques
/// reuse the last frame alone: few passes, which compile quickly.
pub fn plain() -> Restir {
    let technique = Technique::Reference;
    let of_last_frame = |reuse: Reuse| Reuse { spatial_samples: 0, disocclusion_samples: 0, ..reuse };
    Restir {
        technique,
        jitter: Jitter::Never,
        bounces: 1,
        energy_compensation: false,
        firefly_limit: 0.0,
        denoiser: Denoiser::OFF,
        direct: Direct { reuse: of_last_frame(Reuse::DIRECT), ..Direct::default() },
        paths: Paths { reuse: of_last_frame(Reuse::PATHS), ..paths::unified() },
        ..Default::default()
    }
}

/// An opaque diffuse material.
pub fn lambert(albedo: f32) -> StandardMaterial {
    StandardMaterial { perceptual_roughness: 1.0, reflectance: 0.0, ..Color::linear_rgb(albedo, albedo, albedo).into() }
}

/// An emitter that reflects nothing, with its front side only.
pub fn lamp(r: f32, g: f32, b: f32) -> StandardMaterial {
    StandardMaterial { base_color: Color::BLACK, emissive: LinearRgba::rgb(r, g, b), ..lambert(0.0) }
}

/// Uniform radiance from all directions.
pub fn sky(radiance: f32) -> RestirEnvironment {
    RestirEnvironment { color: LinearRgba::rgb(radiance, radiance, radiance), ..Default::default() }
}

/// A square with this side that faces +Z.
pub fn square(side: f32) -> Mesh {
    Rectangle::new(side, side).into()
}

/// An orthographic projection with this width and height in world space.
pub fn orthographic(width: f32, height: f32) -> Projection {
    Projection::Orthographic(OrthographicProjection {
        scaling_mode: bevy::camera::ScalingMode::Fixed { width, height },
        ..OrthographicProjection::default_3d()
    })
}

/// Exposure 1: the view target holds the radiance.
pub fn unit_exposure() -> Exposure {
    Exposure { ev100: (1.0f32 / 1.2).log2() }
}

/// Silences Mesa's device-select layer, which complains where there is no compositor.
fn silence_mesa() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
            // SAFETY: the C library locks its environment against its own functions only; nothing here reads it by pointer meanwhile.
            unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
        }
    });
}

/// Returns the freed memory of earlier tests to the system.  glibc would keep it: compilers of pipelines leave it in small pieces, 18 GB
/// after 350 tests.
fn return_freed_memory() {
    // SAFETY: it takes the locks of the allocator, and has no precondition.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::malloc_trim(0);
    }
}

/// Runs the systems of an app in the thread of its test.  Bevy's pool has one thread on two cores and belongs to the process: a test that
/// compiles pipelines would stop the frames of all others.  Apps that compile in the background keep Bevy's executor, as users have it.
fn run_systems_in_this_thread(app: &mut App) {
    for sub_app in app.sub_apps_mut().iter_mut() {
        let Some(mut schedules) = sub_app.world_mut().get_resource_mut::<Schedules>() else { continue };
        for (_, schedule) in schedules.iter_mut() {
            // The render world applies the commands of the extraction.
            let applies_commands = schedule.label() != ExtractSchedule.intern();
            schedule.set_executor(SingleThreadedExecutor::new()).set_apply_final_deferred(applies_commands);
        }
    }
}

/// How an app starts.
pub struct Start {
    /// Pipelines are ready one frame after their request, instead of compiling in the background.
    pub synchronous: bool,
    /// The limits of the device; `None`: those of the adapter.
    pub limits: Option<WgpuLimits>,
    /// Features that the device must not have.
    pub lacks: WgpuFeatures,
    pub backend: RayBackend,
    /// `RestirPlugin` is added before Bevy's plugins.
    pub before_bevy: bool,
}

impl Default for Start {
    fn default() -> Self {
        Self {
            synchronous: true,
            limits: None,
            lacks: WgpuFeatures::empty(),
            backend: usual_back_end(),
            before_bevy: false,
        }
    }
}

fn headless(start: Start, more: impl FnOnce(&mut App)) -> (App, Lease) {
    let Start { synchronous, limits, lacks, backend, before_bevy } = start;
    // Tests of the compilation in the background need pipelines that are not compiled.
    let shares_device = synchronous && limits.is_none() && lacks.is_empty();
    let mut lease = if shares_device { Lease::take() } else { Lease::none() };
    let settings = || WgpuSettings {
        backends: Some(Backends::PRIMARY),
        constrained_limits: limits,
        disabled_features: Some(lacks),
        ..Default::default()
    };
    let mut app = App::new();
    if before_bevy {
        app.add_plugins(RestirPlugin { backend });
    }
    app.add_plugins(
        DefaultPlugins
            .set(RenderPlugin {
                synchronous_pipeline_compilation: synchronous,
                render_creation: lease.creation().unwrap_or_else(|| settings().into()),
                ..Default::default()
            })
            .set(AssetPlugin {
                file_path: concat!(env!("CARGO_MANIFEST_DIR"), "/../assets").into(),
                // Tests write files of their own.
                unapproved_path_mode: UnapprovedPathMode::Allow,
                ..Default::default()
            })
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..Default::default() })
            .disable::<LogPlugin>()
            .disable::<WinitPlugin>()
            .disable::<PipelinedRenderingPlugin>(),
    );
    if !before_bevy {
        app.add_plugins(RestirPlugin { backend });
    }
    app.insert_resource(EmissiveLuminance(1.0))
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)));
    more(&mut app);
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    if synchronous {
        run_systems_in_this_thread(&mut app);
    }
    if shares_device {
        lease.connect(&mut app);
    }
    app.world().resource::<RestirStatistics>().count_rays(true);
    check_mirror(&mut app, true);
    // Hits in a shared tree round differently, and which instances share one depends on the number of frames: two apps would show the same
    // scene with different bits.  Scenes of `assets/scenes` and tests of that tree share it ([`Rig::share_a_tree_at_rest`]).
    share_a_tree_at_rest(&mut app, false);
    if !mutant::edits().is_empty() {
        plant_shader_edits(&mut app, mutant::edits());
    }
    (app, lease)
}

/// Plants edits of shaders in place of those of before.  The mutant of this process stays.
pub fn plant_edits(app: &mut App, edits: &[ShaderEdit]) {
    plant_shader_edits(app, &[mutant::edits(), edits].concat());
}

/// The ray back end of tests that do not choose one.  `RAY_BACKEND=hardware` runs all of them with ray queries.
fn usual_back_end() -> RayBackend {
    match std::env::var("RAY_BACKEND").as_deref() {
        Ok("hardware") => RayBackend::Hardware,
        _ => RayBackend::Auto,
    }
}

impl Rig {
    /// An empty scene, and a camera with [`plain`] settings at (0, 0, 5) that looks down -Z.  `None`, with a message, if there is no
    /// adapter; with `CI=true` that is a failure.
    pub fn new(width: u32, height: u32) -> Option<Self> {
        Self::lacking(WgpuFeatures::empty(), width, height)
    }

    /// Like [`Self::new`], with ray queries.  `None`, with a message, if the adapter has none.
    pub fn tracing_by_ray_queries(width: u32, height: u32) -> Option<Self> {
        super::gpu::ray_gpu()?;
        Self::starting(Start { backend: RayBackend::Hardware, ..default() }, width, height)
    }

    /// Like [`Self::new`], but pipelines compile in the background, as in apps with a window.
    pub fn compiling_in_background(width: u32, height: u32) -> Option<Self> {
        Self::starting(Start { synchronous: false, ..default() }, width, height)
    }

    /// Like [`Self::new`], on a device with WebGPU's limits and storage bindings of at most this many bytes.
    pub fn binding_at_most(bytes: u64, width: u32, height: u32) -> Option<Self> {
        Self::limited(WgpuLimits { max_storage_buffer_binding_size: bytes, ..default() }, width, height)
    }

    /// Like [`Self::new`], on a device with these limits.
    pub fn limited(limits: WgpuLimits, width: u32, height: u32) -> Option<Self> {
        // Where the device has arrays of textures, Bevy's materials use them, for which these limits have no room.
        let lacks = WgpuFeatures::TEXTURE_BINDING_ARRAY;
        let start = Start { limits: Some(limits), lacks, backend: RayBackend::Software, ..default() };
        Self::starting(start, width, height)
    }

    /// Like [`Self::new`], on a device without these features.
    pub fn lacking(lacks: WgpuFeatures, width: u32, height: u32) -> Option<Self> {
        Self::starting(Start { lacks, ..default() }, width, height)
    }

    /// Like [`Self::new`], with additional plugins.
    pub fn beside(more: impl FnOnce(&mut App), width: u32, height: u32) -> Option<Self> {
        Self::with(Start::default(), width, height, more)
    }

    /// Like [`Self::new`], for an app that starts in this way.
    pub fn starting(start: Start, width: u32, height: u32) -> Option<Self> {
        Self::with(start, width, height, |_| ())
    }

    fn with(start: Start, width: u32, height: u32, more: impl FnOnce(&mut App)) -> Option<Self> {
        silence_mesa();
        return_freed_memory();
        super::gpu::gpu()?;
        let (mut app, device) = headless(start, more);
        let target = app.world_mut().resource_mut::<Assets<Image>>().add(target_image(UVec2::new(width, height)));
        let capture = RadianceCapture::default();
        let camera = app
            .world_mut()
            .spawn((
                Camera3d::default(),
                RenderTarget::Image(ImageRenderTarget::from(target.clone())),
                Transform::from_xyz(0.0, 0.0, 5.0),
                unit_exposure(),
                plain(),
                capture.clone(),
            ))
            .id();
        Some(Self { app, camera, target, capture, shared: None, _device: device })
    }

    pub fn add<A: Asset>(&mut self, asset: impl Into<A>) -> Handle<A> {
        self.app.world_mut().resource_mut::<Assets<A>>().add(asset)
    }

    /// Spawns a mesh with its own material.
    pub fn spawn(&mut self, mesh: impl Into<Mesh>, material: StandardMaterial, transform: Transform) -> Entity {
        let (mesh, material) = (self.add::<Mesh>(mesh), self.add::<StandardMaterial>(material));
        self.spawn_bundle((Mesh3d(mesh), MeshMaterial3d(material), transform))
    }

    pub fn spawn_bundle(&mut self, bundle: impl Bundle) -> Entity {
        self.app.world_mut().spawn(bundle).id()
    }

    pub fn get_mut<C: Component<Mutability = Mutable>>(&mut self, entity: Entity) -> Mut<'_, C> {
        self.app.world_mut().get_mut::<C>(entity).expect("the entity has the component")
    }

    pub fn insert(&mut self, entity: Entity, bundle: impl Bundle) {
        self.app.world_mut().entity_mut(entity).insert(bundle);
    }

    /// Changes the settings of the camera.
    pub fn set(&mut self, change: impl FnOnce(&mut Restir)) {
        change(&mut self.get_mut::<Restir>(self.camera));
    }

    /// Changes an asset, which sends the usual events.
    pub fn edit<A: Asset>(&mut self, handle: &Handle<A>, change: impl FnOnce(&mut A)) {
        let mut assets = self.app.world_mut().resource_mut::<Assets<A>>();
        change(&mut assets.get_mut(handle).expect("the asset exists"));
    }

    /// The material of an entity.
    pub fn material_of(&self, entity: Entity) -> Handle<StandardMaterial> {
        self.app.world().get::<MeshMaterial3d<StandardMaterial>>(entity).expect("the entity has a material").0.clone()
    }

    /// The width and height of the camera's target, in pixels.
    pub fn size(&self) -> UVec2 {
        let images = self.app.world().resource::<Assets<Image>>();
        images.get(&self.target).expect("the target exists").size()
    }

    pub fn report(&self) -> RestirReport {
        self.app.world().resource::<RestirStatistics>().report()
    }

    /// Lets instances that rest share a tree, as they do for users.
    pub fn share_a_tree_at_rest(&mut self) {
        share_a_tree_at_rest(&mut self.app, true);
    }

    /// Renders one frame and waits for it.
    pub fn frame(&mut self) {
        self.app.update();
        let polled = self.app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
        assert!(polled.is_ok(), "the device is lost");
        assert!(
            self.app.should_exit().is_none(),
            "Bevy quits after an error of the renderer: {}",
            super::log::warnings("").join("\n")
        );
    }

    pub fn frames(&mut self, count: u32) {
        for _ in 0..count {
            self.frame();
        }
    }

    /// Renders frames until the scene is loaded, built and compiled.
    pub fn until_ready(&mut self) -> RestirReport {
        // A change is extracted in the first frame and reported in the second.
        self.frames(2);
        let (start, mut frames) = (Instant::now(), 0);
        loop {
            let report = self.report();
            if report.ready && report.samples > 0 {
                return report;
            }
            self.assert_shaders_compile();
            // Thousands of frames pass while a busy machine compiles in the background.
            assert!(frames < PATIENCE || start.elapsed() < PATIENT_TIME, "not ready after {frames} frames: {report:?}");
            self.frame();
            frames += 1;
        }
    }

    /// Bevy logs an error in a shader and never builds its pipeline, so that a test would wait in vain.
    fn assert_shaders_compile(&self) {
        for pipeline in self.app.sub_app(RenderApp).world().resource::<PipelineCache>().pipelines() {
            use ShaderCacheError::{CreateShaderModule, ProcessShaderError};
            if let CachedPipelineState::Err(error @ (CreateShaderModule(_) | ProcessShaderError(_))) = &pipeline.state {
                panic!("{SHADER_ERROR}: {error}");
            }
        }
    }

    /// The radiance of the next frame, including accumulated frames.
    pub fn next(&mut self) -> Picture {
        self.next_if_any().expect("the frame was rendered")
    }

    /// Like [`Self::next`]; `None` if the camera renders nothing.
    pub fn next_if_any(&mut self) -> Option<Picture> {
        self.capture.request();
        self.frame();
        let captured = self.capture.take()?;
        Some(Picture { size: captured.size, pixels: captured.mean().collect(), samples: captured.samples() })
    }

    /// Resets the history when the scene is ready, and returns the mean of `frames` frames.
    pub fn picture(&mut self, frames: u32) -> Picture {
        self.until_ready();
        self.set(|restir| restir.reset = true);
        self.frames(frames - 1);
        self.next()
    }

    /// Mean and standard error of the means of pictures with these seeds, each of `frames` accumulated frames.
    pub fn mean_over(&mut self, seeds: core::ops::Range<u32>, frames: u32) -> (f64, f64) {
        self.set(|restir| restir.accumulate = true);
        let means: Vec<f64> = seeds
            .map(|seed| {
                self.set(|restir| restir.seed = seed);
                self.picture(frames).mean()
            })
            .collect();
        mean_and_error(means)
    }

    /// One frame of a debug view.
    pub fn debug(&mut self, view: DebugView) -> Picture {
        self.set(|restir| restir.debug_view = view);
        let picture = self.picture(1);
        self.set(|restir| restir.debug_view = DebugView::Off);
        picture
    }

    /// Asserts that no frame since the start of the camera, or since [`Self::reset_guards`], raised a guard.
    pub fn assert_sound(&mut self) {
        self.assert_raised(&[]);
    }

    /// Asserts that the frames since the start of the camera, or since [`Self::reset_guards`], raised these guards and no others.
    pub fn assert_raised(&mut self, names: &[&str]) {
        // The counters of a frame arrive while the tests wait for the GPU, and the next frame reports them.
        self.frames(2);
        let report = self.report();
        assert!(!report.guards.is_empty(), "no frame was counted");
        let raised: Vec<&str> = report.raised_guards().iter().map(|(name, _)| *name).collect();
        assert_eq!(raised, names, "{:?}", report.raised_guards());
    }

    /// Counts guards from the next frame on.
    pub fn reset_guards(&mut self) {
        self.app.world().resource::<RestirStatistics>().reset_guards();
    }

    /// The 8-bit pixels of the camera's target, with `Restir` and by Bevy's own renderer.
    pub fn beside_bevy(&mut self) -> [Vec<[u8; 4]>; 2] {
        let target = self.target.clone();
        self.picture(1);
        let ours = self.drawn(&target);
        let settings = self.app.world_mut().entity_mut(self.camera).take::<Restir>().expect("it has some");
        self.frames(4);
        let bevys = self.drawn(&target);
        self.insert(self.camera, settings);
        [ours, bevys]
    }

    /// The 8-bit pixels that Bevy wrote to the target of a camera.
    pub fn drawn(&mut self, target: &Handle<Image>) -> Vec<[u8; 4]> {
        use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
        #[derive(Resource, Default)]
        struct Taken(Option<Image>);
        self.app.insert_resource(Taken(None));
        self.app.world_mut().spawn(Screenshot::image(target.clone())).observe(
            |captured: On<ScreenshotCaptured>, mut taken: ResMut<Taken>| taken.0 = Some(captured.image.clone()),
        );
        for _ in 0..PATIENCE {
            self.frame();
            if let Some(image) = self.app.world_mut().resource_mut::<Taken>().0.take() {
                return image.data.expect("a screenshot has data").as_chunks::<4>().0.to_vec();
            }
        }
        panic!("no screenshot came back");
    }
}
