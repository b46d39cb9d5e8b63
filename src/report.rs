//! Statistics of the plugin for apps and tests.  Shaders count their own work; nothing is estimated.

use bevy::{
    ecs::prelude::*,
    log::{error, warn},
};
use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use crate::{
    cpu_times::{CpuTimes, Stage},
    frame::pipelines::{PassPipelines, PipelineReport},
    gpu_layout::GpuCounters,
    scene::{SceneFeatures, bindings::SceneBindings},
    view::{
        RestirView, ViewPool,
        counters::{GuardRun, RayCounting},
        environment::EnvironmentPool,
        guards::GUARDS,
        image_state::ResetCounts,
    },
};

/// The state of the plugin after the last frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RestirReport {
    /// All assets of the scene are loaded or have failed, acceleration structures are built and pipelines are compiled: frames show the complete
    /// scene with the current settings.  In an app that edits a mesh or loads something in every frame it may never become true, because a mesh
    /// or an asset is always pending: give a loading screen a time limit there.
    pub ready: bool,
    /// `software`: compute shaders trace rays through a CWBVH; `hardware`: the device's ray queries do.
    pub backend: &'static str,
    /// Features of scene and cameras that shaders are specialized for, without `RAY_QUERY`: `backend` has that.
    pub features: SceneFeatures,
    /// Number of rays that all cameras traced in one frame; 0 unless [`RestirStatistics::count_rays`] asks for it.  The counters arrive from
    /// the GPU a few frames late.
    pub rays: u64,
    /// Number of light paths of a frame, of all cameras ([`Bdpt::light_paths`](crate::Bdpt::light_paths)); 0 for other techniques
    /// than [`Technique::Bdpt`](crate::Technique::Bdpt).
    pub light_paths: u64,
    /// Number of vertices of light paths that camera paths could be connected with, in the frame of [`rays`](Self::rays); counted with the
    /// rays, on request only.  0 without connections ([`Bdpt::techniques`](crate::Bdpt::techniques)).
    pub light_vertices: u64,
    /// Number of vertices of light paths that the cameras saw in that frame, also on request only.  Of a light path with more than three, all
    /// from the third on count as one, because one of them stands for all.
    pub splats: u64,
    /// Number of pixels of that frame whose radiance was not finite; they are treated as black.  0 unless there is a bug.
    pub non_finite_pixels: u64,
    /// Overflows of that frame; 0 unless light may be missing.  Bit 0: a traversal stack was full; bit 1: a traversal took too many steps, or
    /// too many light paths landed in a pixel; bit 19: a probe ray of [`Subsurface`](crate::Subsurface) had more than 8 hits.
    pub overflow_flags: u32,
    /// How often checks in the shaders failed: the name of each check, and the number of pixels that failed it, summed up over all frames
    /// of the cameras that exist now.  Most checks find illegal numbers, such as NaN or negative light, and replace them by 0; those named
    /// `overflow_...` find full stacks and loops that ended early.  All are 0 unless there is a bug, except `overflow_steps`, `overflow_probe`
    /// and `float_overflow` (light beyond the range of f32, about 1e38): extreme scenes raise these three, and the light that they count is
    /// missing in the picture.  A check costs a few integer comparisons.
    pub guards: Vec<(&'static str, u64)>,
    /// How often the histories of the cameras that exist now restarted, by reason:
    ///
    /// - `start`: the first frame, or the frame before was not rendered;
    /// - `requested`: [`Restir::reset`](crate::Restir::reset);
    /// - `scene`: an edit that histories do not survive;
    /// - `size`, `settings`, `render_layers`: a change of these;
    /// - `projection`: from perspective to orthographic or back, or `Camera::invert_culling` changed;
    /// - `pipelines`: the technique or the debug view changed, the first translucent object appeared or the last one disappeared, or shaders
    ///   have been compiled for the first light of a kind, the first material with a new kind of paths or the first object that render layers
    ///   hide.
    ///
    /// One frame may count for several reasons.  Techniques without a history count nothing.
    pub history_resets: Vec<(&'static str, u64)>,
    /// Number of steps by which [`RestirBudget`](crate::RestirBudget) reduces the settings of all cameras.  The first steps take samples
    /// away, as [`Restir::reduced`](crate::Restir::reduced) does.  Where that has no step left, further ones lower the traced resolution.
    pub budget_step: u32,
    /// CPU time of each stage of the last frame, ms: the plugin's own work, without the later work of Bevy and the driver.  Some stages may
    /// run in parallel, so that their sum may exceed the time that passes.
    pub cpu_ms: Vec<(&'static str, f32)>,
    /// How many elements of the scene the plugin looked at in the last frame, by kind.  All are 0 while nothing changes, apart from skinned
    /// and morphed instances, images that the GPU writes, and elements that wait for a missing asset or do not fit the device.
    pub visited: Vec<(&'static str, u64)>,
    /// Bytes of scene data uploaded in the last frame; 0 while nothing changes.
    pub uploaded_bytes: u64,
    /// Names of GPU buffers and textures of this plugin with their sizes in bytes.
    pub memory: Vec<(&'static str, u64)>,
    /// Bytes of reservoirs per traced pixel, over all domains and both frames; the largest of all cameras.
    pub reservoir_bytes_per_pixel: u64,
    /// Compiled pipelines.
    pub pipelines: Vec<PipelineReport>,
    /// Number of triangles of all instances.
    pub triangles: u64,
    /// Number of rendered instances.
    pub instances: u64,
    /// Number of lights in the light table: emissive triangles and analytic lights, as many as the device can bind (1,048,576 where a binding
    /// holds 128 MiB).  Only BSDF sampling finds emissive triangles beyond that: the image is noisier but not darker, unless
    /// [`Direct::bsdf_candidate`](crate::Direct::bsdf_candidate) is off.
    pub lights: u64,
    /// Number of frames in the average of a camera since its accumulation restarted; with several cameras, of an arbitrary one; 0 while no
    /// camera is rendered.
    pub samples: u32,
}

impl RestirReport {
    /// Bytes of all GPU buffers and textures of this plugin.
    pub fn memory_bytes(&self) -> u64 {
        self.memory.iter().map(|(_, bytes)| bytes).sum()
    }

    /// The entries of [`guards`](Self::guards) that are not 0.
    pub fn raised_guards(&self) -> Vec<(&'static str, u64)> {
        self.guards.iter().copied().filter(|(_, pixels)| *pixels > 0).collect()
    }
}

/// Access to the newest [`RestirReport`]; a resource of the main world.  Clones share the report.
#[derive(Resource, Clone, Debug, Default)]
pub struct RestirStatistics(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    report: Mutex<RestirReport>,
    run: GuardRun,
    ray_counting: RayCounting,
    /// In the last frame every camera was rendered by the pipelines that scene and settings ask for.
    shows_settings: AtomicBool,
    /// In the last frame a camera was rendered.
    renders: AtomicBool,
    /// The first requirement that the present device does not meet; `None` if it meets all.
    missing: Mutex<Option<&'static str>>,
}

impl RestirStatistics {
    /// Whether the scene is loaded and all pipelines are compiled ([`RestirReport::ready`]): for loading screens.
    pub fn is_ready(&self) -> bool {
        self.lock().ready
    }

    /// A copy of the newest report; the default before the first frame.
    pub fn report(&self) -> RestirReport {
        self.lock().clone()
    }

    /// Whether every camera was rendered by the pipelines that scene and settings ask for, in the last frame.  Unlike
    /// [`ready`](RestirReport::ready), it does not wait for meshes and assets.
    pub(crate) fn shows_settings(&self) -> bool {
        self.0.shows_settings.load(Ordering::Relaxed)
    }

    pub(crate) fn set_shows_settings(&self, shows: bool) {
        self.0.shows_settings.store(shows, Ordering::Relaxed);
    }

    /// Whether a camera was rendered in the last frame.
    pub(crate) fn renders(&self) -> bool {
        self.0.renders.load(Ordering::Relaxed)
    }

    pub(crate) fn set_renders(&self, renders: bool) {
        self.0.renders.store(renders, Ordering::Relaxed);
    }

    /// Counts the rays of all cameras from the next frames on ([`RestirReport::rays`]), and the vertices of light paths
    /// ([`RestirReport::light_vertices`], [`RestirReport::splats`]), or stops counting them.  Nothing is counted by default.  Counting leaves
    /// pictures and histories as they are.  It takes one more pass, and each pass that traces rays adds to a number in memory for each pixel.
    /// Cameras need other pipelines for it: ask before the first frame if possible, because the count stays as it was while those are compiled.
    /// [`DebugView::Rays`](crate::DebugView::Rays) and [`DebugView::Guards`](crate::DebugView::Guards) count rays in any case.
    pub fn count_rays(&self, is_on: bool) {
        self.0.ray_counting.set(is_on);
    }

    /// Starts a new run: [`RestirReport::guards`] count from the next frame on.
    pub fn reset_guards(&self) {
        self.0.run.start_next();
        self.lock().guards.iter_mut().for_each(|(_, pixels)| *pixels = 0);
    }

    pub(crate) fn set_budget_step(&self, step: u32) {
        self.lock().budget_step = step;
    }

    /// Stores the first requirement that the present device does not meet.
    pub(crate) fn set_missing(&self, missing: Option<&'static str>) {
        *self.0.missing.lock().unwrap_or_else(PoisonError::into_inner) = missing;
    }

    /// The first requirement that the present device does not meet.
    pub(crate) fn missing(&self) -> Option<&'static str> {
        *self.0.missing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The run that guards are counted for.
    pub(crate) fn guard_run(&self) -> &GuardRun {
        &self.0.run
    }

    /// Whether the app wants to know rays.
    pub(crate) fn ray_counting(&self) -> &RayCounting {
        &self.0.ray_counting
    }

    fn lock(&self) -> MutexGuard<'_, RestirReport> {
        self.0.report.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Updates the report after the frame was submitted.
pub(crate) fn update_report(
    statistics: Res<RestirStatistics>,
    scene: Res<SceneBindings>,
    views: Res<ViewPool>,
    environments: Res<EnvironmentPool>,
    passes: Res<PassPipelines>,
    times: Res<CpuTimes>,
    mut reported: Local<Vec<&'static str>>,
) {
    // This stage is reported in the next frame.
    let cpu_ms = times.take();
    let _running = times.measure(Stage::Report);
    let run = statistics.guard_run().current();
    let mut report = statistics.lock();
    report.cpu_ms = cpu_ms;
    // A camera for which the device has no memory is lit by Bevy; the app does not wait for it.
    let is_shown = |(camera, view): &(&Entity, &RestirView)| {
        view.has_target && (scene.lacks_memory || !views.without_memory.contains(*camera))
    };
    let shows_settings = views.views.iter().filter(is_shown).all(|(_, view)| view.rendered && view.key_is_requested);
    statistics.set_shows_settings(shows_settings);
    statistics.set_renders(views.views.values().any(|view| view.rendered));
    report.ready = scene.ready && environments.ready && shows_settings;
    passes.update_report(&mut report.pipelines);
    report_scene(&mut report, &scene);
    report.memory.push(environments.memory());
    report_views(&mut report, &views);
    report_counters(&mut report, &views, run);
    report.memory.retain(|(_, bytes)| *bytes > 0);
    log_guards(&report.guards, &mut reported);
}

fn report_scene(report: &mut RestirReport, scene: &SceneBindings) {
    report.backend = if scene.features.contains(SceneFeatures::RAY_QUERY) { "hardware" } else { "software" };
    report.features = scene.features.difference(SceneFeatures::RAY_QUERY);
    report.uploaded_bytes = scene.uploaded_bytes;
    report.visited.clone_from(&scene.visited);
    report.triangles = scene.triangles;
    report.instances = scene.instances;
    report.lights = scene.lights;
    report.memory = scene.memory.clone();
}

/// Adds the memory and the features of the rendered views.
fn report_views(report: &mut RestirReport, views: &ViewPool) {
    report.reservoir_bytes_per_pixel = 0;
    report.samples = 0;
    report.light_paths = 0;
    for view in views.views.values().filter(|view| view.rendered) {
        report.memory.extend(view.memory());
        report.reservoir_bytes_per_pixel = report.reservoir_bytes_per_pixel.max(view.reservoir_bytes_per_pixel());
        report.samples = view.accumulated + 1;
        report.light_paths += view.light_paths();
        report.features |= view.key.unwrap_or_default().features.difference(SceneFeatures::RAY_QUERY);
    }
}

/// Adds up the counters: rays and broken pixels of the rendered views; resets and guards of all cameras.
fn report_counters(report: &mut RestirReport, views: &ViewPool, run: u32) {
    let mut resets = ResetCounts::default();
    let mut counters = GpuCounters::default();
    let mut guards: Vec<_> = GUARDS.iter().map(|guard| (guard.name, 0)).collect();
    let mut count = |of_camera: &ResetCounts, newest: &GpuCounters| {
        resets.add(of_camera);
        for ((_, pixels), guard) in guards.iter_mut().zip(GUARDS) {
            *pixels += u64::from(newest.guards[guard.bit.trailing_zeros() as usize]);
        }
    };
    for paused in views.paused.values() {
        count(&paused.resets, &paused.counters.newest(run));
    }
    for view in views.views.values() {
        view.counters.read();
        let newest = view.counters.newest(run);
        count(&view.resets, &newest);
        if view.rendered {
            counters.rays = counters.rays.saturating_add(newest.rays);
            counters.light_vertices = counters.light_vertices.saturating_add(newest.light_vertices);
            counters.splats = counters.splats.saturating_add(newest.splats);
            counters.non_finite_pixels += newest.non_finite_pixels;
            counters.overflow_flags |= newest.overflow_flags;
        }
    }
    report.rays = counters.rays as u64;
    report.light_vertices = counters.light_vertices as u64;
    report.splats = counters.splats as u64;
    report.non_finite_pixels = counters.non_finite_pixels as u64;
    report.overflow_flags = counters.overflow_flags;
    report.history_resets = resets.named().collect();
    report.guards = guards;
}

/// Logs each guard once, when it is raised first.
fn log_guards(guards: &[(&'static str, u64)], reported: &mut Vec<&'static str>) {
    for (guard, (name, pixels)) in GUARDS.iter().zip(guards) {
        if *pixels > 0 && !reported.contains(name) {
            reported.push(name);
            let message = format!("restir: guard `{name}` was raised by {pixels} pixels so far: {}", guard.meaning);
            match guard.is_bug {
                true => error!("{message}.  This is a bug of bevy_restir; please report it"),
                false => warn!("{message}"),
            }
        }
    }
}
