//! Paths of ReSTIR PT and GI that go through translucent bodies equal the reference, still and moving, and planted errors are found.

use super::{
    shifts::turn,
    small_scenes::{bodies, check_moving},
};
use crate::{
    support::{
        app::*,
        proof::{Bidirectional, Proof},
        reuse_settings::paths,
        small_scenes::*,
    },
    techniques::bdpt::shifts::check_last_frame,
};
use bevy::prelude::*;
use bevy_restir::{Jitter, LightTechniques, Paths, Reconnection, testing::shader_library::ShaderEdit};

pub(super) const BOUNCES: u32 = 3;
/// For pictures of 64 x 64 pixels.
pub(super) const PROOF: Proof = Proof { bounces: BOUNCES, margin: 0.015, ..Proof::of((48, 16), (48, 64)) };
/// The same in motion.
pub(super) const MOVING: Proof = Proof { bounces: BOUNCES, margin: 0.02, ..Proof::of((200, 1), (40, 64)) };

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_between_translucent_bodies_equal_the_reference() {
    let Some(mut rig) = scene(64, translucent_room) else { return };
    let proof = Proof { bounces: BOUNCES, margin: 0.03, ..Proof::of((14, 8), (12, 20)) };
    proof.check("translucent room", &mut rig, &[("PT, both", paths::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_between_translucent_bodies_equal_the_reference() {
    check_light_paths(0.03, 44, &[("BDPT, both", paths::all_reuse())]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_paths_between_translucent_bodies_equal_the_reference() {
    let cases = [("BDPT, candidates", paths::candidates_only()), ("BDPT, both", paths::all_reuse())];
    check_light_paths(0.01, 260, &cases);
}

fn check_light_paths(margin: f64, restarts: u32, cases: &[(&str, Paths)]) {
    let Some(mut rig) = scene(32, translucent_room) else { return };
    rig.set(|r| r.jitter = Jitter::Always);
    let proof =
        Proof { bounces: BOUNCES, blended: true, margin, ..Proof::of((restarts, 6), (24.max(restarts / 4), 16)) };
    let cases: Vec<_> =
        cases.iter().map(|(name, paths)| (*name, Bidirectional(LightTechniques::Full, paths.clone()))).collect();
    proof.check("translucent room", &mut rig, &cases);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_kind_of_reuse_in_translucent_bodies_equals_the_reference() {
    let by_distance = Paths { reconnection: Reconnection::Distance, distance: 0.3, ..paths::all_reuse() };
    let separate = Paths { separate_direct_light: true, ..paths::all_reuse() };
    let cases = [
        ("PT, candidates", paths::candidates_only()),
        ("PT, temporal", paths::temporal()),
        ("PT, spatial", paths::spatial()),
        ("PT, both", paths::all_reuse()),
        ("PT, by distance", by_distance),
        ("PT, direct light apart", separate),
    ];
    let Some(mut rig) = bodies() else { return };
    PROOF.check("bodies", &mut rig, &cases);
    let Some(mut rig) = scene(64, translucent_room) else { return };
    let proof = Proof { margin: 0.01, ..PROOF };
    proof.check("translucent room", &mut rig, &cases);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_through_moving_bodies_equal_the_reference() {
    check_moving(MOVING, &[("PT, both", paths::all_reuse())]);
}

/// Rounding moves a point of a probe across an edge now and then.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_hundred_thousand_paths_through_moving_bodies_return_from_the_last_frame() {
    let moving = core::cell::Cell::new([Entity::PLACEHOLDER; 2]);
    let pose = |rig: &mut Rig, step: u32| turn(rig, moving.get(), step as f32);
    check_last_frame("moving bodies", |rig| moving.set(translucent(rig)), &pose, 100_000, 2e-3);
}

/// Each error is one line of a shader.
const PLANTED: [(&str, ShaderEdit); 2] = [
    (
        "probability of the choice",
        ShaderEdit {
            module: "path/scattering.wgsl",
            from: "return ScatteringChoice(true, p, exit_factor(v.surface, v.wo) / p);",
            to: "return ScatteringChoice(true, p, exit_factor(v.surface, v.wo));",
        },
    ),
    (
        "the probe is not replayed",
        ShaderEdit {
            module: "restir/shift/hybrid.wgsl",
            from: "let entry = replayed_entry(v, s.seed, index, previous);",
            to: "let entry = replayed_entry(v, s.seed + 1u, index, previous);",
        },
    ),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_planted_errors_in_paths_through_bodies_are_found() {
    let Some(mut rig) = scene(64, translucent_room) else { return };
    let proof = Proof { bounces: BOUNCES, ..Proof::of((16, 16), (16, 64)) };
    let truth = proof.truth(&mut rig, 1000);
    for (name, edit) in PLANTED {
        plant_edits(&mut rig.app, &[edit]);
        let result = proof.resampled(&mut rig, &paths::all_reuse(), 7000).compare(&truth, 0.01);
        println!("{name}: {result}");
        assert!(result.is_different(), "{name}: {result}");
    }
    plant_edits(&mut rig.app, &[]);
}
