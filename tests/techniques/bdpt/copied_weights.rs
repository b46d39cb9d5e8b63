//! Copied MIS weights ([`ShiftedMis::Copied`]): the sign and the size of their bias, and that exact weights are as they were.

use crate::support::{
    app::*,
    proof::{Bidirectional, Proof, Subject},
    reuse_settings::paths,
    small_scenes::*,
};
use ShiftedMis::*;
use bevy_restir::{Jitter, LightTechniques, Paths, ShiftedMis};

fn all_techniques(mis: ShiftedMis, paths: Paths) -> (ShiftedMis, Bidirectional) {
    (mis, Bidirectional(LightTechniques::Full, paths))
}

/// Without shifts the variants are the same.  With them they differ, and only pipelines of the copied variant have code for it.
#[test]
#[ignore = "second tier: ./run test --more"]
fn only_shifted_paths_have_copied_weights() {
    let Some(mut rig) = room_scene(32) else { return };
    let mut picture = |mis, paths: fn() -> Paths| {
        rig.set(|r| {
            all_techniques(mis, paths()).apply_to(r);
            (r.bounces, r.seed, r.jitter) = (4, 1, Jitter::Always);
        });
        let picture = rig.picture(4);
        let is_copied = rig.report().pipelines.iter().any(|pipeline| pipeline.defs.contains(&"COPIED_MIS"));
        (picture, is_copied)
    };
    let (candidates, reused) = (picture(Exact, paths::candidates_only), picture(Exact, paths::all_reuse));
    assert!(!candidates.1 && !reused.1, "exact weights need no code of copied ones");
    let copied = picture(Copied, paths::all_reuse);
    assert!(copied.1);
    let differing = copied.0.iter().zip(reused.0.iter()).filter(|(a, b)| a != b).count();
    assert!(differing > 512, "{differing} of 1024 pixels");
    assert_eq!(picture(Copied, paths::candidates_only).0, candidates.0);
    assert_eq!(picture(Exact, paths::all_reuse).0, reused.0);
    rig.assert_sound();
}

/// Copied weights change the image mean by less than 0.5 %.  Found with the same seeds as exact weights: -0.11 % in the room and +0.07 % around
/// the lamp in glass; from the reference, which has noise of its own, +0.02 % ± 0.18 and +0.21 % ± 0.40 (exact weights: +0.13 % and
/// +0.14 %).  The weights of a path sum to 1 in its first pixel, and only light paths that the camera sees have those of their own pixel.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_copied_weights_keep_the_light_of_a_picture() {
    for (name, margin) in [("room", 0.01), ("glass_lamp", 0.02)] {
        let rig = if name == "room" { room_scene(32) } else { Rig::load(name, 32) };
        let Some(mut rig) = rig else { return };
        rig.set(|r| r.jitter = Jitter::Always);
        let proof = Proof { bounces: 4, blended: true, ..Proof::of((32, 12), (24, 150)) };
        let truth = proof.truth(&mut rig, 1000);
        let [exact, copied] = [Exact, Copied].map(|mis| {
            let subject = all_techniques(mis, paths::all_reuse());
            proof.resampled(&mut rig, &subject, 2000)
        });
        let bias = copied.mean() / exact.mean() - 1.0;
        let [exact, copied] = [exact, copied].map(|found| found.compare(&truth, margin));
        eprintln!("{name}: {:+.3} %; exact {exact}; copied {copied}", 100.0 * bias);
        assert!(bias.abs() < 0.005, "{name}: {bias}");
        assert!(exact.difference.abs() < margin && copied.difference.abs() < margin, "{name}: {exact}; {copied}");
        rig.assert_sound();
    }
}
