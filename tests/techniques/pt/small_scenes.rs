//! ReSTIR PT equals the reference in small scenes of 64 x 64 pixels, at two to four bounces.  Two one-sided tests at α = 0.01 compare the
//! image mean with a margin of 1 % (2 or 3 % where a proof says so), and chi-squared compares the 8 x 8 tiles.

use crate::support::{
    app::*,
    proof::{AllLight, Proof, Subject},
    reuse_settings::{di, paths, pixels},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{DebugView, Mis, Paths, Reconnection, Reuse, ReuseOrder};

const PROOF: Proof = Proof { bounces: 4, ..Proof::of((20, 6), (12, 24)) };

#[test]
fn paths_in_a_room_equal_the_reference_for_every_kind_of_reuse() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.check(
        "room",
        &mut rig,
        &[
            ("candidates", paths::candidates_only()),
            ("temporal", paths::temporal()),
            ("spatial", paths::spatial()),
            ("both", paths::all_reuse()),
        ],
    );
}

/// Frames without jitter have the same rays.  Where a sheet is blended with a wall close behind it, a pixel still shows one of them in one
/// frame and the other in the next, and takes them for the same surface: they are parallel.
#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_by_a_blended_sheet_equal_the_reference() {
    let sheet = StandardMaterial {
        base_color: Color::linear_rgba(0.2, 0.2, 0.2, 0.5),
        alpha_mode: AlphaMode::Blend,
        double_sided: true,
        cull_mode: None,
        ..lambert(0.0)
    };
    let made = scene(64, |rig| {
        room(rig);
        rig.spawn(square(2.4), sheet, Transform::from_xyz(0.0, 0.0, -1.17));
    });
    let Some(mut rig) = made else { return };
    PROOF.check("blended sheet", &mut rig, &[("temporal", paths::temporal())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_in_a_room_equal_the_reference_with_further_settings() {
    let Some(mut rig) = shared(64, "room") else { return };
    let proof = Proof { bounces: 4, ..Proof::of((26, 6), (16, 24)) };
    proof.check(
        "room",
        &mut rig,
        &[
            ("balance", Paths { reuse: Reuse { mis: Mis::Balance, ..paths::spatial().reuse }, ..paths::spatial() }),
            (
                "spatiotemporal",
                Paths {
                    reuse: Reuse { order: ReuseOrder::Spatiotemporal, ..paths::all_reuse().reuse },
                    ..paths::all_reuse()
                },
            ),
            ("pairwise", Paths { reuse: Reuse { mis: Mis::Pairwise, ..paths::spatial().reuse }, ..paths::spatial() }),
            (
                "two rounds",
                Paths { reuse: Reuse { spatial_iterations: 2, ..paths::all_reuse().reuse }, ..paths::all_reuse() },
            ),
            (
                "no vector weights",
                Paths { reuse: Reuse { shade_all: false, ..paths::all_reuse().reuse }, ..paths::all_reuse() },
            ),
            ("direct light apart", Paths { separate_direct_light: true, ..paths::all_reuse() }),
            ("by distance", Paths { reconnection: Reconnection::Distance, distance: 0.3, ..paths::all_reuse() }),
        ],
    );
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_over_glossy_surfaces_equal_the_reference() {
    let Some(mut rig) = shared(64, "glossy") else { return };
    let often_replayed = Paths { footprint: 20.0, ..paths::all_reuse() };
    let black_box = Paths { reconnection: Reconnection::BlackBox, roughness: 0.6, ..paths::all_reuse() };
    let proof = Proof { bounces: 2, margin: 0.03, ..Proof::of((20, 16), (20, 48)) };
    proof.check(
        "glossy",
        &mut rig,
        &[("both", paths::all_reuse()), ("often replayed", often_replayed), ("black box", black_box)],
    );
}

/// The criteria that the paper compares with, and constants with which they reconnect at other vertices than the default.
fn other_criteria(footprint: f32) -> [(&'static str, Paths); 3] {
    let kind = |reconnection| Paths { reconnection, footprint, ..paths::all_reuse() };
    [
        ("black box as printed", Paths { roughness: 0.9, ..kind(Reconnection::BlackBoxPrinted) }),
        ("bounded Jacobian", kind(Reconnection::JacobianBound)),
        ("footprint of the path", kind(Reconnection::PathFootprint)),
    ]
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_reconnected_by_other_criteria_equal_the_reference() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.check("room", &mut rig, &other_criteria(20.0));
}

/// The criterion by the footprint of the path lets paths reconnect at mirrors, where every shift then fails.
#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_by_mirrors_reconnected_by_other_criteria_equal_the_reference() {
    let Some(mut rig) = shared(64, "mirrors") else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((16, 6), (16, 24)) };
    proof.check("mirrors", &mut rig, &other_criteria(0.02));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_by_mirrors_equal_the_reference() {
    let Some(mut rig) = shared(64, "mirrors") else { return };
    let proof = Proof { bounces: 3, margin: 0.02, ..Proof::of((16, 6), (16, 24)) };
    proof.check("mirrors", &mut rig, &[("both", paths::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_over_every_lobe_equal_the_reference() {
    over_every_lobe(0.02, (24, 4), (24, 24));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_over_every_lobe_equal_the_reference() {
    over_every_lobe(0.005, (40, 32), (40, 160));
}

fn over_every_lobe(margin: f64, ours: (u32, u32), truth: (u32, u32)) {
    let Some(mut rig) = scene(64, every_lobe) else { return };
    let proof = Proof { bounces: 3, margin, ..Proof::of(ours, truth) };
    let all =
        [("PT", AllLight::Pt(paths::all_reuse())), ("DI + GI", AllLight::Gi(di::all_reuse(), paths::all_reuse()))];
    proof.check("every lobe", &mut rig, &all);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_to_points_and_suns_equal_the_reference() {
    let Some(mut rig) = shared(64, "punctual") else { return };
    PROOF.check("punctual", &mut rig, &[("both", paths::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_to_an_environment_equal_the_reference() {
    let Some(mut rig) = shared(64, "surrounded by an image") else { return };
    let proof = Proof { bounces: PROOF.bounces, ..Proof::of((32, 6), (40, 24)) };
    proof.check("surrounded", &mut rig, &[("candidates", paths::candidates_only()), ("both", paths::all_reuse())]);
}

/// A corner of a room that is lit only by light from the ceiling.
fn lit_from_the_ceiling(rig: &mut Rig) {
    let turned = |place: Vec3, x: f32, y: f32| {
        Transform::from_translation(place).with_rotation(Quat::from_rotation_y(y) * Quat::from_rotation_x(x))
    };
    let quarter = core::f32::consts::FRAC_PI_2;
    rig.spawn(square(4.0), lambert(0.7), turned(Vec3::new(0.0, -1.2, 0.0), -quarter, 0.0));
    rig.spawn(square(4.0), lambert(0.8), turned(Vec3::new(0.0, 1.5, 0.0), quarter, 0.0));
    rig.spawn(square(4.0), lambert(0.5), turned(Vec3::new(0.0, 0.0, -1.2), 0.0, 0.0));
    rig.spawn(square(4.0), lambert(0.6), turned(Vec3::new(-1.7, 0.0, 0.0), 0.0, quarter));
    rig.spawn(Cuboid::new(0.7, 0.7, 0.7), lambert(0.6), Transform::from_xyz(-0.6, -0.8, 0.2));
    rig.spawn(square(0.8), lamp(6.0, 5.0, 4.0), turned(Vec3::new(0.5, 0.9, 0.0), -quarter, 0.0));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn nan_stays_in_its_path_reservoir() {
    survives_nan(AllLight::Pt);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn nan_stays_in_its_reservoir_of_indirect_light() {
    survives_nan(|paths| AllLight::Gi(di::all_reuse(), paths));
}

fn survives_nan(subject: impl FnOnce(Paths) -> AllLight) {
    let Some(mut rig) = shared(64, "room") else { return };
    // One pass only: a second pass would lose the candidate of the pixel itself, and with it paths that no neighbor can find.
    let paths =
        Paths { reuse: Reuse { order: ReuseOrder::Spatiotemporal, ..paths::all_reuse().reuse }, ..paths::all_reuse() };
    Proof { margin: 0.015, ..PROOF }.survives_nan(&mut rig, &[subject(paths)]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn planted_errors_of_paths_are_found() {
    let Some(mut rig) = scene(64, lit_from_the_ceiling) else { return };
    let proof = Proof { bounces: 3, ..PROOF };
    let reference = proof.truth(&mut rig, 1000);
    let far = Paths {
        reuse: Reuse { radius: pixels(20.0, 32), spatial_samples: 3, ..paths::spatial().reuse },
        ..paths::spatial()
    };
    // The standard error is 0.7 %, so that 3 % can be shown; the planted errors are larger, or change the tiles.
    let right = proof.resampled(&mut rig, &far, 5000).compare(&reference, 0.03);
    eprintln!("no error: {right}");
    assert!(right.is_equal(), "{right}");
    let planted = [
        ("PLANT_SCALED_UCW", paths::candidates_only()),
        ("PLANT_NO_JACOBIAN", far.clone()),
        ("PLANT_SWAPPED_MIS", far),
    ];
    proof.finds(&mut rig, &reference, planted);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn debug_views_show_the_stored_paths() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| {
        paths::all_reuse().apply_to(r);
        r.bounces = 3;
    });
    let mut view = |view: DebugView, frames: u32| {
        rig.set(|r| (r.debug_view, r.reset) = (view, true));
        rig.until_ready();
        rig.set(|r| r.seed += 1);
        rig.frames(frames - 1);
        rig.next()
    };
    let all = |picture: &Picture, holds: &dyn Fn(Vec3) -> bool| picture.iter().all(|(_, c)| holds(c));
    // All paths end by NEE or by a BSDF hit of a light, none in an environment.  They have one to three events, and are at most as old as
    // the history.
    let ends = view(DebugView::PathEnds, 2);
    assert!(all(&ends, &|c| c.z == 0.0 && c.x + c.y <= 1.0) && ends.mean() > 0.2);
    let lengths = view(DebugView::PathLengths, 2);
    assert!(all(&lengths, &|c| [0.0, 1.0, 2.0, 3.0].contains(&c.x)) && lengths.mean() > 0.5);
    let reconnections = view(DebugView::PathReconnections, 2);
    assert!(all(&reconnections, &|c| [0.0, 2.0, 3.0, 4.0].contains(&c.x)));
    let ages = view(DebugView::PathAges, 4);
    assert!(all(&ages, &|c| c.x <= 3.0) && ages.mean() > 0.5, "{}", ages.mean());
    // After one frame: its own confidence and that of up to five neighbors, since no surface has a history.
    let one = view(DebugView::PathConfidence, 1);
    assert!(all(&one, &|c| c.x == 0.0 || (1.0..=6.0).contains(&c.x)));
    let jacobians = view(DebugView::PathJacobians, 2);
    assert!(all(&jacobians, &|c| c.is_finite() && c.x >= 0.0) && jacobians.mean() > 0.1);
    let shifts = view(DebugView::PathShifts, 2);
    assert!(shifts.iter().filter(|(_, c)| *c == Vec3::ONE).count() > 300, "most paths can be shifted");
}
