//! Direct lighting shows what the reference shows at one bounce.  Equivalence by two one-sided tests at α = 0.01 on the image mean,
//! margin 1 %, 40 independent restarts of 8 frames a technique (24 where glossy, 64 of the reference); and the 8 x 8 tiles by chi-squared.

use crate::support::{app::*, direct::*, equivalence::Restarts, stats::FAMILY_ALPHA};
use bevy::prelude::*;
use bevy_restir::{Direct, Mis};

const MARGIN: f64 = 0.01;
const ALPHA: f64 = 0.01;
const TRUTH_FRAMES: u32 = 64;

/// What is wrong with a technique, if anything.
fn fault(ours: &Restarts, truth: &Restarts) -> Option<String> {
    let (tost, tiles) = (ours.tost(truth, MARGIN), ours.tiles_p(truth));
    let (z, relative) = ours.difference(truth);
    let line = format!("off by {:.3} % ({z:.1} σ), TOST p = {tost:.1e}, tiles p = {tiles:.1e}", 100.0 * relative);
    eprintln!("    {line}");
    (tost >= ALPHA || tiles < FAMILY_ALPHA).then_some(line)
}

/// Holds techniques against the reference of one scene; one that fails is run once more on other seeds.
fn check(name: &str, rig: &mut Rig, frames: u32, techniques: &[(&str, Direct)]) {
    let reference = truth(rig, 1000, TRUTH_FRAMES);
    for (what, direct) in techniques {
        eprintln!("{name}, {what}");
        let Some(first) = fault(&resampled(rig, direct, 2000, frames), &reference) else { continue };
        let again = truth(rig, 3000, TRUTH_FRAMES);
        let second = fault(&resampled(rig, direct, 4000, frames), &again);
        assert!(second.is_none(), "{name}, {what}: {first}, then {second:?}");
    }
    rig.assert_sound();
}

#[test]
fn a_room_with_shadows_is_lit_as_by_the_reference() {
    let Some(mut rig) = scene(32, |rig| {
        room(rig);
    }) else {
        return;
    };
    check(
        "room",
        &mut rig,
        FRAMES,
        &[
            ("candidates", candidates_only()),
            ("not presampled", Direct { subset_count: 0, ..candidates_only() }),
            ("temporal", temporal()),
            ("spatial", spatial()),
            ("both", both()),
            ("simple target", Direct { simple_target: true, ..both() }),
            ("bilinear", Direct { bilinear: true, ..temporal() }),
            ("valid", careless(Mis::Valid)),
            ("balance", careless(Mis::Balance)),
            ("pairwise", careless(Mis::Pairwise)),
            ("defensive", careless(Mis::DefensivePairwise)),
            ("defensive gris", careless(Mis::DefensivePairwiseGris)),
        ],
    );
}

#[test]
#[ignore = "noisy: 1 % needs more restarts than this tier affords"]
fn glossy_surfaces_are_lit_as_by_the_reference() {
    let Some(mut rig) = scene(32, glossy) else { return };
    check(
        "glossy",
        &mut rig,
        3 * FRAMES,
        &[("candidates", candidates_only()), ("both", both()), ("balance", with_mis(Mis::Balance))],
    );
}

#[test]
fn points_spots_and_suns_light_as_in_the_reference() {
    let Some(mut rig) = scene(32, punctual) else { return };
    check("punctual", &mut rig, FRAMES, &[("candidates", candidates_only()), ("both", both())]);
}

#[test]
fn an_environment_lights_as_in_the_reference() {
    for (name, map) in [("uniform", false), ("map", true)] {
        let Some(mut rig) = scene(32, |rig| surrounded(rig, map)) else { return };
        check(
            name,
            &mut rig,
            FRAMES,
            &[
                ("candidates", Direct { subset_count: 0, ..candidates_only() }),
                ("both", both()),
                ("pairwise", careless(Mis::Pairwise)),
            ],
        );
    }
}

#[test]
#[ignore = "noisy: 1 % needs more restarts than this tier affords"]
fn many_small_emitters_light_as_in_the_reference() {
    let Some(mut rig) = scene(32, many) else { return };
    check(
        "many",
        &mut rig,
        4 * FRAMES,
        &[("both", both()), ("not presampled", Direct { subset_count: 0, ..with_mis(Mis::Balance) })],
    );
}

#[test]
fn mirrors_and_lacquer_show_what_the_reference_shows() {
    let Some(mut rig) = scene(32, mirrors) else { return };
    check("mirrors", &mut rig, FRAMES, &[("both", both())]);
}

#[test]
#[ignore = "noisy: 1 % needs more restarts than this tier affords"]
fn blended_panes_and_lamps_light_as_in_the_reference() {
    let Some(mut rig) = scene(32, blended) else { return };
    check("blended", &mut rig, 4 * FRAMES, &[("candidates", candidates_only()), ("balance", careless(Mis::Balance))]);
}
