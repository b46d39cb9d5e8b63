//! ReSTIR DI + GI equals the reference, in small scenes of 64 x 64 pixels.  Two one-sided tests at α = 0.01 compare the image mean, and
//! chi-squared compares the 8 x 8 tiles.

use crate::support::{
    app::*,
    proof::{Indirect, Proof},
    reuse_settings::{di, paths, pixels},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Paths, Reuse};

const PROOF: Proof = Proof { bounces: 4, ..Proof::of((12, 6), (10, 24)) };

fn with(paths: Paths) -> Indirect {
    Indirect(di::all_reuse(), paths)
}

#[test]
fn indirect_light_in_a_room_equals_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.check("room", &mut rig, &[("both", with(paths::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_in_a_room_equals_the_reference_for_every_kind_of_reuse() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("candidates", with(paths::candidates_only())),
            ("temporal", with(paths::temporal())),
            ("spatial", with(paths::spatial())),
        ],
    );
}

/// Paths that are reconnected nowhere stay in their pixels, and no other sample stands for their light.
#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_beyond_a_distance_equals_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    let far_apart = with(Paths { distance: 0.5, ..paths::temporal() });
    // Rounding lets shifts fail even to their own pixels.
    let exact = with(Paths { jacobian_limit: 1.0, ..paths::temporal() });
    PROOF.check("room", &mut rig, &[("far apart, temporal", far_apart), ("Jacobians of 1, temporal", exact)]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_in_a_room_equals_the_reference_with_further_limits() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("far apart", with(Paths { distance: 0.5, ..paths::all_reuse() })),
            ("Jacobians to 1.5", with(Paths { jacobian_limit: 1.5, ..paths::all_reuse() })),
        ],
    );
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_of_an_environment_and_mirrors_equals_the_reference() {
    let Some(mut rig) = shared(64, "surrounded by an image") else { return };
    PROOF.check("surrounded", &mut rig, &[("both", with(paths::all_reuse()))]);
    let Some(mut rig) = shared(64, "mirrors") else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((16, 8), (16, 32)) };
    proof.check("mirrors", &mut rig, &[("both", with(paths::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_in_a_moving_frame_equals_that_of_the_still_scene() {
    let Some(mut rig) = shared(64, "moving") else { return };
    let proof = Proof { bounces: 3, margin: 0.015, pose: Some(&pose_moving), ..Proof::of((40, 1), (12, 32)) };
    proof.check("moving", &mut rig, &[("both", with(paths::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_of_points_and_suns_equals_the_reference() {
    let Some(mut rig) = shared(64, "punctual") else { return };
    let proof = Proof { bounces: 4, ..Proof::of((16, 6), (14, 24)) };
    proof.check("punctual", &mut rig, &[("both", with(paths::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn assuming_diffuse_secondary_surfaces_is_biased_as_documented() {
    let Some(mut rig) = scene(64, |rig| {
        // A glossy floor lights a wall; its reflections leave in one direction.
        let floor = Transform::from_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
        rig.spawn(square(4.0), shiny(Color::WHITE, 0.35, 1.0), floor.with_translation(Vec3::new(0.0, -1.0, 0.0)));
        rig.spawn(square(4.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -1.2));
        let lamp_at = Transform::from_xyz(0.0, 1.2, 0.6).looking_to(Vec3::new(0.0, 0.9, 0.4), Vec3::Z);
        rig.spawn(square(0.6), lamp(8.0, 8.0, 8.0), lamp_at);
    }) else {
        return;
    };
    let proof = Proof { bounces: 2, ..Proof::of((16, 10), (16, 32)) };
    let truth = proof.truth(&mut rig, 1000);
    let mut found = |paths: Paths| {
        // The standard error is 0.4 %, so that 2 % can be shown.
        let found = proof.resampled(&mut rig, &with(paths), 5000).compare(&truth, 0.02);
        eprintln!("{found}");
        found
    };
    let far = Paths {
        reuse: Reuse { radius: pixels(12.0, 32), spatial_samples: 3, ..paths::all_reuse().reuse },
        ..paths::all_reuse()
    };
    assert!(found(far.clone()).is_equal());
    // The glossy floor then seems to reflect equally in all directions: too bright outside of its highlight, too dark within it.
    assert!(found(Paths { assume_diffuse_secondary: true, ..far }).tiles < 1e-6);
}
