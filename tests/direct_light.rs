//! Direct lighting shows what the reference shows at one bounce, in small made scenes of 32 x 32 pixels.  Two one-sided tests at α = 0.01
//! on the image mean, margin 1 %; the 8 x 8 tiles by chi-squared; lengths and powers are said where the scenes are.

use crate::support::{direct::*, proof::Proof};
use bevy_restir::{Direct, Mis};

#[test]
fn a_room_with_shadows_is_lit_as_by_the_reference() {
    let Some(mut rig) = scene(32, |rig| {
        room(rig);
    }) else {
        return;
    };
    Proof::DEFAULT.check(
        "room",
        &mut rig,
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
fn points_spots_and_suns_light_as_in_the_reference() {
    let Some(mut rig) = scene(32, punctual) else { return };
    Proof::DEFAULT.check("punctual", &mut rig, &[("candidates", candidates_only()), ("both", both())]);
}

#[test]
fn an_environment_lights_as_in_the_reference() {
    for (name, map) in [("uniform", false), ("map", true)] {
        let Some(mut rig) = scene(32, |rig| surrounded(rig, map)) else { return };
        Proof::DEFAULT.check(
            name,
            &mut rig,
            &[
                ("candidates", Direct { subset_count: 0, ..candidates_only() }),
                ("both", both()),
                ("pairwise", careless(Mis::Pairwise)),
            ],
        );
    }
}

#[test]
fn mirrors_and_lacquer_show_what_the_reference_shows() {
    let Some(mut rig) = scene(32, mirrors) else { return };
    Proof::DEFAULT.check("mirrors", &mut rig, &[("both", both())]);
}

#[test]
fn blended_panes_and_lamps_light_as_in_the_reference() {
    // 64 x 64 pixels: noisier than the others, as chance decides what each pixel sees.
    let Some(mut rig) = scene(64, blended) else { return };
    let proof = Proof { blended: true, ..Proof::of((32, 16), (40, 32)) };
    let balance = Direct { spatial_taps: 1, ..careless(Mis::Balance) };
    proof.check("blended", &mut rig, &[("candidates", candidates_only()), ("balance", balance)]);
}
