//! ReSTIR DI equals the reference at one bounce, in scenes of `assets/scenes` and in a moving scene, at 64 x 64 pixels.  Two one-sided
//! tests at α = 0.01 compare the image mean and, with three times the margin (at least 3 %), the regions of 32 x 32 pixels; chi-squared
//! compares the tiles of 8 x 8 pixels.
//!
//! The long form is `matrix`.

use crate::support::{app::*, proof::Proof, small_scenes::*};
use bevy_restir::{Direct, Reuse, ReuseOrder, VisibilityReuse, testing::plant_shader_defs};

/// The default settings without reuse.
fn candidates() -> Direct {
    Direct {
        reuse: Reuse { temporal: false, spatial_samples: 0, disocclusion_samples: 0, ..Reuse::SPATIOTEMPORAL },
        ..Default::default()
    }
}

fn check(name: &str, proof: Proof) {
    let Some(mut rig) = Rig::load(name, 64) else { return };
    proof.check(name, &mut rig, &[("candidates", candidates()), ("both", Direct::default())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_in_the_cornell_box_equals_the_reference_for_every_kind_of_reuse() {
    let Some(mut rig) = Rig::load("cornell", 64) else { return };
    let classic = Direct {
        reuse: Reuse {
            order: ReuseOrder::TemporalThenSpatial,
            spatial_samples: 3,
            spatial_iterations: 2,
            ..Reuse::SPATIOTEMPORAL
        },
        ..Default::default()
    };
    // Rays are traced only where samples are shaded.  Otherwise, with lights of one color, all stored samples would have the same
    // radiance.
    let unshadowed = Direct { visibility: VisibilityReuse::Shading, bsdf_candidate: false, ..Default::default() };
    let proof = Proof { margin: 0.005, ..Proof::of((16, 8), (24, 16)) };
    proof.check(
        "cornell",
        &mut rig,
        &[
            ("candidates", candidates()),
            (
                "temporal",
                Direct {
                    reuse: Reuse { spatial_samples: 0, disocclusion_samples: 0, ..Reuse::SPATIOTEMPORAL },
                    ..Default::default()
                },
            ),
            ("pairs, the default", Direct::default()),
            ("spatiotemporal", Direct { reuse: Reuse::SPATIOTEMPORAL, ..Default::default() }),
            ("classic", classic),
            (
                "two rounds",
                Direct { reuse: Reuse { spatial_iterations: 2, ..Reuse::SPATIOTEMPORAL }, ..Default::default() },
            ),
            (
                "the stored sample is shaded",
                Direct { reuse: Reuse { shade_all: false, ..unshadowed.reuse.clone() }, ..unshadowed.clone() },
            ),
            ("all samples are shaded", unshadowed),
        ],
    );
    // A planted error must be found.
    let reference = proof.truth(&mut rig, 1000);
    plant_shader_defs(&mut rig.app, &["PLANT_SCALED_UCW"]);
    let found = proof.resampled(&mut rig, &candidates(), 2000).compare(&reference, 0.01);
    eprintln!("cornell, contribution weights of 1.03: {found}");
    assert!(found.is_different() && found.difference > 0.02, "{found}");
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_direct_light_on_glossy_surfaces_equals_the_reference() {
    check("glossy", Proof::of((32, 12), (40, 20)));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_direct_light_of_a_thousand_lights_equals_the_reference() {
    check("many_lights", Proof { margin: 0.02, ..Proof::of((40, 8), (40, 40)) });
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_direct_light_of_points_and_a_sun_equals_the_reference() {
    check("punctual", Proof::of((32, 8), (40, 40)));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_in_a_furnace_of_all_materials_equals_the_reference() {
    check("furnace", Proof::of((24, 8), (24, 16)));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn direct_light_in_a_moving_frame_equals_that_of_the_still_scene() {
    let Some(mut rig) = scene(64, moving) else { return };
    let proof = Proof { pose: Some(&pose_moving), margin: 0.015, ..Proof::of((30, 1), (14, 16)) };
    proof.check("moving", &mut rig, &[("candidates", candidates()), ("both", Direct::default())]);
}
