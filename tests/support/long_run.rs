//! Long runs: the light of every frame of a scripted motion, and whether it equals the reference's and stays constant.

use crate::support::{
    app::*,
    equivalence::{Comparison, Restarts},
    proof::first_seed,
    proof_rows::record,
};
use bevy_restir::{Jitter, Restir, Technique};

/// Runs of the reference for each run of a technique.  Each frame of the reference is a scene of its own, with one sample.
const REFERENCE_RUNS: u32 = 3;

/// Parts of a run: their first and last frames, in halves of the run, and the factor of their margin.  A drift, or a loss that grows, shows in
/// the second half first.
const PARTS: [(&str, [usize; 2], f64); 3] =
    [("all frames", [0, 2], 1.0), ("the first half", [0, 1], 2.0), ("the second half", [1, 2], 2.0)];

/// A run of frames along a script.
pub struct LongRun<'a> {
    pub frames: u32,
    pub bounces: u32,
    /// Poses the scene at a time between 0 and 1.
    pub pose: &'a dyn Fn(&mut Rig, f32),
}

/// Independent runs of a technique and of the reference: the light of each frame.
#[derive(Default)]
struct Runs {
    ours: Vec<Vec<f64>>,
    reference: Vec<Vec<f64>>,
}

impl Runs {
    /// Compares each of [`PARTS`].
    fn compare(&self, margin: f64) -> [Comparison; PARTS.len()] {
        PARTS.map(|(_, [from, to], factor)| {
            let means = |runs: &[Vec<f64>]| {
                let of_run = |light: &Vec<f64>| {
                    let half = light.len() / 2;
                    mean(&light[from * half..to * half])
                };
                Restarts { images: runs.iter().map(of_run).collect(), ..Restarts::default() }
            };
            means(&self.ours).compare(&means(&self.reference), factor * margin)
        })
    }
}

impl LongRun<'_> {
    /// The mean of the picture in each frame, with the emission that the camera sees.  The reference restarts in every frame, with other random
    /// numbers.
    fn light(&self, rig: &mut Rig, apply: impl Fn(&mut Restir)) -> Vec<f64> {
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

    /// Adds runs with further seeds.
    fn extend(&self, all: &mut Runs, rig: &mut Rig, runs: u32, apply: &impl Fn(&mut Restir)) {
        for _ in 0..REFERENCE_RUNS * runs {
            // Its frames have the seeds that follow, which no run of the technique has.
            let seed = first_seed(1_000_000 * (1 + all.reference.len() as u32));
            all.reference.push(self.light(rig, |r| (r.technique, r.seed) = (Technique::Reference, seed)));
        }
        for _ in 0..runs {
            let seed = first_seed(all.ours.len() as u32);
            let light = self.light(rig, |r| {
                apply(r);
                r.seed = seed;
            });
            all.ours.push(light);
        }
    }

    /// Asserts that the light of independent runs equals the reference's within a margin, and that each half of a run has as much light
    /// as the reference has in that half, within twice the margin.  Judges as [`Proof::check`](super::proof::Proof::check) does, by the means
    /// alone: if a part fails, four times the runs are judged once, and a part without enough power fails, too.
    pub fn check(&self, name: &str, rig: &mut Rig, runs: u32, margin: f64, apply: impl Fn(&mut Restir)) {
        let mut all = Runs::default();
        self.extend(&mut all, rig, runs, &apply);
        let first = all.compare(margin);
        let goes_on = first.iter().any(Comparison::is_undecided) && !first.iter().any(Comparison::is_hopeless);
        if goes_on {
            for (&(part, ..), found) in PARTS.iter().zip(&first) {
                eprintln!("{name}, {part}: {found}: goes on to four times the length");
            }
            self.extend(&mut all, rig, 3 * runs, &apply);
        }
        let results = if goes_on { all.compare(margin) } else { first };
        let what = |part: &str| format!("{} x {} frames, {part}", all.ours.len(), self.frames);
        for ((&(part, _, factor), result), first) in PARTS.iter().zip(&results).zip(&first) {
            eprintln!("{name}, {}: {result}", what(part));
            record(name, &what(part), factor * margin, result, goes_on.then_some(first));
        }
        for (&(part, ..), result) in PARTS.iter().zip(&results) {
            result.assert_equal(&format!("{name}, {}", what(part)));
        }
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
