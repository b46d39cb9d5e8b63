//! Chooses how far the settings of cameras are reduced, so that the GPU time of lighting stays within [`RestirBudget`].

mod controller;

use bevy::{
    diagnostic::{Diagnostic, DiagnosticsStore},
    ecs::prelude::*,
    log::warn_once,
    platform::time::Instant,
};
use std::collections::BTreeMap;

use crate::{
    frame::SPAN_PREFIX,
    report::RestirStatistics,
    settings::{Reduction, Restir, RestirBudget, least_scale},
};
use controller::Controller;

/// Number of frames without any GPU time after which a warning is logged.  The first times arrive within a few frames.
const PATIENCE: u32 = 120;

/// All settings that the time of a frame depends on.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Workload {
    cameras: Vec<Restir>,
    least_resolution_scale: f32,
}

impl Workload {
    fn of(cameras: &Query<(Entity, &Restir)>, budget: &RestirBudget) -> Self {
        // Inactive cameras count, too: one that renders every second frame must not restart the measurement each time.
        let by_camera: BTreeMap<Entity, &Restir> = cameras.iter().collect();
        let least_resolution_scale = least_scale(budget.least_resolution_scale);
        Self { cameras: by_camera.into_values().map(cost_of).collect(), least_resolution_scale }
    }

    /// All that the steps can take away from its cameras.
    fn most_reduction(&self) -> Reduction {
        let of_cameras = self.cameras.iter().map(|settings| settings.most_reduction(self.least_resolution_scale));
        let none = Reduction { least_resolution_scale: self.least_resolution_scale, ..Reduction::default() };
        of_cameras.fold(none, |all, one| Reduction {
            samples: all.samples.max(one.samples),
            pixels: all.pixels.max(one.pixels),
            ..all
        })
    }
}

/// The GPU times that have arrived.
#[derive(Debug, Default)]
pub(crate) struct GpuTimes {
    /// When the newest ones arrived.
    newest: Option<Instant>,
    /// Number of frames that were rendered while none had arrived.
    frames_without: u32,
}

impl GpuTimes {
    /// The time of our passes in a frame, ms, if one has arrived since the last call.
    fn next(&mut self, store: Option<&DiagnosticsStore>) -> Option<f32> {
        let (arrived, ms) = frame_time(store?, SPAN_PREFIX)?;
        (self.newest.replace(arrived) != Some(arrived)).then_some(ms)
    }

    /// Counts a frame that was rendered, and warns if the time of none has ever arrived.  Frames without a camera have no time.
    fn count_frame(&mut self) {
        if self.newest.is_some() {
            return;
        }
        self.frames_without += 1;
        if self.frames_without > PATIENCE {
            warn_once!(
                "restir: RestirBudget has no effect, because no GPU times arrive: add RenderDiagnosticsPlugin, and use a device with timestamps"
            );
        }
    }
}

/// Chooses the step from the times of the last frame whose times have arrived.
pub(crate) fn keep_budget(
    budget: Option<Res<RestirBudget>>,
    cameras: Query<(Entity, &Restir)>,
    diagnostics: Option<Res<DiagnosticsStore>>,
    statistics: Res<RestirStatistics>,
    mut reduction: ResMut<Reduction>,
    mut controller: Local<Controller>,
    mut workload: Local<Workload>,
    mut times: Local<GpuTimes>,
) {
    let budget = budget.as_deref().copied().unwrap_or_default();
    if budget.gpu_ms > 0.0 {
        let now = Workload::of(&cameras, &budget);
        if *workload != now {
            controller.begin(now.most_reduction());
            *workload = now;
        }
        // While pipelines compile, cameras keep the settings of earlier frames.
        let shows_settings = statistics.shows_settings();
        match times.next(diagnostics.as_deref()) {
            Some(ms) if shows_settings => controller.observe(ms, budget.gpu_ms),
            Some(_) => controller.interrupt(),
            None if shows_settings && statistics.renders() => times.count_frame(),
            None => {}
        }
    } else {
        (*controller, *workload) = Default::default();
    }
    let chosen = controller.reduction();
    statistics.set_budget_step(chosen.steps());
    reduction.set_if_neq(chosen);
}

/// Settings that are equal if their frames take equally long: without those that an app may change in every frame at no cost.
fn cost_of(settings: &Restir) -> Restir {
    let fixed = Restir::default();
    let (seed, debug_scale, firefly_limit) = (fixed.seed, fixed.debug_scale, fixed.firefly_limit);
    Restir { reset: false, seed, debug_scale, firefly_limit, ..settings.clone() }.clamped()
}

/// When the newest GPU times of our passes arrived, and their sum over all passes and cameras, ms.
fn frame_time(store: &DiagnosticsStore, prefix: &str) -> Option<(Instant, f32)> {
    let prefix = format!("render/{prefix}");
    let ours = |diagnostic: &&Diagnostic| {
        let path = diagnostic.path().as_str();
        path.starts_with(&prefix) && path.ends_with("/elapsed_gpu")
    };
    let newest = store.iter().filter(ours).filter_map(|d| Some(d.measurement()?.time)).max()?;
    let of_frame = store.iter().filter(ours).flat_map(|diagnostic| {
        // A pass has one measurement for each camera.
        diagnostic.measurements().filter(|measurement| measurement.time == newest).map(|measurement| measurement.value)
    });
    Some((newest, of_frame.sum::<f64>() as f32))
}

#[cfg(test)]
mod tests {
    use super::{
        controller::{DELAY, WINDOW},
        *,
    };
    use crate::settings::Technique;
    use bevy::{
        camera::Camera,
        diagnostic::{DiagnosticMeasurement, DiagnosticPath},
    };

    #[test]
    fn the_resolution_falls_after_the_samples_of_all_cameras() {
        let cameras = [Technique::Di, Technique::Pt].map(|technique| Restir { technique, ..Restir::default() });
        let workload = Workload { cameras: cameras.to_vec(), least_resolution_scale: 0.5 };
        let most = workload.most_reduction();
        let samples = cameras.each_ref().map(|settings| settings.most_reduction(0.5).samples);
        assert!(samples[0] < samples[1] && most.pixels > 1, "{samples:?}");
        for step in 0..=most.steps() {
            let [a, b] = cameras.each_ref().map(|settings| settings.reduced_by(most.first(step)).resolution_scale);
            assert!(a == b && (a == 1.0) == (step <= samples[1]), "step {step}: {a} and {b}");
        }
    }

    /// An app that edits a mesh in every frame, or that always loads something, is never ready.
    #[test]
    fn an_app_that_is_never_ready_keeps_its_budget() {
        let step_after = |shows_settings, flips| {
            let path = DiagnosticPath::new("render/restir/pt_reuse/elapsed_gpu");
            let mut store = DiagnosticsStore::default();
            store.add(Diagnostic::new(path.clone()));
            let statistics = RestirStatistics::default();
            statistics.set_shows_settings(shows_settings);
            assert!(!statistics.report().ready);
            let mut world = World::new();
            world.insert_resource(RestirBudget { gpu_ms: 5.0, ..Default::default() });
            world.insert_resource(Reduction::default());
            world.insert_resource(store);
            world.insert_resource(statistics);
            world.spawn(Restir::default());
            let other = world.spawn((Restir::default(), Camera::default())).id();
            let mut schedule = Schedule::default();
            schedule.add_systems(keep_budget);
            let start = Instant::now();
            for frame in 0..WINDOW as u64 + u64::from(DELAY) {
                let time = start + core::time::Duration::from_millis(frame);
                let mut store = world.resource_mut::<DiagnosticsStore>();
                if let Some(diagnostic) = store.get_mut(&path) {
                    diagnostic.add_measurement(DiagnosticMeasurement { time, value: 20.0 });
                }
                if let Some(mut camera) = world.get_mut::<Camera>(other).filter(|_| flips) {
                    camera.is_active = !camera.is_active;
                }
                schedule.run(&mut world);
            }
            world.resource::<Reduction>().steps()
        };
        assert!(step_after(true, false) > 0, "the frames are too long");
        assert!(step_after(true, true) > 0, "a camera that is switched on and off is no reason to measure again");
        assert_eq!(step_after(false, false), 0, "the times are those of other pipelines");
    }

    #[test]
    fn only_times_that_arrived_together_are_added() {
        let mut store = DiagnosticsStore::default();
        let earlier = Instant::now();
        let later = earlier + core::time::Duration::from_millis(5);
        for (path, times) in [
            ("render/restir/a/elapsed_gpu", vec![(earlier, 1.0), (later, 2.0), (later, 3.0)]),
            ("render/restir/b/elapsed_gpu", vec![(later, 4.0)]),
            ("render/restir/c/elapsed_gpu", vec![(earlier, 8.0)]),
            ("render/restir/a/elapsed_cpu", vec![(later, 16.0)]),
            ("render/other/elapsed_gpu", vec![(later, 32.0)]),
        ] {
            let path = DiagnosticPath::new(path);
            let mut diagnostic = Diagnostic::new(path);
            for (time, value) in times {
                diagnostic.add_measurement(DiagnosticMeasurement { time, value });
            }
            store.add(diagnostic);
        }
        assert_eq!(frame_time(&store, "restir/"), Some((later, 9.0)));
        assert_eq!(frame_time(&DiagnosticsStore::default(), "restir/"), None);
    }
}
