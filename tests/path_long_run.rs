//! Hundreds of frames of moving things and a moving camera by ReSTIR PT: nothing that is not finite, and no light gained or lost.

use crate::support::{app::*, direct::*, proof::Subject};
use bevy::prelude::*;
use bevy_restir::{Paths, Technique};

/// Mean over frames of the mean of what is shown, along a path that the camera and things take.
fn energy(rig: &mut Rig, ask: impl Fn(&mut bevy_restir::Restir), frames: u32, every: u32) -> f64 {
    rig.set(|r| {
        ask(r);
        (r.bounces, r.jitter, r.accumulate) = (3, true, false);
    });
    rig.until_ready();
    let (mut sum, mut count) = (0.0, 0);
    for frame in 0..frames {
        // Back and forth along the script.
        let t = (f64::from(frame) * 0.05).sin() as f32 * 0.5 + 0.5;
        pose_moving_at(rig, t * STEPS as f32);
        if frame % every != every - 1 {
            rig.frame();
            continue;
        }
        let picture = rig.next();
        assert!(picture.is_finite(), "frame {frame}");
        (sum, count) = (sum + picture.mean(), count + 1);
    }
    let report = rig.report();
    assert_eq!((report.non_finite_pixels, report.overflow_flags), (0, 0));
    sum / f64::from(count)
}

fn check(frames: u32, margin: f64) {
    let Some(mut rig) = scene(48, moving) else { return };
    pose_moving(&mut rig, 0);
    let paths = energy(&mut rig, |r| Paths::default().ask(r), frames, 1);
    // Every frame of the reference is a scene of its own: one sample each, many times.
    let reference: f64 = (0..4)
        .map(|seed| energy(&mut rig, |r| (r.technique, r.seed) = (Technique::Reference, seed), frames, 1))
        .sum::<f64>()
        / 4.0;
    eprintln!("{frames} frames: {:+.3} % of the reference's light", 100.0 * (paths / reference - 1.0));
    assert!((paths / reference - 1.0).abs() < margin);
}

#[test]
fn two_hundred_moving_frames_of_paths_gain_and_lose_no_light() {
    check(200, 0.02);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_two_thousand_moving_frames_of_paths_gain_and_lose_no_light() {
    check(2000, 0.005);
}
