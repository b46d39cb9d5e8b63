//! ReSTIR DI where it is biased by design, with planted errors, and with invalid numbers.  The comparisons of `small_scenes` must be able
//! to fail.

use crate::support::{
    app::*,
    equivalence::{Comparison, Restarts},
    proof::Proof,
    reuse_settings::{di, pixels},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{BiasCorrection, Direct, Jitter, Mis, Restir, Technique, VisibilityReuse};

const PROOF: Proof = Proof::of((8, 6), (10, 24));

fn corrected(bias_correction: BiasCorrection, mis: Mis) -> Direct {
    Direct { bias_correction, ..di::across_edges(mis) }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn each_biased_mode_is_biased_with_its_documented_sign() {
    let Some(mut rig) = shared(64, "room") else { return };
    let reference = PROOF.truth(&mut rig, 1000);
    for (name, direct) in [
        ("off", corrected(BiasCorrection::Off, Mis::Balance)),
        ("heuristics", corrected(BiasCorrection::Heuristics, Mis::Balance)),
        ("heuristics and MIS", corrected(BiasCorrection::HeuristicsAndMis, Mis::DefensivePairwise)),
        ("heuristics and balance", corrected(BiasCorrection::HeuristicsAndMis, Mis::Balance)),
    ] {
        let found = PROOF.resampled(&mut rig, &direct, 5000).compare(&reference, 0.01);
        eprintln!("{name}: {found}");
        assert!(found.sigma() < -5.0 && found.difference < -0.01, "{name} is not darker: {found}");
    }
}

/// Relative differences from the truth: over the pixels in shadow, and over the others.
fn by_shadow(ours: &Restarts, truth: &Restarts, without_shadows: &Restarts) -> [f64; 2] {
    let per_restart = |r: &Restarts| r.pixels.iter().map(|p| p / r.images.len() as f64).collect::<Vec<_>>();
    let (ours, truth, lit) = (per_restart(ours), per_restart(truth), per_restart(without_shadows));
    [true, false].map(|shadow| {
        let of = |light: &[f64]| -> f64 {
            (0..light.len()).filter(|&i| (truth[i] < 0.5 * lit[i]) == shadow).map(|i| light[i]).sum()
        };
        of(&ours) / of(&truth) - 1.0
    })
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn each_reuse_of_visibility_is_biased_with_its_documented_sign() {
    let Some(mut rig) = shared(64, "room") else { return };
    let truth = PROOF.truth(&mut rig, 1000);
    let reusing = |visibility| Direct { reuse: di::one_neighbor(pixels(10.0, 32)), visibility, ..Direct::default() };
    let without_shadows = PROOF.resampled(&mut rig, &reusing(VisibilityReuse::Ignored), 5000);
    let mut found = |name: &str, direct: Direct| {
        let ours = PROOF.resampled(&mut rig, &direct, 5000);
        let (found, [inside, outside]) = (ours.compare(&truth, 0.01), by_shadow(&ours, &truth, &without_shadows));
        eprintln!("{name}: {found}; {:+.1} % in shadows, {:+.1} % elsewhere", 100.0 * inside, 100.0 * outside);
        (found, inside, outside)
    };
    let is_brighter = |found: Comparison| found.sigma() > 5.0;
    let is_darker = |found: Comparison| found.sigma() < -5.0;

    assert!(is_brighter(found("ignored", reusing(VisibilityReuse::Ignored)).0));
    assert!(is_brighter(found("discard", reusing(VisibilityReuse::Discard)).0));
    let half = Direct { bias_correction: BiasCorrection::HeuristicsAndMis, ..reusing(VisibilityReuse::Discard) };
    assert!(is_darker(found("discard, MIS without rays", half).0));
    let half = Direct { bias_correction: BiasCorrection::HeuristicsAndMis, ..reusing(VisibilityReuse::Resampled) };
    assert!(is_darker(found("resampled, MIS without rays", half).0));
    assert!(is_darker(found("decoupled", reusing(VisibilityReuse::Decoupled)).0));
    let near = Direct { visibility_radius: pixels(10.0, 32), ..reusing(VisibilityReuse::Decoupled) };
    for (name, direct) in [("candidates", reusing(VisibilityReuse::Candidates)), ("decoupled, near", near)] {
        let (_, inside, outside) = found(name, direct);
        assert!(inside > 0.01 && outside < -0.005, "{name} is not brighter in shadows and darker elsewhere");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn shading_visibility_is_biased_only_with_a_bsdf_candidate() {
    // Few candidates and light from all directions give the BSDF candidate a large weight.
    let Some(mut rig) = scene(64, |rig| surrounded(rig, false)) else { return };
    let truth = PROOF.truth(&mut rig, 1000);
    for bsdf_candidate in [false, true] {
        let direct = Direct {
            reuse: di::one_neighbor(pixels(10.0, 32)),
            candidates: 4,
            subset_count: 0,
            bsdf_candidate,
            ..Direct::default()
        };
        let direct = Direct { visibility: VisibilityReuse::Shading, ..direct };
        // Without candidates that are known to be visible the picture is noisy: these lengths can show 2 %.
        let margin = if bsdf_candidate { 0.01 } else { 0.02 };
        let found = PROOF.resampled(&mut rig, &direct, 5000).compare(&truth, margin);
        eprintln!("shading, BSDF candidate {bsdf_candidate}: {found}");
        if bsdf_candidate {
            assert!(found.is_different() && found.difference < 0.0, "{found}");
        } else {
            assert!(found.is_equal(), "{found}");
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn planted_errors_are_found() {
    let Some(mut rig) = shared(64, "room") else { return };
    let reference = PROOF.truth(&mut rig, 1000);
    let planted = [
        ("PLANT_SCALED_UCW", di::candidates_only()),
        ("PLANT_CONFIDENCE_OF_SUCCESS", di::across_edges(Mis::Pairwise)),
        ("PLANT_SWAPPED_MIS", di::across_edges(Mis::DefensivePairwise)),
        // With a single candidate the missing density has the largest effect.
        ("PLANT_MISSING_DENSITY", Direct { candidates: 1, ..di::candidates_only() }),
    ];
    // The errors are 28 to 180 standard errors at three times this length.
    Proof::of((8, 2), (10, 24)).finds(&mut rig, &reference, planted);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn nan_stays_in_its_reservoir() {
    let Some(mut rig) = shared(64, "room") else { return };
    PROOF.survives_nan(&mut rig, &[di::all_reuse()]);
}

fn direct(rig: &mut Rig) {
    rig.set(|r| *r = Restir { technique: Technique::Di, direct: di::all_reuse(), ..plain() });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn any_number_and_power_of_lights_gives_a_finite_picture() {
    type Lights = fn(&mut Rig);
    let point = |intensity| PointLight { intensity, ..default() };
    let cases: [(&str, bool, Lights); 5] = [
        ("none", false, |_| ()),
        ("one", true, |rig| {
            rig.spawn_bundle((PointLight { intensity: 50.0, ..default() }, Transform::from_xyz(0.5, 1.0, 1.0)));
        }),
        ("all black", false, |rig| {
            for x in [-1.0, 1.0] {
                rig.spawn_bundle((PointLight { intensity: 0.0, ..default() }, Transform::from_xyz(x, 1.0, 1.0)));
            }
            rig.spawn(square(0.5), lamp(0.0, 0.0, 0.0), Transform::from_xyz(0.0, 1.0, 0.5));
        }),
        ("infinite", true, |rig| {
            rig.spawn(square(0.5), lamp(f32::INFINITY, 1.0, 1.0), Transform::from_xyz(0.0, 1.0, 0.5));
            rig.spawn(square(0.5), lamp(1.0, 1.0, 1.0), Transform::from_xyz(0.5, 0.5, 0.5));
        }),
        ("huge", true, |rig| {
            rig.spawn(square(0.5), lamp(1e36, 1e37, 1e37), Transform::from_xyz(0.0, 0.6, 0.5));
        }),
    ];
    for (name, lit, lights) in cases {
        let Some(mut rig) = Rig::new(17, 13) else { return };
        rig.spawn(square(4.0), lambert(0.5), Transform::default());
        lights(&mut rig);
        rig.spawn_bundle((
            point(f32::INFINITY * f32::from(u8::from(name == "infinite"))),
            Transform::from_xyz(0.0, 0.0, 2.0),
        ));
        direct(&mut rig);
        rig.until_ready();
        rig.frames(4);
        let picture = rig.next();
        assert!(picture.is_finite(), "{name}");
        assert_eq!(picture.mean() > 0.0, lit, "{name}: {}", picture.mean());
        rig.assert_sound();
    }
}

/// The camera moves and nods, before the scene and behind it, and does not turn otherwise: Mesa 22.3 makes the first number of the camera's
/// matrix a constant of the pass that reuses, and compiles it again for every new value, four seconds each.
#[test]
#[ignore = "second tier: ./run test --more"]
fn eighty_frames_of_a_moving_camera_are_finite() {
    let Some(mut rig) = scene(24, blended) else { return };
    direct(&mut rig);
    rig.set(|r| r.jitter = Jitter::Always);
    let bytes = rig.until_ready().reservoir_bytes_per_pixel;
    assert!((1..=48).contains(&bytes), "{bytes}");
    for frame in 0..80 {
        let t = frame as f32 * 0.1;
        let side = if frame < 40 { 1.0 } else { -1.0 };
        let nod = Quat::from_rotation_x(0.25 * (1.3 * t).sin() - 0.1);
        let turn = if side > 0.0 { Quat::IDENTITY } else { Quat::from_xyzw(0.0, 1.0, 0.0, 0.0) };
        let place = Vec3::new(1.5 * t.sin(), 0.8 * (1.7 * t).sin(), side * (3.5 + 0.8 * t.cos()));
        *rig.get_mut::<Transform>(rig.camera) = Transform::from_translation(place).with_rotation(turn * nod);
        if frame % 10 == 9 {
            assert!(rig.next().is_finite(), "frame {frame}");
            assert_eq!(rig.report().raised_guards(), [], "frame {frame}");
        } else {
            rig.frame();
        }
    }
}
