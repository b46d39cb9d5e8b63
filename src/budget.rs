//! Chooses how far the settings of cameras are reduced, so that the GPU time of lighting stays within [`RestirBudget`].

use bevy::{
    diagnostic::{Diagnostic, DiagnosticsStore},
    ecs::prelude::*,
    log::warn_once,
    platform::time::Instant,
};

use crate::{
    frame::SPAN_PREFIX,
    report::RestirStatistics,
    settings::{BudgetStep, Restir, RestirBudget},
};

/// Number of measurements to ignore after a change of the step, because they may still belong to the step before.
const DELAY: u32 = 6;
/// Number of measurements that a decision needs.  Their median counts.
const WINDOW: usize = 7;
/// A step with more samples is chosen if its predicted time is below this share of the limit.  The margin keeps the step from oscillating.
const UP: f32 = 0.92;
/// Where the limit is exceeded, a step is chosen whose predicted time is below this share of it.
const DOWN: f32 = 0.97;
/// Assumed ratio of the time of a step to that of the step before, until it is measured.
const TYPICAL_RATIO: f32 = 0.85;
/// Number of frames without a GPU time before a warning.
const PATIENCE: u32 = 120;

/// Finds the step from the times of frames.
#[derive(Debug, Default)]
pub(crate) struct Controller {
    step: u32,
    /// Number of measurements that are still to be ignored.
    ignored: u32,
    times: Vec<f32>,
    /// Estimated time of each step in the present scene, ms; 0 if unknown: the time that was last measured, multiplied by the changes of
    /// the times of other steps since then.
    known: Vec<f32>,
}

impl Controller {
    /// Takes the GPU time of a frame, ms, and chooses the step once there are enough.  `limit`: ms; `last`: the step that reduces most.
    fn observe(&mut self, time: f32, limit: f32, last: u32) {
        if self.ignored > 0 {
            self.ignored -= 1;
            return;
        }
        self.times.push(time);
        if self.times.len() < WINDOW {
            return;
        }
        self.times.sort_by(f32::total_cmp);
        let median = self.times[WINDOW / 2];
        self.times.clear();
        self.learn(median, last);
        let chosen = self.choose(limit, last);
        if chosen != self.step {
            self.go_to(chosen);
        }
    }

    /// Drops the measurements so far and ignores the next ones, because some of them may belong to other settings.
    fn interrupt(&mut self) {
        self.times.clear();
        self.ignored = DELAY;
    }

    fn go_to(&mut self, step: u32) {
        self.step = step;
        self.interrupt();
    }

    /// Takes the measured time of the present step, and scales the times of all other steps by the same factor.
    fn learn(&mut self, time: f32, last: u32) {
        self.known.resize(last as usize + 1, 0.0);
        let known = self.known[self.step as usize];
        if known > 0.0 {
            self.known.iter_mut().for_each(|other| *other *= time / known);
        }
        self.known[self.step as usize] = time;
    }

    /// Predicted time of a step, ms.
    fn predicted(&self, step: u32) -> f32 {
        let known = self.known[step as usize];
        if known > 0.0 {
            return known;
        }
        self.known[self.step as usize] * TYPICAL_RATIO.powi(step as i32 - self.step as i32)
    }

    /// The step with the most samples whose predicted time fits.
    fn choose(&self, limit: f32, last: u32) -> u32 {
        if self.known[self.step as usize] > limit {
            return (self.step + 1..=last).find(|step| self.predicted(*step) <= DOWN * limit).unwrap_or(last);
        }
        (0..self.step).find(|step| self.predicted(*step) <= UP * limit).unwrap_or(self.step)
    }
}

/// Reads the times of the last frame whose times have arrived, and chooses the step.
pub(crate) fn keep_budget(
    budget: Option<Res<RestirBudget>>,
    cameras: Query<&Restir>,
    diagnostics: Option<Res<DiagnosticsStore>>,
    statistics: Res<RestirStatistics>,
    mut step: ResMut<BudgetStep>,
    mut controller: Local<Controller>,
    mut settings: Local<Vec<Restir>>,
    mut newest: Local<Option<Instant>>,
    mut frames_without_time: Local<u32>,
) {
    let limit = budget.map_or(0.0, |budget| budget.gpu_ms);
    if limit <= 0.0 || limit.is_nan() {
        *controller = Controller::default();
        statistics.set_budget_step(0);
        step.set_if_neq(BudgetStep(0));
        return;
    }
    let now: Vec<Restir> = cameras.iter().map(|camera| Restir { reset: false, ..camera.clone() }.clamped()).collect();
    let last = now.iter().map(Restir::reducible_steps).max().unwrap_or(0);
    if *settings != now {
        // Times that were measured with other settings do not hold for these.
        controller.known.clear();
        controller.step = controller.step.min(last);
        controller.interrupt();
        *settings = now;
    }
    match diagnostics.and_then(|store| frame_time(&store, SPAN_PREFIX)) {
        Some((time, ms)) if *newest != Some(time) => {
            *newest = Some(time);
            *frames_without_time = 0;
            // While pipelines compile, cameras keep the settings of earlier frames.
            match statistics.shows_settings() {
                true => controller.observe(ms, limit, last),
                false => controller.interrupt(),
            }
        }
        _ => *frames_without_time += 1,
    }
    if *frames_without_time > PATIENCE && newest.is_none() && !settings.is_empty() {
        warn_once!(
            "restir: RestirBudget has no effect, because no GPU times arrive: it needs RenderDiagnosticsPlugin and a device with timestamps"
        );
    }
    statistics.set_budget_step(controller.step);
    step.set_if_neq(BudgetStep(controller.step));
}

/// When the newest GPU times of our passes arrived, and their sum in ms, over all cameras.
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
    use super::*;
    use bevy::diagnostic::{DiagnosticMeasurement, DiagnosticPath};

    const LAST: u32 = 5;
    /// The time of a frame arrives this many frames later.
    const LATE: usize = 3;

    /// Runs a flight through a scene: `cost` is the time of a frame at step 0, and `ratios` are the times of all steps over it.  Returns the
    /// step and the time of each frame.
    fn fly(frames: usize, limit: f32, ratios: &[f32], cost: impl Fn(usize) -> f32) -> Vec<(u32, f32)> {
        let mut controller = Controller::default();
        let mut all: Vec<(u32, f32)> = Vec::new();
        for frame in 0..frames {
            // Measured times have noise, and a few of them are much too long.
            let noise = 1.0 + 0.02 * ((frame * 37 % 11) as f32 / 5.0 - 1.0) + if frame % 23 == 7 { 0.6 } else { 0.0 };
            all.push((controller.step, cost(frame) * ratios[controller.step as usize]));
            if let Some(late) = frame.checked_sub(LATE) {
                controller.observe(all[late].1 * noise, limit, LAST);
            }
        }
        all
    }

    const RATIOS: [f32; LAST as usize + 1] = [1.0, 0.86, 0.72, 0.58, 0.5, 0.45];

    /// How often the step changes.
    fn changes(frames: &[(u32, f32)]) -> usize {
        frames.windows(2).filter(|pair| pair[0].0 != pair[1].0).count()
    }

    #[test]
    fn a_constant_scene_gets_the_best_step_that_fits_and_keeps_it() {
        for (cost, limit) in [(10.0, 12.0), (10.0, 9.0), (10.0, 7.5), (10.0, 5.2), (20.0, 9.3)] {
            let frames = fly(400, limit, &RATIOS, |_| cost);
            let (step, time) = frames[399];
            assert!(time <= 1.02 * limit, "{time} ms for {limit}");
            let best = RATIOS.iter().position(|ratio| cost * ratio <= 0.9 * limit).unwrap_or(LAST as usize);
            assert!(step as usize <= best, "step {step}, where {best} would fit");
            assert_eq!(changes(&frames[100..]), 0, "{cost} ms at {limit}");
        }
    }

    #[test]
    fn a_flight_stays_within_its_budget_and_does_not_oscillate() {
        // The cost rises slowly to twice its value in the middle, and falls again.
        let cost = |frame: usize| 10.0 * (1.0 + (frame as f32 / 600.0 * core::f32::consts::PI).sin());
        for limit in [9.0, 10.5, 13.0, 16.0] {
            let frames = fly(600, limit, &RATIOS, cost);
            let over = frames.iter().skip(30).filter(|(_, time)| *time > 1.1 * limit).count();
            let fits = frames.iter().skip(30).enumerate().filter(|(i, _)| cost(i + 30) * RATIOS[5] <= limit).count();
            let bound = frames.len() - 30 - fits;
            assert!(over <= bound + 12, "{over} of {} frames take too long at {limit} ms", frames.len());
            assert!(changes(&frames) <= 12, "{} changes at {limit} ms", changes(&frames));
            let steady = fly(200, limit, &RATIOS, |_| cost(599))[199].0;
            assert!(frames[599].0 <= steady + 1, "step {} at the end, and {steady} without a flight", frames[599].0);
        }
    }

    #[test]
    fn a_cut_to_a_heavy_scene_is_followed_at_once() {
        let frames = fly(200, 10.0, &RATIOS, |frame| if frame < 100 { 8.0 } else { 16.0 });
        let late = frames.iter().skip(100).filter(|(_, time)| *time > 11.0).count();
        assert!(late <= 2 * (WINDOW + DELAY as usize + LATE), "{late} frames take too long after the cut");
        assert!(frames[199].1 <= 10.2);
    }

    /// An app that edits a mesh in every frame, or that always loads something, is never ready.
    #[test]
    fn an_app_that_is_never_ready_keeps_its_budget() {
        let step_after = |shows_settings| {
            let path = DiagnosticPath::new("render/restir/pt_reuse/elapsed_gpu");
            let mut store = DiagnosticsStore::default();
            store.add(Diagnostic::new(path.clone()));
            let statistics = RestirStatistics::default();
            statistics.set_shows_settings(shows_settings);
            assert!(!statistics.report().ready);
            let mut world = World::new();
            world.insert_resource(RestirBudget { gpu_ms: 5.0 });
            world.insert_resource(BudgetStep::default());
            world.insert_resource(store);
            world.insert_resource(statistics);
            world.spawn(Restir::default());
            let mut schedule = Schedule::default();
            schedule.add_systems(keep_budget);
            let start = Instant::now();
            for frame in 0..WINDOW as u64 + u64::from(DELAY) {
                let time = start + core::time::Duration::from_millis(frame);
                let mut store = world.resource_mut::<DiagnosticsStore>();
                if let Some(diagnostic) = store.get_mut(&path) {
                    diagnostic.add_measurement(DiagnosticMeasurement { time, value: 20.0 });
                }
                schedule.run(&mut world);
            }
            world.resource::<BudgetStep>().0
        };
        assert!(step_after(true) > 0, "the frames are too long");
        assert_eq!(step_after(false), 0, "the times are those of other pipelines");
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
