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

#[test]
#[ignore = "second tier: ./run test --more"]
fn explore_bias_of_copied_weights() {
    let scenes: [(&str, Option<fn(&mut Rig)>); 5] = [
        ("room", Some(|rig| _ = room(rig))),
        ("mirrors", Some(mirrors)),
        ("glossy", Some(glossy)),
        ("ajar", None),
        ("glass_lamp", None),
    ];
    for (name, make) in scenes {
        if std::env::var("SCENE").is_ok_and(|wanted| !wanted.contains(name)) {
            continue;
        }
        let rig = match make {
            Some(make) => scene(32, make),
            None => Rig::load(name, 32),
        };
        let Some(mut rig) = rig else { return };
        rig.set(|r| r.jitter = Jitter::Always);
        let proof = Proof { bounces: 4, blended: true, margin: 0.05, ..Proof::of((32, 12), (24, 150)) };
        let truth = proof.truth(&mut rig, 1000);
        for (what, paths) in [("all", paths::all_reuse()), ("spatial", paths::spatial())] {
            for mis in [Exact, Copied] {
                let start = std::time::Instant::now();
                let found = proof.resampled(&mut rig, &all_techniques(mis, paths.clone()), 2000).compare(&truth, 0.05);
                let line = format!(
                    "EXPLORE {name}, {what}, {mis:?}: {found}, error {:.3} %, {:.1} s",
                    100.0 * found.error,
                    start.elapsed().as_secs_f64()
                );
                use std::io::Write;
                let mut file =
                    std::fs::OpenOptions::new().append(true).create(true).open("/tmp/a_explore.txt").expect("opens");
                writeln!(file, "{line}").expect("writes");
            }
        }
    }
}
