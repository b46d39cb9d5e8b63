//! ReSTIR PT and DI + GI as they come show what the reference shows, in scenes of `assets/scenes`, 64 x 64 pixels, four bounces.  Two
//! one-sided tests at α = 0.01 on the image mean, margin 1.5 %; regions and tiles as in `direct_scenes`.

use crate::support::{
    app::*,
    proof::{Indirect, Proof, Subject},
};
use bevy_restir::{Direct, Paths};

const BOUNCES: u32 = 4;

/// Reuse in time, in space, both and none.
fn reuses() -> [(&'static str, Paths); 4] {
    let both = Paths::default();
    [
        ("candidates", Paths { temporal: false, spatial_taps: 0, ..both.clone() }),
        ("temporal", Paths { spatial_taps: 0, ..both.clone() }),
        ("spatial", Paths { temporal: false, ..both.clone() }),
        ("both", both),
    ]
}

/// Light subsets of a size that a small picture needs.
fn direct() -> Direct {
    Direct { subset_count: 32, subset_size: 256, ..Direct::default() }
}

fn check(name: &str, proof: Proof, what: &[(&str, impl Subject)]) {
    let Some(mut rig) = Rig::load(name, 64) else { return };
    Proof { bounces: BOUNCES, ..proof }.check(name, &mut rig, what);
}

#[test]
fn the_cornell_box_is_lit_by_paths_as_by_the_reference() {
    let proof = Proof { margin: 0.015, ..Proof::of((32, 8), (40, 24)) };
    check("cornell", proof, &[("ReSTIR PT", Paths::default())]);
    check("cornell", proof, &[("ReSTIR DI + GI", Indirect(direct(), Paths::default()))]);
}

/// Every reuse of both techniques.
fn full(name: &str, proof: Proof) {
    check(name, proof, &reuses());
    check(name, proof, &reuses().map(|(what, paths)| (what, Indirect(direct(), paths))));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_all_reuse_of_paths_in_a_quiet_scene() {
    full("cornell", Proof { margin: 0.005, ..Proof::of((24, 16), (40, 40)) });
    full("furnace", Proof::of((24, 16), (40, 40)));
}

#[test]
#[ignore = "many minutes: ./run test --full"]
fn full_length_all_reuse_of_paths_in_noisy_scenes() {
    for name in ["glossy", "punctual", "blinds", "ajar", "mirror_room"] {
        full(name, Proof { margin: 0.02, ..Proof::of((40, 24), (40, 200)) });
    }
}
