//! The shift of paths is a change of variables.  Pixels are paired; a set of paths shifted to the partner has, by the Jacobian, the same
//! measure as the partner's own candidates that shift back.  Summed over all pixels, both sides are the same integral of any bounded
//! function of the path.  Also: with footprints as the criterion, the Jacobian to a neighboring pixel stays near 1 (Lin et al. 2026,
//! supplement, Eqs. 7 to 25).

use crate::support::{
    app::*,
    change_of_measure::{Measure, SIZE},
    proof::{Subject, emission},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    Paths, Reconnection, Reuse,
    testing::{plant_shader_defs, replace_pass_shader, shader_library::ShaderEdit},
};

const BOUNCES: u32 = 4;
const SEEDS: u32 = 160;

fn alone(paths: Paths) -> Paths {
    Paths { reuse: Reuse { temporal: false, spatial_samples: 0, ..paths.reuse.clone() }, ..paths }
}

/// Pictures of the candidates with these shader definitions, without the emission that the camera sees.
fn pictures(rig: &mut Rig, defs: &[&'static str], paths: Paths, seeds: u32) -> Vec<Vec<Vec3>> {
    let emitted = emission(rig);
    replace_pass_shader(&mut rig.app, "pt_candidates", include_str!("../../support/kernels/path_shift.wgsl"));
    plant_shader_defs(&mut rig.app, defs);
    rig.set(|r| {
        alone(paths).apply_to(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
    let pictures = (0..seeds).map(|seed| {
        rig.set(|r| r.seed = seed);
        let picture = rig.next();
        picture.iter().zip(emitted.iter()).map(|((_, c), (_, e))| c - e).collect()
    });
    let pictures = pictures.collect();
    plant_shader_defs(&mut rig.app, &[]);
    pictures
}

/// Paths are selected without regard to their light.  Their contribution weights are then bounded, and so is everything that is summed:
/// bright paths do not decide the sums.
const ANY_PATH: ShaderEdit = ShaderEdit {
    module: "restir/pt/initial_candidates.wgsl",
    from: "let value = luminance(f);",
    to: "let value = f32(luminance(f) > 0.0);",
};

fn measured(rig: &mut Rig, plant: &[&'static str], paths: Paths, seeds: u32) -> Measure {
    plant_edits(&mut rig.app, &[ANY_PATH]);
    // One light candidate has a bounded weight, too.
    let paths = Paths { candidates: 1, ..paths };
    Measure::of(&pictures(rig, &[&["TEST_CENSUS", "TEST_PAIRED"], plant].concat(), paths, seeds))
}

fn kinds() -> [(&'static str, Paths); 8] {
    let kind = |reconnection| Paths { reconnection, ..paths::unified() };
    [
        ("footprints", paths::unified()),
        ("half replayed", Paths { footprint: 0.5, ..paths::unified() }),
        ("black box", Paths { roughness: 0.6, ..kind(Reconnection::BlackBox) }),
        ("black box as printed", kind(Reconnection::BlackBoxPrinted)),
        ("bounded Jacobian", Paths { footprint: 2.0, ..kind(Reconnection::JacobianBound) }),
        ("footprint of the path", Paths { footprint: 2.0, ..kind(Reconnection::PathFootprint) }),
        ("by distance", Paths { distance: 0.5, ..kind(Reconnection::Distance) }),
        ("Jacobians to 2", Paths { jacobian_limit: 2.0, ..paths::unified() }),
    ]
}

#[test]
fn the_jacobian_is_the_change_of_measure_of_the_shift() {
    check(&["room"]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn the_jacobian_is_the_change_of_measure_through_translucent_bodies() {
    let Some(mut rig) = scene(SIZE as u32, translucent_room) else { return };
    let measure = measured(&mut rig, &[], paths::unified(), 2 * SEEDS);
    eprintln!("{measure}");
    assert!(measure.is_equal(0.01), "{measure}");
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_the_jacobian_is_the_change_of_measure_in_every_scene() {
    check(&["glossy", "mirrors", "surrounded", "shapes"]);
}

fn check(scenes: &[&str]) {
    for (name, make) in PATH_SCENES.iter().filter(|(name, _)| scenes.contains(name)) {
        let Some(mut rig) = scene(SIZE as u32, make) else { return };
        for (what, paths) in kinds() {
            // Where all surfaces are rough, the kinds choose the same vertices.
            if !matches!(what, "footprints" | "Jacobians to 2") && *name != "glossy" {
                continue;
            }
            // Glossy surfaces and mirrors have rare bright paths, which 1 % would need far more frames for.
            let margin = if matches!(*name, "glossy" | "mirrors") { 0.1 } else { 0.01 };
            let mut measure = measured(&mut rig, &[], paths.clone(), SEEDS);
            eprintln!("{name}, {what}: {measure}");
            if !measure.is_equal(margin) {
                // Like a proof, it goes on to four times the length and is judged once.
                measure = measured(&mut rig, &[], paths, 4 * SEEDS);
                eprintln!("{name}, {what}, four times the length: {measure}");
            }
            assert!(measure.is_equal(margin), "{name}, {what}: {measure}");
        }
    }
}

/// The distribution has heavy tails here, so that with fewer frames the p-values of tiles are too small.
#[test]
#[ignore = "second tier: ./run test --more"]
fn the_jacobian_is_the_change_of_measure_over_every_lobe() {
    let Some(mut rig) = scene(SIZE as u32, every_lobe) else { return };
    let measure = measured(&mut rig, &[], paths::unified(), 240);
    eprintln!("{measure}");
    assert!(measure.is_equal(0.05), "{measure}");
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_shift_that_is_not_a_change_of_variables_is_found() {
    let Some(mut rig) = scene(SIZE as u32, |rig| {
        room(rig);
    }) else {
        return;
    };
    let measure = measured(&mut rig, &["PLANT_NO_JACOBIAN"], paths::unified(), 100);
    eprintln!("{measure}");
    assert!(measure.tiles < 1e-9);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn footprints_keep_the_jacobian_near_one() {
    let Some(mut rig) = room_scene(128) else { return };
    // Among paths that reconnect: the share whose Jacobian to the next pixel is above 1.5 or below 1 / 1.5.
    let mut beyond = |footprint| {
        let paths = Paths { footprint, jacobian_limit: f32::MAX, ..paths::unified() };
        let all = pictures(&mut rig, &["TEST_JACOBIAN", "TEST_PAIRED"], paths, 4);
        let arrived = all.iter().flatten().filter(|c| c.x > 0.5 && c.z > 0.5);
        let (count, beyond) = arrived.fold((0, 0), |(n, m), c| (n + 1, m + u32::from(c.y > 1.5f32.ln())));
        assert!(count > 3_000, "{count}");
        f64::from(beyond) / f64::from(count)
    };
    let shares = [0.0, 0.02, 0.2, 2.0].map(&mut beyond);
    eprintln!("beyond 1.5: {shares:?}");
    assert!(shares.windows(2).all(|pair| pair[1] < 0.8 * pair[0]), "{shares:?}");
}
