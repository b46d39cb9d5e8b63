//! Finds the step that keeps a limit from measured times.

use crate::settings::Reduction;

/// Number of measurements that are ignored after a change of the step.  Times arrive about three frames late; twice that is safe where more
/// frames are under way.
pub(super) const DELAY: u32 = 6;
/// Number of measurements that a decision needs.  Their median counts, so that three outliers do not matter.  Four times above the limit decide
/// at once, because the median of the whole window is then above it, too.
pub(super) const WINDOW: usize = 7;
/// A better step is chosen if its predicted time is below this share of the limit.  It is below [`DOWN`], so that a prediction that is 5 %
/// too short does not make the step oscillate.
const UP: f32 = 0.92;
/// Where the limit is exceeded, a step is chosen whose predicted time is at most this share of it, a little below 1, because medians vary.
const DOWN: f32 = 0.97;
/// Assumed ratio of the time of a step with fewer samples to that of the step before, until it is measured.  It is cautious: the first steps of
/// paths save 20 to 25 % each in ajar (`docs/experiments.md`).
const TYPICAL_RATIO: f32 = 0.85;
/// Greatest ratio that measured times may put in place of [`TYPICAL_RATIO`].  With a ratio of 1, no step would ever fit.
const WEAKEST_RATIO: f32 = 0.97;
/// Assumed ratio of the time of a step with fewer traced pixels to that of the step before: as if the time were proportional to their number.
const TYPICAL_RATIO_OF_PIXELS: f32 = Reduction::RESOLUTION_STEP * Reduction::RESOLUTION_STEP;
/// The next better step is tried, although its estimate is too long, if it would take at most this share of the limit with the typical ratio.
/// It is a little above 1, because that ratio is a guess.
const TRIAL: f32 = 1.035;
/// Number of decisions between a change of the step and the first trial of one with more samples: about two seconds at 60 frames/s.
const FIRST_WAIT: u32 = 16;
/// The same for a step with more traced pixels: half a minute, because each change of the resolution restarts histories.
const FIRST_WAIT_OF_PIXELS: u32 = 256;
/// Each failed trial doubles the wait, up to this number of times, so that the longest wait is half a minute (eight minutes for pixels): the
/// scene may have changed by then.
const MOST_DOUBLINGS: u32 = 4;
/// If the time of a step changes by more than this factor from one window to the next, the scene has changed.  Noise stays far below.
const OTHER_SCENE: f32 = 1.15;
/// Least growth of times in a frame, as a natural logarithm, that is taken for a trend.  Noise of 2 % stays below.
const LEAST_GROWTH: f32 = 0.008;
/// Number of frames that a trend is extrapolated by: from the middle of a window to the decision after the next one, which is half a window, the
/// delay of times, [`DELAY`], and the four times above the limit that decide.
const AHEAD: f32 = 16.0;
/// Greatest factor by which a trend makes predictions longer.  A jump of the times looks like a steep trend, but does not go on.
const GREATEST_RISE: f32 = 1.5;
/// Number of measurements from the middle of a window to that of the next one with another step.
const BETWEEN_STEPS: f32 = (DELAY + WINDOW as u32) as f32;

/// Finds the step from the times of frames.  A higher step takes more away; a *better* one is lower.
#[derive(Debug, Default)]
pub(crate) struct Controller {
    /// All that the steps can take away.
    most: Reduction,
    step: u32,
    /// The present step was chosen although its estimate is too long, because the estimate may be wrong.
    is_trial: bool,
    /// Number of trials that failed since one succeeded or the scene changed.
    failed_trials: u32,
    /// Number of decisions that have left the step as it is.
    unchanged: u32,
    /// The last window was above the limit.
    was_too_long: bool,
    /// A better step fitted after the last window.
    had_room: bool,
    /// The present step has not been measured since it was chosen.
    is_new: bool,
    /// Number of measurements that are still to be ignored.
    ignored: u32,
    /// The last measurements of the present step, at most a window of them.
    times: Vec<f32>,
    /// Number of measurements since the last decision.
    fresh: usize,
    /// Estimated time of each step in the present scene, ms; 0 if it was never measured.  When another step turns out slower or faster
    /// than its estimate, all estimates are scaled.
    known: Vec<f32>,
}

/// The measurements that a decision is made from.
struct Window {
    /// Median, ms.
    time: f32,
    is_too_long: bool,
    /// Growth of the times in a frame, as a natural logarithm; 0 if it may be noise.
    growth: f32,
}

impl Window {
    /// Factor by which times will have grown until the next decision can take effect.  A scene that becomes cheaper may stop doing so.
    fn rise(&self) -> f32 {
        (self.growth * AHEAD).exp().clamp(1.0, GREATEST_RISE)
    }
}

impl Controller {
    /// Starts again with other settings, for which earlier times do not hold.
    pub(super) fn begin(&mut self, most: Reduction) {
        let Reduction { samples, pixels, .. } = self.reduction();
        // The resolution stays, because a change would restart histories.
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
        let Some(window) = self.end_window(time, limit) else { return };
        // A trial that fails ends at once.
        let is_confirmed = self.was_too_long || self.is_trial;
        self.learn(&window, limit);
        self.was_too_long = window.is_too_long;
        self.unchanged += 1;
        let fits = |step: &u32| self.predicted(*step) * window.rise() <= UP * limit;
        let better = (0..self.step).find(fits).filter(|_| !window.is_too_long);
        // A better step must fit after two windows: the cost of a scene often falls before it rises.
        let had_room = core::mem::replace(&mut self.had_room, better.is_some());
        if window.is_too_long {
            self.go_to(self.cheaper_step(limit / window.rise(), is_confirmed));
        } else if let Some(better) = better {
            self.go_to(if had_room { better } else { self.step });
        } else if self.may_try(limit) {
            self.go_to(self.step - 1);
            self.is_trial = true;
        }
    }

    /// Drops the measurements so far and ignores the next ones, because some of them may belong to other settings.
    pub(super) fn interrupt(&mut self) {
        self.times.clear();
        self.fresh = 0;
        self.ignored = DELAY;
    }

    /// Takes the time of a frame.  Returns a window when it is complete, or as soon as it is certain to be above the limit.
    fn end_window(&mut self, time: f32, limit: f32) -> Option<Window> {
        if self.ignored > 0 {
            self.ignored -= 1;
            return None;
        }
        if self.times.len() == WINDOW {
            self.times.remove(0);
        }
        self.times.push(time);
        self.fresh += 1;
        let above: Vec<f32> = self.times.iter().copied().filter(|time| *time > limit).collect();
        let is_too_long = above.len() > WINDOW / 2;
        if !is_too_long && self.fresh < WINDOW {
            return None;
        }
        let growth = self.growth();
        // Times below the limit that are older than a jump do not count.
        let time = if is_too_long { median(above) } else { median(self.times.clone()) };
        self.fresh = 0;
        if is_too_long {
            // The next window confirms it by other measurements.
            self.times.clear();
        }
        Some(Window { time, is_too_long, growth })
    }

    /// Growth of the times in a frame ([`Window::growth`]): the median of the slopes between any two of them, so that outliers do not matter.
    fn growth(&self) -> f32 {
        if self.times.len() < WINDOW {
            return 0.0;
        }
        let mut slopes = Vec::new();
        for (i, first) in self.times.iter().enumerate() {
            for (j, second) in self.times.iter().enumerate().skip(i + 1) {
                slopes.push((second / first).ln() / (j - i) as f32);
            }
        }
        let growth = median(slopes);
        if growth.abs() > LEAST_GROWTH { growth } else { 0.0 }
    }

    fn go_to(&mut self, step: u32) {
        if step != self.step {
            self.step = step;
            self.unchanged = 0;
            self.had_room = false;
            self.is_new = true;
            self.interrupt();
        }
    }

    /// Takes the measured time of the present step.  A trial corrects one estimate; any other change of the time is one of the scene, and
    /// scales the estimates of all steps.
    fn learn(&mut self, window: &Window, limit: f32) {
        let (time, known) = (window.time, self.known[self.step as usize]);
        let is_new = core::mem::take(&mut self.is_new);
        if core::mem::take(&mut self.is_trial) {
            // A trial that ends just below the limit says nothing about the next one.
            if time > limit {
                self.failed_trials += 1;
            } else if time <= DOWN * limit {
                self.failed_trials = 0;
            }
        } else if known > 0.0 {
            let factor = time / known;
            // After a change of the step, its own estimate may be as wrong as the scene has changed.
            self.scale(if is_new { factor.sqrt() } else { factor });
            if factor.max(1.0 / factor) > OTHER_SCENE {
                self.failed_trials = 0;
            }
        } else {
            // This step has no estimate to compare with, so the trend alone tells how much the scene has changed.
            self.scale((window.growth * BETWEEN_STEPS).exp().clamp(1.0 / GREATEST_RISE, GREATEST_RISE));
        }
        self.known[self.step as usize] = time;
    }

    /// Scales all estimates.
    fn scale(&mut self, factor: f32) {
        self.known.iter_mut().for_each(|time| *time *= factor);
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
        if known > 0.0 {
            known
        } else if step > self.step && step <= self.most.samples {
            self.known[self.step as usize] * self.ratio_of_samples().powi((step - self.step) as i32)
        } else {
            self.typical(step)
        }
    }

    /// Ratio of the time of a step with fewer samples to that of the step before, by the two highest steps that were measured: later steps
    /// save no more than earlier ones.
    fn ratio_of_samples(&self) -> f32 {
        let mut known = (0..=self.most.samples).rev().filter(|step| self.known[*step as usize] > 0.0);
        let (Some(last), Some(before)) = (known.next(), known.next()) else { return TYPICAL_RATIO };
        let ratio = self.known[last as usize] / self.known[before as usize];
        ratio.powf(1.0 / (last - before) as f32).clamp(TYPICAL_RATIO, WEAKEST_RATIO)
    }

    /// The best one of the higher steps that is predicted to fit, or else the last one.  The resolution falls only if the time that is too
    /// long is confirmed by the window before: a short hitch must not restart histories.
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

/// The median, the upper one of an even number; there must be at least one number.
fn median(mut numbers: Vec<f32>) -> f32 {
    numbers.sort_by(f32::total_cmp);
    numbers[numbers.len() / 2]
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAST: u32 = 5;
    /// The time of a frame arrives this many frames later.
    const LATE: usize = 3;
    /// Number of times above the limit that decide.
    const DECISIVE: usize = WINDOW / 2 + 1;
    /// Number of frames from a jump of the cost to the first one with another step, and from one change of the step to the next.
    const FIRST_ANSWER: usize = LATE + DECISIVE;
    const NEXT_ANSWER: usize = DELAY as usize + DECISIVE;

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
        let mut controller = controller(ratios.len() as u32 - 1, 0);
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

    /// Times of steps of which each saves this share of the one before.
    fn ratios_of(saved: f32) -> [f32; 12] {
        core::array::from_fn(|step| (1.0 - saved).powi(step as i32))
    }

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
        assert_eq!(steps[100..].iter().filter(|step| **step == 0).count(), 3 * NEXT_ANSWER);
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

    /// After a jump, frames exceed the limit by more than a tenth until the first answer, and until a second one where steps save less than is
    /// assumed of those that were never measured.
    #[test]
    fn a_cut_to_a_heavy_scene_is_followed_at_once() {
        for (ratios, answer) in [
            (&RATIOS[..], FIRST_ANSWER),
            (&ratios_of(0.1), FIRST_ANSWER),
            (&ratios_of(0.07), FIRST_ANSWER + NEXT_ANSWER),
        ] {
            for (cut, before, after) in (60..60 + 2 * WINDOW)
                .flat_map(|cut| [5.0, 8.0, 9.5].map(|before| (cut, before)))
                .flat_map(|(cut, before)| [11.5, 13.0, 16.0, 20.0].map(|after| (cut, before, after)))
            {
                let frames = fly(cut + 100, 10.0, ratios, |frame| if frame < cut { before } else { after });
                let late = frames[cut + answer..].iter().filter(|(_, time)| *time > 11.0).count();
                assert_eq!(late, 0, "frames after a cut from {before} to {after} ms at frame {cut}, {ratios:?}");
                assert!(frames[cut + 99].1 <= 10.2, "from {before} to {after} ms at frame {cut}");
            }
        }
    }

    /// The number of frames that exceed their limit by more than a tenth in flights in which the cost doubles and halves twice, after 30 frames
    /// at the start: the greatest of several limits and places to start.
    fn most_frames_above(period: usize, ratios: &[f32]) -> usize {
        let above = |(limit, start): (f32, usize)| {
            let cost = |frame: usize| {
                let along = core::f32::consts::PI * (frame + start) as f32 / period as f32;
                10.0 * (1.0 + along.sin().powi(2))
            };
            let frames = fly(2 * period, limit, ratios, cost);
            frames[30..].iter().filter(|(_, time)| *time > 1.1 * limit).count()
        };
        let limits = [10.0, 12.0, 14.0, 16.0, 18.0].into_iter();
        limits.flat_map(|limit| [0, 21, 42, 63].map(|start| above((limit, start)))).max().unwrap_or(0)
    }

    #[test]
    fn a_flight_stays_within_a_tenth_of_its_limit() {
        for ratios in [&RATIOS[..], &ratios_of(0.1), &ratios_of(0.07)] {
            // The cost doubles in 300 and in 200 frames.
            assert_eq!([600, 400].map(|period| most_frames_above(period, ratios)), [0, 0], "{ratios:?}");
            // In 75 frames.  One answer may come late.
            let above = most_frames_above(150, ratios);
            assert!(above <= FIRST_ANSWER, "{above} frames with {ratios:?}");
        }
    }
}
