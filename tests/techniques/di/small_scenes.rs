//! Direct lighting shows what the reference shows at one bounce, in small made scenes of 32 x 32 pixels.  Two one-sided tests at α = 0.01
//! on the image mean, margin 1 %; the 8 x 8 tiles by chi-squared; lengths and powers are said where the scenes are.

use crate::support::{proof::Proof, reuse_settings::di, small_scenes::*};
use bevy_restir::{Direct, Mis};

#[test]
fn a_room_with_shadows_is_lit_as_by_the_reference() {
    let Some(mut rig) = room_scene(32) else { return };
    Proof::DEFAULT.check(
        "room",
        &mut rig,
        &[
            ("candidates", di::candidates_only()),
            ("not presampled", Direct { subset_count: 0, ..di::candidates_only() }),
            ("temporal", di::temporal()),
            ("spatial", di::spatial()),
            ("both", di::all_reuse()),
            ("simple target", Direct { simple_target: true, ..di::all_reuse() }),
            ("bilinear", Direct { bilinear: true, ..di::temporal() }),
            ("valid", di::across_edges(Mis::Valid)),
            ("balance", di::across_edges(Mis::Balance)),
            ("pairwise", di::across_edges(Mis::Pairwise)),
            ("defensive", di::across_edges(Mis::DefensivePairwise)),
            ("defensive gris", di::across_edges(Mis::DefensivePairwiseGris)),
        ],
    );
}

#[test]
fn points_spots_and_suns_light_as_in_the_reference() {
    let Some(mut rig) = scene(32, punctual) else { return };
    Proof::DEFAULT.check("punctual", &mut rig, &[("candidates", di::candidates_only()), ("both", di::all_reuse())]);
}

#[test]
fn an_environment_lights_as_in_the_reference() {
    for (name, map) in [("uniform", false), ("map", true)] {
        let Some(mut rig) = scene(32, |rig| surrounded(rig, map)) else { return };
        Proof::DEFAULT.check(
            name,
            &mut rig,
            &[
                ("candidates", Direct { subset_count: 0, ..di::candidates_only() }),
                ("both", di::all_reuse()),
                ("pairwise", di::across_edges(Mis::Pairwise)),
            ],
        );
    }
}

#[test]
fn mirrors_and_lacquer_show_what_the_reference_shows() {
    let Some(mut rig) = scene(32, mirrors) else { return };
    Proof::DEFAULT.check("mirrors", &mut rig, &[("both", di::all_reuse())]);
}

#[test]
fn blended_panes_and_lamps_light_as_in_the_reference() {
    // 64 x 64 pixels: noisier than the others, as chance decides what each pixel sees.
    let Some(mut rig) = scene(64, blended) else { return };
    let proof = Proof { blended: true, ..Proof::of((32, 16), (40, 32)) };
    let balance = Direct { spatial_taps: 1, ..di::across_edges(Mis::Balance) };
    proof.check("blended", &mut rig, &[("candidates", di::candidates_only()), ("balance", balance)]);
}
