//! The pictures of single techniques (s, t): with their MIS weights they sum to the reference; alone, each is the reference where it finds
//! all light.

use crate::support::{
    app::*,
    equivalence::Restarts,
    proof::{Bidirectional, Proof},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy_restir::{Jitter, LightTechniques, testing::plant_shader_defs};

const PROOF: Proof = Proof { bounces: 3, blended: true, margin: 0.02, ..Proof::of((24, 8), (24, 16)) };
/// Hits of lights (s = 0), next-event estimation (s = 1), connections (s, t >= 2), light vertices that the camera sees (t = 1).
const TECHNIQUES: [&str; 4] = ["TEST_HITS", "TEST_NEE", "TEST_CONNECTIONS", "TEST_SPLATS"];

/// All techniques without reuse.
fn initial_samples() -> Bidirectional {
    Bidirectional(LightTechniques::Full, paths::candidates_only())
}

fn with_defs(rig: &mut Rig, proof: &Proof, defs: &[&'static str], first_seed: u32) -> Restarts {
    plant_shader_defs(&mut rig.app, defs);
    let found = proof.resampled(rig, &initial_samples(), first_seed);
    plant_shader_defs(&mut rig.app, &[]);
    found
}

fn sum(all: Vec<Restarts>) -> Restarts {
    let add = |a: &mut Vec<f64>, b: &[f64]| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    let mut parts = all.into_iter();
    let mut total = parts.next().expect("there are parts");
    for part in parts {
        add(&mut total.images, &part.images);
        total.regions.iter_mut().zip(&part.regions).for_each(|(a, b)| add(a, b));
        total.tiles.iter_mut().zip(&part.tiles).for_each(|(a, b)| add(a, b));
    }
    total
}

fn jittered(make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(32, make)?;
    rig.set(|r| r.jitter = Jitter::Always);
    Some(rig)
}

/// Asserts that the sum is right, and that each technique finds more than this share of the light.
fn check_sum(name: &str, rig: &mut Rig, proof: &Proof, least: f64) {
    let truth = proof.truth(rig, 1000);
    let parts: Vec<_> = TECHNIQUES.iter().map(|def| with_defs(rig, proof, &[def], 2000)).collect();
    for (def, part) in TECHNIQUES.iter().zip(&parts) {
        let share = part.mean() / truth.mean();
        eprintln!("{name}, {def}: {:.1} % of the picture", 100.0 * share);
        assert!(share > least, "{name}: {def} finds nothing");
    }
    let found = sum(parts).compare(&truth, proof.margin);
    eprintln!("{name}, sum: {found}");
    assert!(found.is_equal(), "{name}: {found}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn the_pictures_of_all_techniques_sum_to_the_reference() {
    let Some(mut rig) = jittered(mirrors) else { return };
    check_sum("mirrors", &mut rig, &Proof { margin: 0.03, ..PROOF }, 0.005);
}

/// A lamp in glass, a caustic under an egg, nearly closed slats, and a furnace.  In some of them a technique finds nothing.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_the_pictures_of_all_techniques_sum_to_the_reference_in_scenes_that_need_them() {
    for (name, margin, ours, truth) in [
        ("glass_lamp", 0.05, 24, 300),
        ("caustic_egg", 0.05, 24, 300),
        ("blinds", 0.05, 24, 300),
        ("furnace", 0.03, 8, 80),
    ] {
        let Some(mut rig) = Rig::load(name, 32) else { return };
        rig.set(|r| r.jitter = Jitter::Always);
        let proof = Proof { bounces: 4, blended: true, margin, ..Proof::of((24, ours), (24, truth)) };
        // Jitter differs between the picture and the emission that is subtracted from it.
        check_sum(name, &mut rig, &proof, -0.01);
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn next_event_estimation_and_splats_alone_find_all_light_of_a_diffuse_room() {
    let Some(mut rig) = jittered(|rig| {
        room(rig);
    }) else {
        return;
    };
    // One scattering event: both are complete.
    let proof = Proof { bounces: 1, ..PROOF };
    let truth = proof.truth(&mut rig, 1000);
    for def in ["TEST_NEE", "TEST_SPLATS"] {
        plant_shader_defs(&mut rig.app, &[def, "TEST_ALONE"]);
        let found = proof.resampled(&mut rig, &initial_samples(), 2000).compare(&truth, 0.05);
        eprintln!("{def}: {found}");
        assert!(found.is_equal(), "{def}: {found}");
    }
    // Up to three events: light vertices that the camera sees are complete.
    let truth = PROOF.truth(&mut rig, 3000);
    let found = with_defs(&mut rig, &PROOF, &["TEST_SPLATS", "TEST_ALONE"], 4000).compare(&truth, 0.03);
    eprintln!("three events: {found}");
    assert!(found.is_equal(), "{found}");
    rig.assert_sound();
}

/// Rays hit the small lamp of the room too seldom, so that this test has an emissive ceiling.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_hits_alone_find_all_light_of_a_large_lamp() {
    let Some(mut rig) = jittered(shining) else { return };
    let truth = PROOF.truth(&mut rig, 1000);
    let found = with_defs(&mut rig, &PROOF, &["TEST_HITS", "TEST_ALONE"], 2000).compare(&truth, 0.03);
    eprintln!("hits: {found}");
    assert!(found.is_equal(), "{found}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn planted_errors_of_bidirectional_paths_are_found() {
    let Some(mut rig) = jittered(|rig| {
        room(rig);
    }) else {
        return;
    };
    let truth = PROOF.truth(&mut rig, 1000);
    PROOF.finds(&mut rig, &truth, [("PLANT_MIS_ORDER", initial_samples())]);
}
