//! A whole Bevy app without a window: the plugin as users run it, one camera, and its radiance read back in full precision.

use bevy::{
    camera::{Exposure, ImageRenderTarget, RenderTarget},
    ecs::component::Mutable,
    prelude::*,
    render::{
        RenderApp,
        render_resource::{CachedPipelineState, PipelineCache, PollType},
        renderer::RenderDevice,
        settings::{WgpuFeatures, WgpuLimits},
    },
    shader::ShaderCacheError,
};
use bevy_restir::{
    DebugView, Denoiser, Direct, Jitter, Paths, RadianceCapture, RayBackend, Restir, RestirEnvironment, RestirReport,
    RestirStatistics, Reuse, Technique,
    testing::{geometry::world_tree::share_a_tree_at_rest, plant_shader_edits, shader_library::ShaderEdit},
};
use bevy_restir_support::mutant;
use std::{
    thread,
    time::{Duration, Instant},
};

use super::{
    devices::Lease,
    reuse_settings::paths,
    start::{headless, return_freed_memory, silence_mesa},
};
pub use super::{images::*, picture::Picture, start::Start, stats::mean_and_error};

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

/// Plants edits of shaders in place of those of before.  The mutant of this process stays.
pub fn plant_edits(app: &mut App, edits: &[ShaderEdit]) {
    plant_shader_edits(app, &[mutant::edits(), edits].concat());
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

    /// Like [`Self::new`], but the render world has a thread of its own ([`Start::pipelined`]).
    pub fn pipelined(width: u32, height: u32) -> Option<Self> {
        Self::starting(Start { pipelined: true, ..default() }, width, height)
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

    /// Whether the render world has a thread of its own.
    fn is_pipelined(&self) -> bool {
        self.app.get_sub_app(RenderApp).is_none()
    }

    /// Renders one frame and waits for it.  Where the render world has a thread of its own, it works on the frame afterwards.
    pub fn frame(&mut self) {
        self.app.update();
        if !self.is_pipelined() {
            let polled = self.app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
            assert!(polled.is_ok(), "the device is lost");
        }
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
        // A change is extracted in the first frame and reported in the second, which may still be rendered after a third has begun.
        self.frames(if self.is_pipelined() { 4 } else { 2 });
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
        let Some(render_app) = self.app.get_sub_app(RenderApp) else { return };
        for pipeline in render_app.world().resource::<PipelineCache>().pipelines() {
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
        let (start, mut captured) = (Instant::now(), self.capture.take());
        while self.is_pipelined() && captured.is_none() && start.elapsed() < PATIENT_TIME {
            thread::sleep(Duration::from_millis(1));
            captured = self.capture.take();
        }
        let captured = captured?;
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
        // The counters of a frame arrive while the tests wait for the GPU, and the next frame reports them.  Nobody waits for the GPU where
        // the render world has a thread of its own.
        self.frames(if self.is_pipelined() { 8 } else { 2 });
        let report = self.report();
        assert!(!report.guards.is_empty(), "no frame was counted");
        let raised: Vec<&str> = report.raised_guards().iter().map(|(name, _)| *name).collect();
        assert_eq!(raised, names, "{:?}", report.raised_guards());
    }

    /// Counts guards from the next frame on.
    pub fn reset_guards(&mut self) {
        self.app.world().resource::<RestirStatistics>().reset_guards();
    }

    /// Lets Bevy's own renderer light the camera meanwhile.
    pub fn without_restir<T>(&mut self, look: impl FnOnce(&mut Self) -> T) -> T {
        let settings = self.app.world_mut().entity_mut(self.camera).take::<Restir>().expect("it has some");
        self.frames(4);
        let seen = look(self);
        self.insert(self.camera, settings);
        seen
    }

    /// The 8-bit pixels of the camera's target, with `Restir` and by Bevy's own renderer.
    pub fn beside_bevy(&mut self) -> [Vec<[u8; 4]>; 2] {
        let target = self.target.clone();
        self.picture(1);
        let ours = self.drawn(&target);
        let bevys = self.without_restir(|rig| rig.drawn(&target));
        [ours, bevys]
    }

    /// The colors that Bevy wrote to the camera's target, which is a [`float_target`].
    pub fn drawn_light(&mut self) -> Vec<Vec3> {
        let target = self.target.clone();
        let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&self.screenshot(&target));
        pixels.into_iter().map(|[r, g, b, _]| Vec3::new(r, g, b)).collect()
    }

    /// The 8-bit pixels that Bevy wrote to the target of a camera.
    pub fn drawn(&mut self, target: &Handle<Image>) -> Vec<[u8; 4]> {
        self.screenshot(target).as_chunks::<4>().0.to_vec()
    }

    fn screenshot(&mut self, target: &Handle<Image>) -> Vec<u8> {
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
                return image.data.expect("a screenshot has data");
            }
        }
        panic!("no screenshot came back");
    }
}
