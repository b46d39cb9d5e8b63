//! A frame of a moving scene shows by ReSTIR PT on average what the reference shows of that frame's scene at rest: the mean over seeds of
//! the last frame of a scripted motion of four, 32 x 32 pixels, three bounces, margin 1.5 % at α = 0.01.

use crate::support::{direct::*, proof::Proof};
use bevy_restir::{Paths, Suffix};

#[test]
fn paths_in_a_frame_in_which_all_moves_carry_what_they_carry_at_rest() {
    let Some(mut rig) = scene(32, moving) else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_moving), ..Proof::of((240, 1), (40, 32)) };
    proof.check("moving", &mut rig, &[("temporal", Paths { spatial_taps: 0, ..every() }), ("both", every())]);
}

#[test]
fn suffixes_that_are_not_traced_both_ways_are_biased_with_their_documented_sign() {
    let Some(mut rig) = scene(32, moving) else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_moving), ..Proof::of((160, 1), (40, 32)) };
    let truth = proof.truth(&mut rig, 1000);
    let mut found = |suffix| {
        let found =
            proof.resampled(&mut rig, &Paths { suffix, spatial_taps: 0, ..every() }, 5000).compare(&truth, 0.01);
        eprintln!("{suffix:?}: {found}");
        found
    };
    assert!(found(Suffix::Forward).sigma() < -4.0);
    // It lags: bright where light was and dark where it comes to.
    assert!(found(Suffix::Kept).tiles < 1e-6);
}
