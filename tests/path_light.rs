//! ReSTIR PT shows what the reference shows at four bounces, in small made scenes of 32 x 32 pixels.  Two one-sided tests at α = 0.01 on
//! the image mean, margin 1 %; the 8 x 8 tiles by chi-squared.

use crate::support::{direct::*, proof::Proof};
use bevy_restir::{Mis, Paths, Reconnection, ReuseOrder};

const PROOF: Proof = Proof { bounces: 4, ..Proof::of((32, 8), (40, 32)) };

/// Few candidates, so that a wrong weight shows, and neighbours across edges.
fn every() -> Paths {
    Paths { candidates: 4, radius: 6.0, spatial_taps: 2, heuristics: false, confidence_cap: 8.0, ..Default::default() }
}

fn candidates() -> Paths {
    Paths { temporal: false, spatial_taps: 0, ..every() }
}

fn temporal() -> Paths {
    Paths { spatial_taps: 0, ..every() }
}

fn spatial() -> Paths {
    Paths { temporal: false, ..every() }
}

#[test]
fn paths_in_a_room_carry_what_the_reference_carries_whatever_is_reused() {
    let Some(mut rig) = scene(32, |rig| {
        room(rig);
    }) else {
        return;
    };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("candidates", candidates()),
            ("temporal", temporal()),
            ("spatial", spatial()),
            ("both", every()),
            ("balance", Paths { mis: Mis::Balance, ..spatial() }),
            ("pairwise", Paths { mis: Mis::Pairwise, ..spatial() }),
            ("two rounds", Paths { rounds: 2, ..every() }),
            ("spatiotemporal", Paths { order: ReuseOrder::Spatiotemporal, ..every() }),
            ("no vector weights", Paths { vector_weights: false, ..every() }),
            ("by distance", Paths { reconnection: Reconnection::Distance, distance: 0.3, ..every() }),
        ],
    );
}

#[test]
fn paths_over_glossy_surfaces_carry_what_the_reference_carries() {
    let Some(mut rig) = scene(32, glossy) else { return };
    let often_replayed = Paths { footprint: 20.0, ..every() };
    let black_box = Paths { reconnection: Reconnection::BlackBox, roughness: 0.6, ..every() };
    let proof = Proof { bounces: 2, margin: 0.02, ..Proof::of((64, 16), (60, 64)) };
    proof.check("glossy", &mut rig, &[("both", every()), ("often replayed", often_replayed), ("black box", black_box)]);
}

#[test]
fn paths_by_mirrors_carry_what_the_reference_carries() {
    let Some(mut rig) = scene(32, mirrors) else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((64, 16), (60, 64)) };
    proof.check("mirrors", &mut rig, &[("both", every())]);
}

#[test]
fn paths_to_points_and_suns_carry_what_the_reference_carries() {
    let Some(mut rig) = scene(32, punctual) else { return };
    PROOF.check("punctual", &mut rig, &[("both", every())]);
}

#[test]
fn paths_to_an_environment_carry_what_the_reference_carries() {
    let Some(mut rig) = scene(32, |rig| surrounded(rig, true)) else { return };
    PROOF.check("surrounded", &mut rig, &[("candidates", candidates()), ("both", every())]);
}
