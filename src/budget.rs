//! Chooses how far the settings of cameras are reduced, so that the GPU time of lighting stays within [`RestirBudget`].

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
    settings::{Reduction, Restir, RestirBudget},
};

/// Number of measurements to ignore after a change of the step, because they may still belong to the step before.
const DELAY: u32 = 6;
/// Number of measurements that a decision needs.  Their median counts.
const WINDOW: usize = 7;
/// A step with more samples is chosen if its predicted time is below this share of the limit.  The margin keeps the step from oscillating.
const UP: f32 = 0.92;
/// Where the limit is exceeded, a step is chosen whose predicted time is below this share of it.
const DOWN: f32 = 0.97;
/// Assumed ratio of the time of a step to that of the step before, until it is measured: of a step with fewer samples, and of one with fewer
/// traced pixels.
const TYPICAL_RATIO: f32 = 0.85;
const TYPICAL_RATIO_OF_PIXELS: f32 = 0.64;
/// Where the present step takes less than this share of the limit, the next better one is tried although its prediction is too long.
const TRIAL: f32 = 0.88;
/// A step with more traced pixels is tried only if its predicted time is below this share of the limit, because each change of the resolution
/// begins histories anew.
const TRIAL_OF_PIXELS: f32 = 1.05;
/// Number of decisions between a change and the first trial.  Each trial that fails doubles it.
const FIRST_WAIT: u32 = 16;
const LONGEST_WAIT: u32 = 256;
/// Number of frames without a GPU time before a warning.
const PATIENCE: u32 = 120;

/// Numbers of the steps that can be taken.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Steps {
    /// The last step that takes samples away.
    samples: u32,
    /// The last step.  Those after `samples` take traced pixels away.
    last: u32,
}

/// Finds the step from the times of frames.
#[derive(Debug, Default)]
pub(crate) struct Controller {
    step: u32,
    /// Whether the present step is taken against its prediction, which may be wrong since the scene has changed.
    is_trial: bool,
    /// Number of decisions that have left the step as it is.
    unchanged: u32,
    /// Number of trials that failed.
    failed_trials: u32,
    /// Number of measurements that are still to be ignored.
    ignored: u32,
    times: Vec<f32>,
    /// Estimated time of each step in the present scene, ms; 0 if it was never measured.  When another step turns out slower or faster
    /// than its estimate, all estimates are scaled by the same factor.
    known: Vec<f32>,
}

impl Controller {
    /// Takes the GPU time of a frame, ms, and chooses the step once there are enough.  `limit`: ms.
    fn observe(&mut self, time: f32, limit: f32, steps: Steps) {
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
        self.learn(median, steps.last);
        self.failed_trials += u32::from(self.is_trial && median > limit);
        self.is_trial = false;
        let mut chosen = self.choose(limit, steps);
        let wait = FIRST_WAIT.saturating_mul(1 << self.failed_trials.min(8)).min(LONGEST_WAIT);
        let may_try = self.step > 0
            && (self.step <= steps.samples || self.predicted(self.step - 1, steps) <= TRIAL_OF_PIXELS * limit);
        if chosen == self.step && may_try && self.unchanged >= wait && median < TRIAL * limit {
            self.is_trial = true;
            chosen -= 1;
        }
        self.unchanged += 1;
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
        self.unchanged = 0;
        self.interrupt();
    }

    /// Takes the measured time of the present step, and scales the times of all other steps by the same factor, except after a trial,
    /// which corrects a prediction and says nothing about the scene.
    fn learn(&mut self, time: f32, last: u32) {
        self.known.resize(last as usize + 1, 0.0);
        let known = self.known[self.step as usize];
        if known > 0.0 && !self.is_trial {
            self.known.iter_mut().for_each(|other| *other *= time / known);
        }
        self.known[self.step as usize] = time;
    }

    /// Predicted time of a step, ms.
    fn predicted(&self, step: u32, steps: Steps) -> f32 {
        let known = self.known[step as usize];
        if known > 0.0 {
            return known;
        }
        // The typical time over that of step 0.
        let typical = |step: u32| {
            let of_samples = step.min(steps.samples);
            TYPICAL_RATIO.powi(of_samples as i32) * TYPICAL_RATIO_OF_PIXELS.powi((step - of_samples) as i32)
        };
        self.known[self.step as usize] * typical(step) / typical(self.step)
    }

    /// The step with the most samples whose predicted time fits.
    fn choose(&self, limit: f32, steps: Steps) -> u32 {
        let fits = |step: &u32, share: f32| self.predicted(*step, steps) <= share * limit;
        if self.known[self.step as usize] > limit {
            return (self.step + 1..=steps.last).find(|step| fits(step, DOWN)).unwrap_or(steps.last);
        }
        (0..self.step).find(|step| fits(step, UP)).unwrap_or(self.step)
    }
}

/// Reads the times of the last frame whose times have arrived, and chooses the step.
pub(crate) fn keep_budget(
    budget: Option<Res<RestirBudget>>,
    cameras: Query<(Entity, &Restir)>,
    diagnostics: Option<Res<DiagnosticsStore>>,
    statistics: Res<RestirStatistics>,
    mut reduction: ResMut<Reduction>,
    mut controller: Local<Controller>,
    mut measured: Local<(Vec<Restir>, f32)>,
    mut newest: Local<Option<Instant>>,
    mut frames_without_time: Local<u32>,
) {
    let RestirBudget { gpu_ms: limit, least_resolution_scale } =
        budget.map_or_else(RestirBudget::default, |budget| *budget);
    // NaN leaves the resolution as it is.
    let least_resolution_scale = least_resolution_scale.clamp(Restir::LEAST_RESOLUTION_SCALE, 1.0).min(1.0);
    if limit <= 0.0 || limit.is_nan() {
        *controller = Controller::default();
        statistics.set_budget_step(0);
        reduction.set_if_neq(Reduction::default());
        return;
    }
    // Also of inactive cameras: one that renders every second frame must not begin the measurement again each time.
    let by_camera: BTreeMap<Entity, &Restir> = cameras.iter().collect();
    let now: Vec<Restir> = by_camera.into_values().map(cost_of).collect();
    let most = |least| now.iter().map(|settings| settings.reducible_steps(least)).max().unwrap_or(0);
    let steps = Steps { samples: most(1.0), last: most(least_resolution_scale) };
    let has_cameras = !now.is_empty();
    let now = (now, least_resolution_scale);
    if *measured != now {
        // Times that were measured with other settings do not hold for these.
        *controller = Controller { step: controller.step.min(steps.last), ..Controller::default() };
        controller.interrupt();
        *measured = now;
    }
    match diagnostics.and_then(|store| frame_time(&store, SPAN_PREFIX)) {
        Some((time, ms)) if *newest != Some(time) => {
            *newest = Some(time);
            *frames_without_time = 0;
            // While pipelines compile, cameras keep the settings of earlier frames.
            match statistics.shows_settings() {
                true => controller.observe(ms, limit, steps),
                false => controller.interrupt(),
            }
        }
        // Before the first of our frames there is nothing to measure.
        _ => *frames_without_time += u32::from(statistics.shows_settings()),
    }
    if *frames_without_time > PATIENCE && newest.is_none() && has_cameras {
        warn_once!(
            "restir: RestirBudget has no effect, because no GPU times arrive: it needs RenderDiagnosticsPlugin and a device with timestamps"
        );
    }
    statistics.set_budget_step(controller.step);
    reduction.set_if_neq(Reduction { steps: controller.step, least_resolution_scale });
}

/// Settings that are equal if their frames take equally long: without those that an app may change in every frame at no cost.
fn cost_of(settings: &Restir) -> Restir {
    let fixed = Restir::default();
    let (seed, debug_scale, firefly_limit) = (fixed.seed, fixed.debug_scale, fixed.firefly_limit);
    Restir { reset: false, seed, debug_scale, firefly_limit, ..settings.clone() }.clamped()
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
    use bevy::{
        camera::Camera,
        diagnostic::{DiagnosticMeasurement, DiagnosticPath},
    };

    const LAST: u32 = 5;
    const SAMPLES: Steps = Steps { samples: LAST, last: LAST };
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
                controller.observe(all[late].1 * noise, limit, SAMPLES);
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
            // A trial of the next step.
            assert!(changes(&frames[100..]) <= 2, "{cost} ms at {limit}");
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

    /// A heavy scene, in which reductions save much, is followed by one in which they save little.
    #[test]
    fn steps_that_were_too_slow_are_tried_again() {
        let mut controller = Controller::default();
        let heavy = [1.0, 0.9, 0.8, 0.6, 0.5, 0.45].map(|ratio| 20.0 * ratio);
        let light = [1.0, 0.97, 0.94, 0.91, 0.88, 0.85].map(|ratio| 9.0 * ratio);
        let mut steps = Vec::new();
        for frame in 0..3000 {
            let times = if frame < 400 { &heavy } else { &light };
            controller.observe(times[controller.step as usize], 10.0, SAMPLES);
            steps.push(controller.step);
        }
        assert!(steps[399] >= 4 && steps[2999] == 0, "{} and {}", steps[399], steps[2999]);
        // Where no step with more samples fits, trials become rare.
        let mut controller = Controller::default();
        let trials = (0..20_000).filter(|_| {
            let before = controller.step;
            controller.observe([12.0, 8.5, 8.0, 7.5, 7.0, 6.5][controller.step as usize], 10.0, SAMPLES);
            controller.step < before
        });
        let trials = trials.count();
        assert!((5..=16).contains(&trials), "{trials}");
        assert_eq!(controller.step, 1);
    }

    /// A change of the resolution restarts histories, so that one that is known to be too slow is not tried again.
    #[test]
    fn the_resolution_changes_once_in_a_constant_scene() {
        for first in [1.1, 1.2, 1.3, 1.5] {
            let mut controller = Controller::default();
            let steps = (0..20_000).map(|_| {
                let pixels = [1.0, 0.64, 0.41];
                controller.observe(
                    10.0 * first * pixels[controller.step as usize],
                    10.0,
                    Steps { samples: 0, last: 2 },
                );
                controller.step
            });
            let mut changes = steps.collect::<Vec<_>>();
            changes.dedup();
            assert_eq!(changes, [0, 1], "{first} times the limit");
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
            world.resource::<Reduction>().steps
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
