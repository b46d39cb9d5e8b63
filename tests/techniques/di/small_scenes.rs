//! ReSTIR DI equals the reference at one bounce, in small scenes of 64 x 64 pixels.  Two one-sided tests at α = 0.01 compare the image
//! mean with a margin of 1 %, and chi-squared compares the 8 x 8 tiles.  Margins and lengths that differ from the default are beside their
//! scenes.

use crate::support::{app::*, proof::Proof, reuse_settings::di, small_scenes::*};
use bevy_restir::{Direct, Mis, Research, Reuse, testing::shader_library::ShaderEdit};

const ROOM: Proof = Proof::of((10, 3), (10, 24));

#[test]
fn direct_light_in_a_room_with_shadows_equals_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    ROOM.check(
        "room",
        &mut rig,
        &[
            ("candidates", di::candidates_only()),
            ("temporal", di::temporal()),
            ("spatial", di::spatial()),
            ("both", di::all_reuse()),
            ("balance", di::across_edges(Mis::Balance)),
            ("defensive", di::across_edges(Mis::DefensivePairwise)),
        ],
    );
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_in_a_room_with_shadows_equals_the_reference_with_further_settings() {
    let Some(mut rig) = shared(64, "room") else { return };
    let with = |direct| (direct, Research::default());
    let without_bsdf = Research { target_without_bsdf: true, ..Research::default() };
    ROOM.check(
        "room",
        &mut rig,
        &[
            ("not presampled", with(Direct { subset_count: 0, ..di::candidates_only() })),
            ("target without BSDF", (di::all_reuse(), without_bsdf)),
            ("1/|Z|", with(di::across_edges(Mis::OneOverZ))),
            ("pairwise", with(di::across_edges(Mis::Pairwise))),
            ("defensive gris", with(di::across_edges(Mis::DefensivePairwiseGris))),
        ],
    );
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_of_points_spots_and_suns_equals_the_reference() {
    let Some(mut rig) = shared(64, "punctual") else { return };
    Proof::DEFAULT.check("punctual", &mut rig, &[("candidates", di::candidates_only()), ("both", di::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_of_an_environment_equals_the_reference() {
    check_environment("map", true, &[("both", di::all_reuse())]);
}

/// The importance of an image that is written on the GPU may lag: only BSDF rays find light from cells whose importance is 0.
#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_from_a_sky_with_cells_of_no_importance_equals_the_reference() {
    let Some(mut rig) = scene(64, |rig| surrounded(rig, true)) else { return };
    let from = "    if !(total > 0.0) {\n        return 0.0;";
    let half = "    if !(total > 0.0) || cell.x < size.x / 2u {\n        return 0.0;";
    let proof = Proof { margin: 0.03, ..Proof::of((16, 3), (12, 24)) };
    let truth = proof.truth(&mut rig, 1000);
    plant_edits(&mut rig.app, &[ShaderEdit { module: "light/environment.wgsl", from, to: half }]);
    let found = proof.resampled(&mut rig, &di::temporal(), 2000).compare(&truth, proof.margin);
    eprintln!("{found}");
    assert!(found.is_equal(), "{found}");
    rig.assert_sound();
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_direct_light_of_environments_equals_the_reference() {
    let cases = [
        ("candidates", Direct { subset_count: 0, ..di::candidates_only() }),
        ("both", di::all_reuse()),
        ("pairwise", di::across_edges(Mis::Pairwise)),
    ];
    for (name, map) in [("uniform", false), ("map", true)] {
        check_environment(name, map, &cases);
    }
}

fn check_environment(name: &str, map: bool, cases: &[(&str, Direct)]) {
    let Some(mut rig) = scene(64, |rig| surrounded(rig, map)) else { return };
    Proof::of((36, 8), (14, 64)).check(name, &mut rig, cases);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_direct_light_on_mirrors_and_lacquer_equals_the_reference() {
    let Some(mut rig) = shared(64, "mirrors") else { return };
    Proof::DEFAULT.check("mirrors", &mut rig, &[("both", di::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_past_blended_panes_equals_the_reference() {
    let Some(mut rig) = scene(64, blended) else { return };
    let proof = Proof { blended: true, margin: 0.015, ..Proof::of((24, 14), (24, 24)) };
    let balance = Direct {
        reuse: Reuse { spatial_samples: 1, ..di::across_edges(Mis::Balance).reuse },
        ..di::across_edges(Mis::Balance)
    };
    proof.check("blended", &mut rig, &[("candidates", di::candidates_only()), ("balance", balance)]);
}
