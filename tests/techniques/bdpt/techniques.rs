//! The pictures of single techniques (s, t): with their MIS weights they sum to the reference; alone, each is the reference where it finds
//! all light.

use crate::support::{
    app::*,
    equivalence::Restarts,
    proof::{Bidirectional, Proof},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    Jitter, LightTechniques,
    testing::{plant_shader_defs, shader_library::ShaderEdit},
};

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
#[ignore = "minutes: ./run test --full"]
fn full_length_next_event_estimation_and_splats_alone_find_all_light_of_a_diffuse_room() {
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

/// A room with a second lamp, which is off in the last step: [`pose_lamps`].
fn lamps(rig: &mut Rig) {
    room(rig);
    let place = facing(Vec3::new(-0.9, 1.3, 0.5), Vec3::new(0.2, -1.0, 0.0));
    let second = rig.spawn(square(0.8), lamp(12.0, 12.0, 12.0), place);
    rig.insert(second, Name::new("second lamp"));
}

fn pose_lamps(rig: &mut Rig, step: u32) {
    let second = rig.named("second lamp");
    *rig.get_mut::<Visibility>(second) = if step < STEPS { Visibility::Inherited } else { Visibility::Hidden };
}

/// The lamp that stays gets three times as many light paths as before.  A planted error: radiance of paths that is divided by the probability of
/// their light.
#[test]
#[ignore = "second tier: ./run test --more"]
fn connections_keep_their_light_when_a_lamp_goes_out() {
    let Some(mut rig) = scene(32, lamps) else { return };
    plant_shader_defs(&mut rig.app, &["TEST_CONNECTIONS", "TEST_ALONE"]);
    let proof = Proof { pose: Some(&pose_lamps), bounces: 3, ..Proof::of((60, 1), (1, 1)) };
    let fresh = proof.resampled(&mut rig, &initial_samples(), 1000);
    let temporal = Bidirectional(LightTechniques::Full, paths::temporal());
    let found = proof.resampled(&mut rig, &temporal, 3000).compare(&fresh, 0.1);
    eprintln!("{found}");
    assert!(found.is_equal(), "{found}");
    rig.assert_sound();
    let kept = [
        ShaderEdit {
            module: "restir/connection/connection.wgsl",
            from: "p.throughput * light_pmf(p.light)",
            to: "p.throughput",
        },
        ShaderEdit {
            module: "restir/pt/initial_candidates.wgsl",
            from: "f32(chosen.count) / light_pmf(chosen.light)",
            to: "f32(chosen.count)",
        },
    ];
    plant_edits(&mut rig.app, &kept);
    let planted = proof.resampled(&mut rig, &temporal, 3000).compare(&fresh, 0.1);
    eprintln!("with the probability of the light: {planted}");
    assert!(planted.is_different(), "not found: {planted}");
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
#[ignore = "minutes: ./run test --full"]
fn full_length_planted_errors_of_bidirectional_paths_are_found() {
    let Some(mut rig) = jittered(|rig| {
        room(rig);
    }) else {
        return;
    };
    let truth = PROOF.truth(&mut rig, 1000);
    PROOF.finds(&mut rig, &truth, [("PLANT_MIS_ORDER", initial_samples())]);
}
