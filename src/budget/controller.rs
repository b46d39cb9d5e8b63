//! Finds the step that keeps a limit from measured times.

use crate::settings::Reduction;

/// Number of measurements that are ignored after a change of the step.  Times arrive about three frames late; twice that is safe where more
/// frames are under way.
pub(super) const DELAY: u32 = 6;
/// Number of measurements that a decision needs.  Their median counts, so that three outliers do not matter.
pub(super) const WINDOW: usize = 7;
/// A better step is chosen if its predicted time is below this share of the limit.  It is below [`DOWN`], so that a prediction that is 5 %
/// too short does not make the step oscillate.
const UP: f32 = 0.92;
/// Where the limit is exceeded, a step is chosen whose predicted time is below this share of it: a little less, because medians vary.
const DOWN: f32 = 0.97;
/// Assumed ratio of the time of a step with fewer samples to that of the step before, until it is measured.  It is cautious: the first steps of
/// paths save 20 to 25 % each in ajar (`docs/experiments.md`).
const TYPICAL_RATIO: f32 = 0.85;
/// The same for a step with fewer traced pixels: as if the time were proportional to their number.
const TYPICAL_RATIO_OF_PIXELS: f32 = Reduction::RESOLUTION_STEP * Reduction::RESOLUTION_STEP;
/// The next better step is tried, although its estimate is too long, if it would take at most this share of the limit with the typical ratio.
/// It is a little above 1, because that ratio is a guess.
const TRIAL: f32 = 1.035;
/// Number of decisions between a change of the step and the first trial of one with more samples: about two seconds at 60 frames/s.
const FIRST_WAIT: u32 = 16;
/// The same for a step with more traced pixels: half a minute, because each change of the resolution begins histories anew.
const FIRST_WAIT_OF_PIXELS: u32 = 256;
/// Each trial that fails doubles the wait, but at most so often: after half a minute (of pixels: eight) the scene may be another one.
const MOST_DOUBLINGS: u32 = 4;
/// If the time of a step changes by more than this factor from one window to the next, the scene has changed.  Noise stays far below.
const OTHER_SCENE: f32 = 1.15;

/// Finds the step from the times of frames.  A higher step takes more away; a *better* one is lower.
#[derive(Debug, Default)]
pub(crate) struct Controller {
    /// All that the steps can take away.
    most: Reduction,
    step: u32,
    /// Whether the present step is taken against its estimate, which may be wrong since the scene has changed.
    is_trial: bool,
    /// Number of trials that failed since one succeeded or the scene changed.
    failed_trials: u32,
    /// Number of decisions that have left the step as it is.
    unchanged: u32,
    /// The last window was above the limit.
    was_too_long: bool,
    /// Number of measurements that are still to be ignored.
    ignored: u32,
    times: Vec<f32>,
    /// Estimated time of each step in the present scene, ms; 0 if it was never measured.  When another step turns out slower or faster
    /// than its estimate, all estimates are scaled by the same factor.
    known: Vec<f32>,
}

impl Controller {
    /// Begins anew with other settings, for which earlier times do not hold.
    pub(super) fn begin(&mut self, most: Reduction) {
        let Reduction { samples, pixels, .. } = self.reduction();
        // The resolution stays, because a change would begin histories anew.
        let step = if pixels > 0 { most.samples + pixels.min(most.pixels) } else { samples.min(most.samples) };
        *self = Self { most, step, known: vec![0.0; most.steps() as usize + 1], ..Self::default() };
        self.interrupt();
    }

    /// The reduction of the present step.
    pub(super) fn reduction(&self) -> Reduction {
        self.most.first(self.step)
    }

    /// Takes the GPU time of a frame, ms, and chooses the step once there are enough.  `limit`: ms.
    pub(super) fn observe(&mut self, time: f32, limit: f32) {
        let Some(median) = self.end_window(time) else { return };
        let is_too_long = median > limit;
        // A trial that fails ends at once.
        let is_confirmed = self.was_too_long || self.is_trial;
        self.learn(median, limit);
        self.was_too_long = is_too_long;
        self.unchanged += 1;
        if is_too_long {
            self.go_to(self.cheaper_step(limit, is_confirmed));
        } else if let Some(better) = (0..self.step).find(|step| self.predicted(*step) <= UP * limit) {
            self.go_to(better);
        } else if self.may_try(limit) {
            self.go_to(self.step - 1);
            self.is_trial = true;
        }
    }

    /// Drops the measurements so far and ignores the next ones, because some of them may belong to other settings.
    pub(super) fn interrupt(&mut self) {
        self.times.clear();
        self.ignored = DELAY;
    }

    /// Takes the time of a frame.  Returns the median of a window when it is complete.
    fn end_window(&mut self, time: f32) -> Option<f32> {
        if self.ignored > 0 {
            self.ignored -= 1;
            return None;
        }
        self.times.push(time);
        if self.times.len() < WINDOW {
            return None;
        }
        self.times.sort_by(f32::total_cmp);
        let median = self.times[WINDOW / 2];
        self.times.clear();
        Some(median)
    }

    fn go_to(&mut self, step: u32) {
        if step != self.step {
            self.step = step;
            self.unchanged = 0;
            self.interrupt();
        }
    }

    /// Takes the measured time of the present step.  A trial corrects one estimate; any other change of the time is one of the scene, and
    /// scales the estimates of all steps.
    fn learn(&mut self, time: f32, limit: f32) {
        let known = self.known[self.step as usize];
        if core::mem::take(&mut self.is_trial) {
            // A trial that ends just below the limit says nothing about the next one.
            if time > limit {
                self.failed_trials += 1;
            } else if time <= DOWN * limit {
                self.failed_trials = 0;
            }
        } else if known > 0.0 {
            let factor = time / known;
            self.known.iter_mut().for_each(|time| *time *= factor);
            if factor.max(1.0 / factor) > OTHER_SCENE {
                self.failed_trials = 0;
            }
        }
        self.known[self.step as usize] = time;
    }

    /// Time of a step that has the typical ratio to the measured time of the present step, ms.
    fn typical(&self, step: u32) -> f32 {
        let ratio = |step: u32| {
            let Reduction { samples, pixels, .. } = self.most.first(step);
            TYPICAL_RATIO.powi(samples as i32) * TYPICAL_RATIO_OF_PIXELS.powi(pixels as i32)
        };
        self.known[self.step as usize] * ratio(step) / ratio(self.step)
    }

    /// Predicted time of a step, ms.
    fn predicted(&self, step: u32) -> f32 {
        let known = self.known[step as usize];
        if known > 0.0 { known } else { self.typical(step) }
    }

    /// The best one of the higher steps that is predicted to fit, or else the last one.  The resolution falls only if the time that is too
    /// long is confirmed by the window before: a short hitch must not begin histories anew.
    fn cheaper_step(&self, limit: f32, is_confirmed: bool) -> u32 {
        let last = if is_confirmed { self.most.steps() } else { self.step.max(self.most.samples) };
        (self.step + 1..=last).find(|step| self.predicted(*step) <= DOWN * limit).unwrap_or(last)
    }

    /// Whether the next better step is to be tried although its estimate is too long.  The estimate may be wrong: another scene may save less
    /// in the present step, or the better one may have been measured during a hitch.
    fn may_try(&self, limit: f32) -> bool {
        let first_wait = if self.step > self.most.samples { FIRST_WAIT_OF_PIXELS } else { FIRST_WAIT };
        let wait = first_wait << self.failed_trials.min(MOST_DOUBLINGS);
        self.step > 0 && self.unchanged >= wait && self.typical(self.step - 1) <= TRIAL * limit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAST: u32 = 5;
    /// The time of a frame arrives this many frames later.
    const LATE: usize = 3;

    /// A controller that has ignored the first measurements.
    fn controller(samples: u32, pixels: u32) -> Controller {
        let mut controller = Controller::default();
        controller.begin(Reduction { samples, pixels, least_resolution_scale: 0.25 });
        controller.ignored = 0;
        controller
    }

    /// The steps of the next frames at a limit of 10 ms.  `times`: of all steps, ms.
    fn steps(controller: &mut Controller, times: &[f32], frames: usize) -> Vec<u32> {
        let frame = |_| {
            controller.observe(times[controller.step as usize], 10.0);
            controller.step
        };
        (0..frames).map(frame).collect()
    }

    /// Runs a flight through a scene: `cost` is the time of a frame at step 0, and `ratios` are the times of all steps over it.  Returns the
    /// step and the time of each frame.
    fn fly(frames: usize, limit: f32, ratios: &[f32], cost: impl Fn(usize) -> f32) -> Vec<(u32, f32)> {
        let mut controller = controller(LAST, 0);
        let mut all: Vec<(u32, f32)> = Vec::new();
        for frame in 0..frames {
            // Measured times have noise, and a few of them are much too long.
            let noise = 1.0 + 0.02 * ((frame * 37 % 11) as f32 / 5.0 - 1.0) + if frame % 23 == 7 { 0.6 } else { 0.0 };
            all.push((controller.step, cost(frame) * ratios[controller.step as usize]));
            if let Some(late) = frame.checked_sub(LATE) {
                controller.observe(all[late].1 * noise, limit);
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
        let heavy = [1.0, 0.9, 0.8, 0.6, 0.5, 0.45].map(|ratio| 20.0 * ratio);
        let light = [1.0, 0.97, 0.94, 0.91, 0.88, 0.85].map(|ratio| 9.0 * ratio);
        // Trials that fail become rare.
        let failing = [12.0, 8.5, 8.0, 7.5, 7.0, 6.5];
        let mut flown = controller(LAST, 0);
        let tried = steps(&mut flown, &failing, 20_000);
        let trials = tried.windows(2).filter(|pair| pair[1] < pair[0]).count();
        assert!((5..=16).contains(&trials), "{trials}");
        assert_eq!(flown.step, 1);
        // They say nothing about other scenes.
        for mut controller in [controller(LAST, 0), flown] {
            assert!(steps(&mut controller, &heavy, 400)[399] >= 4);
            assert_eq!(steps(&mut controller, &light, 800)[799], 0);
        }
    }

    #[test]
    fn a_trial_that_succeeds_makes_trials_frequent_again() {
        let mut controller = controller(LAST, 0);
        steps(&mut controller, &[20.0, 19.0, 18.0, 17.0, 7.6, 7.0], 3000);
        assert!(controller.step == 4 && controller.failed_trials >= MOST_DOUBLINGS);
        // The time of the present step is that of before, so that only trials find out.
        let wait = WINDOW * (FIRST_WAIT << MOST_DOUBLINGS) as usize;
        let steps = steps(&mut controller, &[8.0, 7.9, 7.8, 7.7, 7.6, 7.0], wait + 600);
        assert_eq!(steps[wait + 599], 0);
    }

    /// A change of the resolution restarts histories, so that one that is known to be too slow is not tried again.
    #[test]
    fn the_resolution_changes_once_in_a_constant_scene() {
        for first in [11.0, 12.0, 13.0, 15.0] {
            let mut changes = vec![0];
            changes.extend(steps(&mut controller(0, 2), &[first, 0.64 * first, 0.41 * first], 20_000));
            changes.dedup();
            assert_eq!(changes, [0, 1], "{first} ms");
        }
    }

    /// For some frames another program uses the GPU, or its clock is slower.
    #[test]
    fn a_hitch_does_not_lower_the_resolution_for_good() {
        let times = [9.0, 5.76, 3.7];
        for (begin, length) in (0..2 * WINDOW).flat_map(|begin| (1..40).map(move |length| (begin, length))) {
            let mut controller = controller(0, 2);
            steps(&mut controller, &times, begin);
            let during = steps(&mut controller, &times.map(|time| 1.4 * time), length);
            let after = steps(&mut controller, &times, 2000);
            let is_short = length <= WINDOW;
            assert!(!is_short || during.iter().chain(&after).all(|step| *step == 0), "{length} frames from {begin} on");
            assert_eq!(after[1999], 0, "{length} frames from {begin} on");
        }
    }

    /// Here fewer pixels save more than is typical.
    #[test]
    fn trials_of_a_higher_resolution_are_rare_and_short() {
        let steps = steps(&mut controller(0, 1), &[12.0, 6.0], 20_000);
        // After 256, 512 and 1,024 decisions.
        assert_eq!(steps[100..].iter().filter(|step| **step == 0).count(), 3 * (WINDOW + DELAY as usize));
    }

    #[test]
    fn other_settings_keep_the_resolution() {
        for (step, expected) in [(3, [3, 0]), (8, [6, 0]), (11, [6, 0]), (12, [6, 1]), (14, [6, 2])] {
            let mut controller = controller(11, 3);
            controller.step = step;
            controller.begin(Reduction { samples: 6, pixels: 2, least_resolution_scale: 0.5 });
            let Reduction { samples, pixels, .. } = controller.reduction();
            assert_eq!([samples, pixels], expected, "from step {step}");
        }
    }

    #[test]
    fn a_cut_to_a_heavy_scene_is_followed_at_once() {
        let frames = fly(200, 10.0, &RATIOS, |frame| if frame < 100 { 8.0 } else { 16.0 });
        let late = frames.iter().skip(100).filter(|(_, time)| *time > 11.0).count();
        assert!(late <= 2 * (WINDOW + DELAY as usize + LATE), "{late} frames take too long after the cut");
        assert!(frames[199].1 <= 10.2);
    }
}
