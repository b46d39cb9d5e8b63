//! ReSTIR PT over hundreds of frames with moving objects and a moving camera: all pixels are finite, and no light is gained or lost.

use crate::support::{app::*, long_run::LongRun, proof::Subject, small_scenes::*};
use bevy_restir::Paths;

fn check(runs: u32, frames: u32, margin: f64) {
    let Some(mut rig) = scene(48, moving) else { return };
    pose_moving(&mut rig, 0);
    let pose = |rig: &mut Rig, time: f32| pose_moving_at(rig, time * STEPS as f32);
    let run = LongRun { frames, bounces: 3, pose: &pose };
    run.check("moving room", &mut rig, runs, margin, |r| Paths::default().apply_to(r));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_runs_of_five_hundred_moving_frames_of_paths_gain_and_lose_no_light() {
    // Four runs had a standard error of 0.22 %, with which 16 have a power of 0.92 to 0.96.  An error of four runs is a rough estimate, hence 24.
    check(24, 500, 0.005);
}
