//! ReSTIR BDPT over up to a thousand frames with caustics, of a still scene and of one in which lamp, mirror, glass and camera move: no
//! light is gained or lost, and no guard is raised.

use super::light_reuse::{corner, pose_corner_at};
use crate::support::{
    app::*,
    long_run::LongRun,
    proof::{Bidirectional, Subject},
    small_scenes::*,
};
use bevy_restir::{LightTechniques, Paths};

fn check(runs: u32, frames: u32, margin: f64) {
    let Some(mut rig) = scene(32, |rig| corner(rig, true)) else { return };
    let still = |_: &mut Rig, _| ();
    let moving = |rig: &mut Rig, time: f32| pose_corner_at(rig, time * STEPS as f32);
    for (name, pose) in [("a still corner", &still as &dyn Fn(&mut Rig, f32)), ("a moving corner", &moving)] {
        let run = LongRun { frames, bounces: 4, pose };
        let settings = Bidirectional(LightTechniques::Full, Paths::default());
        run.check(name, &mut rig, runs, margin, |r| settings.apply_to(r));
    }
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_runs_of_a_thousand_frames_with_caustics_gain_and_lose_no_light() {
    check(4, 1000, 0.005);
}
