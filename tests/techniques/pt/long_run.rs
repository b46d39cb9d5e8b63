//! ReSTIR PT over hundreds of frames with moving objects and a moving camera: all pixels are finite, and no light is gained or lost.

use crate::support::{app::*, proof::Subject, small_scenes::*, stats};
use bevy_restir::{Jitter, Paths, Restir, Technique};

/// The mean over frames of the picture's mean, along a scripted motion of the camera and the objects.  The reference restarts in every
/// frame, with different random numbers.
fn energy(rig: &mut Rig, apply: impl Fn(&mut Restir), frames: u32) -> f64 {
    rig.set(|r| {
        apply(r);
        (r.bounces, r.jitter, r.accumulate) = (3, Jitter::Always, false);
    });
    rig.until_ready();
    let (mut sum, mut count) = (0.0, 0);
    for frame in 0..frames {
        // Back and forth along the script.
        let t = (f64::from(frame) * 0.05).sin() as f32 * 0.5 + 0.5;
        pose_moving_at(rig, t * STEPS as f32);
        rig.set(|r| {
            if r.technique == Technique::Reference {
                r.seed += 1;
            }
        });
        let picture = rig.next();
        assert!(picture.is_finite(), "frame {frame}");
        (sum, count) = (sum + picture.mean(), count + 1);
    }
    rig.assert_sound();
    sum / f64::from(count)
}

/// Compares the light of independent runs with that of the reference.
fn check(runs: u32, frames: u32, margin: f64) {
    let Some(mut rig) = scene(48, moving) else { return };
    pose_moving(&mut rig, 0);
    // Each frame of the reference is a scene of its own, with one sample.
    let reference: Vec<f64> = (0..runs)
        .map(|seed| energy(&mut rig, |r| (r.technique, r.seed) = (Technique::Reference, 10_000 * seed), frames))
        .collect();
    let light: Vec<f64> = (0..runs)
        .map(|seed| {
            let apply = |r: &mut Restir| {
                Paths::default().apply_to(r);
                r.seed = seed;
            };
            energy(&mut rig, apply, frames)
        })
        .collect();
    let w = stats::welch(&light, &reference);
    let mean = reference.iter().sum::<f64>() / reference.len() as f64;
    let percent = |x: f64| 100.0 * x / mean;
    eprintln!("{runs} x {frames} frames: light differs by {:+.3} % ± {:.3}", percent(w.difference), percent(w.error));
    assert!(w.difference.abs() < margin * mean);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn two_hundred_moving_frames_of_paths_gain_and_lose_no_light() {
    check(3, 70, 0.02);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_two_thousand_moving_frames_of_paths_gain_and_lose_no_light() {
    check(4, 500, 0.005);
}
