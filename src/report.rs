//! What the plugin did and holds, for anyone to read: counted on the GPU where it happens there, never estimated.

use bevy::{ecs::prelude::*, log::error_once};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::{
    frame::pipelines::{PassPipelines, PipelineReport},
    gpu_layout::{GpuCounters, OVERFLOW_STACK, OVERFLOW_STEPS},
    scene::{SceneFeatures, bindings::SceneBindings},
    view::{ViewPool, environment::EnvironmentPool},
};

/// The state of the plugin after the last frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RestirReport {
    /// Everything that the scene asks for is loaded, built and compiled: pictures are final from now on.
    pub ready: bool,
    /// `software`: rays are traced in compute shaders through a CWBVH; `hardware`: by the device's ray queries.
    pub backend: &'static str,
    /// What the scene contains.
    pub features: SceneFeatures,
    /// Rays that all cameras traced in a frame a little while ago: counters take their time from the GPU.
    pub rays: u64,
    /// Pixels of that frame whose radiance was not finite; they count as black.
    pub non_finite_pixels: u64,
    /// `OVERFLOW_*` bits of that frame: 0 unless a stack or a loop of a shader ended early.
    pub overflow_flags: u32,
    /// Scene bytes sent to the GPU in the last frame; 0 while nothing changes.
    pub uploaded_bytes: u64,
    /// Buffers and textures with their bytes.
    pub memory: Vec<(&'static str, u64)>,
    /// Bytes of reservoirs a pixel.
    pub reservoir_bytes_per_pixel: u64,
    /// Pipelines that are ready.
    pub pipelines: Vec<PipelineReport>,
    /// Triangles of all instances.
    pub triangles: u64,
    /// Instances that rays can meet.
    pub instances: u64,
    /// Lights that can be aimed at: emissive triangles and analytic lights, as many as the device can bind (1 048 576 where a binding
    /// holds 128 MiB).  Triangles beyond are found by chance: noisier, not darker, but where [`Direct::bsdf_candidate`](crate::Direct)
    /// is off.
    pub lights: u64,
    /// Frames that the last camera has gathered since its history was reset.
    pub samples: u32,
}

/// The shared report; a resource of the main world.
#[derive(Resource, Clone, Debug, Default)]
pub struct RestirStatistics(Arc<Mutex<RestirReport>>);

impl RestirStatistics {
    /// A copy of the newest report.
    pub fn report(&self) -> RestirReport {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, RestirReport> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// After the frame was submitted: brings the report up to date.
pub(crate) fn update_report(
    statistics: Res<RestirStatistics>,
    scene: Res<SceneBindings>,
    views: Res<ViewPool>,
    environments: Res<EnvironmentPool>,
    passes: Res<PassPipelines>,
) {
    let mut report = statistics.lock();
    report.ready = scene.ready && environments.ready && views.views.values().all(|v| v.rendered && v.key_is_requested);
    report.backend = if scene.features.contains(SceneFeatures::RAY_QUERY) { "hardware" } else { "software" };
    report.features = scene.features;
    report.uploaded_bytes = scene.uploaded_bytes;
    report.pipelines = passes.report();
    report.triangles = scene.triangles;
    report.instances = scene.instances;
    report.lights = scene.lights;
    report.memory = scene.memory.clone();
    report.memory.push(environments.memory());
    report.reservoir_bytes_per_pixel = 0;
    let mut counters = GpuCounters::default();
    for view in views.views.values().filter(|v| v.rendered) {
        view.counters.read();
        let newest = view.counters.newest();
        counters.rays = counters.rays.saturating_add(newest.rays);
        counters.non_finite_pixels += newest.non_finite_pixels;
        counters.overflow_flags |= newest.overflow_flags;
        report.memory.extend(view.memory());
        report.reservoir_bytes_per_pixel = report.reservoir_bytes_per_pixel.max(view.reservoir_bytes_per_pixel());
        report.samples = view.accumulated + 1;
        if let Some(key) = view.key {
            report.features |= key.features;
        }
    }
    report.features.remove(SceneFeatures::RAY_QUERY);
    report.memory.retain(|(_, bytes)| *bytes > 0);
    report.rays = counters.rays as u64;
    report.non_finite_pixels = counters.non_finite_pixels as u64;
    report.overflow_flags = counters.overflow_flags;
    if counters.overflow_flags & OVERFLOW_STACK != 0 {
        error_once!("restir: a traversal stack overflowed; some rays missed what they should have met");
    }
    if counters.overflow_flags & OVERFLOW_STEPS != 0 {
        error_once!("restir: a traversal took more steps than allowed; some rays missed what they should have met");
    }
    if counters.non_finite_pixels > 0 {
        error_once!("restir: {} pixels were not finite; they count as black", counters.non_finite_pixels);
    }
}
