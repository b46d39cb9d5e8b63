//! Long runs: the light of every frame of a scripted motion, and whether it equals the reference's and stays constant.

use crate::support::{app::*, stats};
use bevy_restir::{Jitter, Restir, Technique};

/// Runs of the reference for each run of a technique.
const REFERENCE_RUNS: u32 = 3;

/// A run of frames along a script.
pub struct LongRun<'a> {
    pub frames: u32,
    pub bounces: u32,
    /// Poses the scene at a time between 0 and 1.
    pub pose: &'a dyn Fn(&mut Rig, f32),
}

impl LongRun<'_> {
    /// The mean of the picture in each frame.  The reference restarts in every frame, with other random numbers.
    pub fn light(&self, rig: &mut Rig, apply: impl Fn(&mut Restir)) -> Vec<f64> {
        rig.set(|r| {
            apply(r);
            (r.bounces, r.jitter, r.accumulate) = (self.bounces, Jitter::Always, false);
        });
        rig.until_ready();
        let mut light = Vec::with_capacity(self.frames as usize);
        for frame in 0..self.frames {
            // Back and forth along the script.
            let time = (f64::from(frame) * 0.05).sin() as f32 * 0.5 + 0.5;
            (self.pose)(rig, time);
            rig.set(|r| {
                if r.technique == Technique::Reference {
                    r.seed += 1;
                }
            });
            let picture = rig.next();
            assert!(picture.is_finite(), "frame {frame}");
            light.push(picture.mean());
        }
        rig.assert_sound();
        light
    }

    /// Asserts that the light of independent runs equals the reference's within a margin, and that each half of a run has as much light
    /// as the reference has in that half: a drift or a loss that grows would show in the second half first.
    pub fn check(&self, name: &str, rig: &mut Rig, runs: u32, margin: f64, apply: impl Fn(&mut Restir)) {
        // Each frame of the reference is a scene of its own, with one sample, so that the reference needs more runs.
        let reference: Vec<_> = (0..REFERENCE_RUNS * runs)
            .map(|run| self.light(rig, |r| (r.technique, r.seed) = (Technique::Reference, 1_000_000 * run)))
            .collect();
        let resampled: Vec<_> = (0..runs)
            .map(|run| {
                self.light(rig, |r| {
                    apply(r);
                    r.seed = run;
                })
            })
            .collect();
        let half = self.frames as usize / 2;
        let mut failed = false;
        for (part, range, margin) in [
            ("all frames", 0..2 * half, margin),
            ("the first half", 0..half, 2.0 * margin),
            ("the second half", half..2 * half, 2.0 * margin),
        ] {
            let means = |runs: &[Vec<f64>]| runs.iter().map(|light| mean(&light[range.clone()])).collect::<Vec<_>>();
            let (resampled, reference) = (means(&resampled), means(&reference));
            let w = stats::welch(&resampled, &reference);
            let percent = |x: f64| 100.0 * x / mean(&reference);
            let (difference, error) = (percent(w.difference), percent(w.error));
            eprintln!(
                "{name}, {runs} x {} frames, {part}: light differs by {difference:+.3} % ± {error:.3}",
                self.frames
            );
            failed |= difference.abs() > 100.0 * margin;
        }
        assert!(!failed, "{name}: the light of a long run differs from the reference's");
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
