//! ReSTIR PT and ReSTIR DI + GI with default settings equal the reference at four bounces, in scenes of `assets/scenes`.  Two one-sided
//! tests at α = 0.01 compare the image mean; regions and tiles as in `di::asset_scenes`.  Every kind of reuse, within 1 to 2 %, is in
//! `matrix`.

use crate::support::{
    app::*,
    proof::{AllLight, Proof},
    reuse_settings::paths,
};
use bevy_restir::{Direct, Paths, Reuse};

const BOUNCES: u32 = 4;

/// The size of the light subsets suits a small picture.
fn direct() -> Direct {
    Direct { subset_count: 32, subset_size: 256, ..Direct::default() }
}

fn check(name: &str, size: u32, proof: Proof) {
    let Some(mut rig) = Rig::load(name, size) else { return };
    let proof = Proof { bounces: BOUNCES, ..proof };
    let all = [
        ("ReSTIR PT", AllLight::Pt(Paths::default())),
        ("ReSTIR PT, one reservoir", AllLight::Pt(paths::unified())),
        ("ReSTIR DI + GI", AllLight::Gi(direct(), Paths::default())),
    ];
    proof.check(name, &mut rig, &all);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_in_the_cornell_box_equal_the_reference() {
    check("cornell", 64, Proof { margin: 0.015, ..Proof::of((32, 8), (40, 24)) });
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_in_quiet_scenes_equal_the_reference() {
    check("furnace", 64, Proof { margin: 0.01, ..Proof::of((16, 8), (16, 24)) });
    check("punctual", 64, Proof { margin: 0.025, ..Proof::of((16, 12), (16, 60)) });
    check("blinds", 64, Proof { margin: 0.025, ..Proof::of((16, 12), (16, 70)) });
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_in_noisy_scenes_equal_the_reference_within_five_percent() {
    for (name, size) in [("glossy", 64), ("ajar", 64), ("mirror_room", 64)] {
        check(name, size, Proof { margin: 0.05, ..Proof::of((40, 12), (24, 70)) });
    }
}

/// Default settings within 1 % in every scene, with nine times the pixels of `matrix` and other seeds.
fn check_within_one_percent(names: &[&str]) {
    for name in names {
        check(name, 96, Proof { margin: 0.01, ..Proof::of((40, 24), (40, 100)) });
    }
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_in_quiet_scenes_equal_the_reference_within_one_percent() {
    check_within_one_percent(&["cornell", "furnace", "punctual", "blinds"]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_in_noisy_scenes_equal_the_reference_within_one_percent() {
    check_within_one_percent(&["glossy", "ajar", "mirror_room"]);
}

/// If the rows of a scene in `matrix` err to one side, a long run of candidates alone tells bias from chance.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_long_runs_of_candidates_are_unbiased() {
    for name in ["punctual", "glossy"] {
        let Some(mut rig) = Rig::load(name, 96) else { return };
        let proof = Proof { margin: 0.01, bounces: BOUNCES, ..Proof::of((40, 24), (40, 100)) };
        let alone = Paths { reuse: Reuse { temporal: false, spatial_samples: 0, ..Reuse::PATHS }, ..paths::unified() };
        let all = [
            ("candidates of PT", AllLight::Pt(alone.clone())),
            (
                "candidates of DI + GI",
                AllLight::Gi(
                    Direct { reuse: Reuse { temporal: false, spatial_samples: 0, ..direct().reuse }, ..direct() },
                    alone,
                ),
            ),
        ];
        proof.check(name, &mut rig, &all);
    }
}
