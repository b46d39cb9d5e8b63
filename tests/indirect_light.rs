//! ReSTIR GI beside ReSTIR DI shows what the reference shows, in small made scenes of 32 x 32 pixels.  Two one-sided tests at α = 0.01 on
//! the image mean; the 8 x 8 tiles by chi-squared.

use crate::support::{
    direct::*,
    proof::{Indirect, Proof},
};
use bevy_restir::Paths;

const PROOF: Proof = Proof { bounces: 4, ..Proof::of((32, 8), (40, 32)) };

/// Few candidates, so that a wrong weight shows, and neighbours across edges.
fn every() -> Paths {
    Paths { candidates: 4, radius: 6.0, spatial_taps: 2, heuristics: false, confidence_cap: 8.0, ..Default::default() }
}

fn with(paths: Paths) -> Indirect {
    Indirect(both(), paths)
}

#[test]
fn indirect_light_in_a_room_is_that_of_the_reference_whatever_is_reused() {
    let Some(mut rig) = scene(32, |rig| {
        room(rig);
    }) else {
        return;
    };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("candidates", with(Paths { temporal: false, spatial_taps: 0, ..every() })),
            ("temporal", with(Paths { spatial_taps: 0, ..every() })),
            ("spatial", with(Paths { temporal: false, ..every() })),
            ("both", with(every())),
            ("far apart", with(Paths { distance: 0.5, ..every() })),
        ],
    );
}

#[test]
fn indirect_light_of_an_environment_and_mirrors_is_that_of_the_reference() {
    let Some(mut rig) = scene(32, |rig| surrounded(rig, true)) else { return };
    PROOF.check("surrounded", &mut rig, &[("both", with(every()))]);
    let Some(mut rig) = scene(32, mirrors) else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((64, 16), (60, 64)) };
    proof.check("mirrors", &mut rig, &[("both", with(every()))]);
}

#[test]
fn indirect_light_in_a_frame_in_which_all_moves_is_that_at_rest() {
    let Some(mut rig) = scene(32, moving) else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_moving), ..Proof::of((240, 1), (40, 32)) };
    proof.check("moving", &mut rig, &[("both", with(every()))]);
}
