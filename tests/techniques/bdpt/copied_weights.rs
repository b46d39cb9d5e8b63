//! Copied MIS weights ([`ShiftedMis::Copied`]): the sign and the size of their bias, and that exact weights are as they were.

use crate::support::{
    app::*,
    proof::{Bidirectional, Proof, Subject, first_seed},
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
    // A weight that is not stored would be 0 or 1.
    let light = copied.0.mean() / reused.0.mean();
    assert!((light - 1.0).abs() < 0.1, "{light} times the light");
    assert_eq!(picture(Copied, paths::candidates_only).0, candidates.0);
    assert_eq!(picture(Exact, paths::all_reuse).0, reused.0);
    rig.assert_sound();
}

/// The bias of the image mean, with both kinds of reuse and within a frame alone.  A path between a lamp and the other side of a wall or of
/// glass has another weight in another pixel.  Exact weights have no bias in the same frames.
#[test]
#[ignore = "second tier: ./run test --more"]
fn explore_bias_of_copied_weights() {
    for (name, what, paths, least, greatest) in [
        ("room", "all", paths::all_reuse(), -0.5, 0.5),
        ("glass_lamp", "all", paths::all_reuse(), -0.5, 0.5),
        ("ajar", "all", paths::all_reuse(), -0.5, 0.5),
        ("room", "spatial", paths::spatial(), -0.5, 0.5),
        ("glass_lamp", "spatial", paths::spatial(), -0.5, 0.5),
    ] {
        let rig = if name == "room" { room_scene(32) } else { Rig::load(name, 32) };
        let Some(mut rig) = rig else { return };
        rig.set(|r| r.jitter = Jitter::Always);
        let proof = Proof { bounces: 4, blended: true, ..Proof::of((32, 12), (24, 150)) };
        let truth = proof.truth(&mut rig, first_seed(1000));
        let start = std::time::Instant::now();
        let [exact, copied] = [Exact, Copied].map(|mis| {
            let found = proof.resampled(&mut rig, &all_techniques(mis, paths.clone()), first_seed(2000));
            found.compare(&truth, proof.margin)
        });
        let line = format!(
            "{name}, {what}: exact {exact}, error {:.3} %; copied {copied}, error {:.3} %; {:.1} s",
            100.0 * exact.error,
            100.0 * copied.error,
            start.elapsed().as_secs_f64()
        );
        use std::io::Write;
        let mut file = std::fs::OpenOptions::new().append(true).create(true).open("/tmp/a_explore.txt").expect("opens");
        writeln!(file, "{line}").expect("writes");
        assert!(exact.sigma().abs() < 8.0, "{name}: {exact}");
        assert!((least..greatest).contains(&copied.difference), "{name}: {copied}");
        rig.assert_sound();
    }
}
