//! The shift of paths is a change of variables: what it maps from one pixel to another has, measured there by its Jacobian, the volume that
//! the other's own candidates give to what comes back.  Pixels are paired; over all of them the sums of both are one integral, whatever
//! bounded function of the path is under it.  And near by the Jacobian stays near 1 (paper 000, Eqs. 7 to 25), by which footprints are
//! thresholds.

use crate::support::{
    app::*,
    direct::*,
    proof::{Subject, emission},
    stats::mean_and_error,
};
use bevy::prelude::*;
use bevy_restir::{Paths, Reconnection, plant_shader_defs};

const BOUNCES: u32 = 4;

fn alone(paths: Paths) -> Paths {
    Paths { temporal: false, spatial_taps: 0, ..paths }
}

/// Pictures of the candidates under some definitions, without what the camera sees emit.
fn pictures(rig: &mut Rig, defs: &[&'static str], paths: Paths, seeds: u32) -> Vec<Vec<Vec3>> {
    let emitted = emission(rig);
    plant_shader_defs(&mut rig.app, defs);
    rig.set(|r| {
        alone(paths).ask(r);
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

/// Mean of both sums, and their relative difference with its standard error.
fn census(rig: &mut Rig, plant: &[&'static str], paths: Paths, seeds: u32) -> (f64, f64, f64) {
    let defs = [&["TEST_CENSUS", "TEST_PAIRED"], plant].concat();
    let sums = pictures(rig, &defs, paths, seeds);
    let sum = |of: fn(&Vec3) -> f32| sums.iter().map(move |picture| picture.iter().map(|c| f64::from(of(c))).sum());
    let (mean, _) = mean_and_error(sum(|c| 0.5 * (c.x + c.y)));
    let (difference, error) = mean_and_error(sum(|c| c.x - c.y));
    (mean, difference / mean, error / mean)
}

type Make = fn(&mut Rig);

const SCENES: [(&str, Make); 4] = [
    ("room", |rig| {
        room(rig);
    }),
    ("glossy", glossy),
    ("mirrors", mirrors),
    ("surrounded", |rig| surrounded(rig, true)),
];

fn kinds() -> [(&'static str, Paths); 5] {
    [
        ("footprints", Paths::default()),
        ("half replayed", Paths { footprint: 0.5, ..Default::default() }),
        ("black box", Paths { reconnection: Reconnection::BlackBox, roughness: 0.6, ..Default::default() }),
        ("by distance", Paths { reconnection: Reconnection::Distance, distance: 0.5, ..Default::default() }),
        ("Jacobians to 2", Paths { jacobian_limit: 2.0, ..Default::default() }),
    ]
}

#[test]
fn the_shift_maps_volumes_as_its_jacobian_says() {
    for (name, make) in SCENES {
        let Some(mut rig) = scene(32, make) else { return };
        for (what, paths) in kinds() {
            let (sum, difference, error) = census(&mut rig, &[], paths, 60);
            eprintln!("{name}, {what}: {sum:.1}, {:+.2} % ± {:.2}", 100.0 * difference, 100.0 * error);
            assert!(sum > 50.0 && error < 0.03 && difference.abs() < 4.0 * error, "{name}, {what}");
        }
    }
}

#[test]
fn a_shift_that_is_not_one_to_one_is_found() {
    let Some(mut rig) = scene(32, glossy) else { return };
    let half = || Paths { footprint: 0.5, ..Default::default() };
    for plant in ["PLANT_UNCHECKED", "PLANT_NO_JACOBIAN"] {
        let (_, difference, error) = census(&mut rig, &[plant], half(), 60);
        eprintln!("{plant}: {:+.2} % ± {:.2}", 100.0 * difference, 100.0 * error);
        assert!(difference.abs() > 6.0 * error, "{plant}");
    }
}

#[test]
fn footprints_keep_the_jacobian_near_one() {
    let Some(mut rig) = scene(32, |rig| {
        room(rig);
    }) else {
        return;
    };
    // Of the paths that are reconnected, the share whose Jacobian to the next pixel is beyond 1.5 either way.
    let mut beyond = |footprint| {
        let paths = Paths { footprint, jacobian_limit: f32::MAX, ..Default::default() };
        let all = pictures(&mut rig, &["TEST_JACOBIAN", "TEST_PAIRED"], paths, 30);
        let arrived = all.iter().flatten().filter(|c| c.x > 0.5 && c.z > 0.5);
        let (count, beyond) = arrived.fold((0, 0), |(n, m), c| (n + 1, m + u32::from(c.y > 1.5f32.ln())));
        assert!(count > 3_000, "{count}");
        f64::from(beyond) / f64::from(count)
    };
    let shares = [0.0, 0.02, 0.5].map(&mut beyond);
    eprintln!("beyond 1.5: {shares:?}");
    assert!(shares[1] < 0.5 * shares[0] && shares[2] < 0.5 * shares[1], "{shares:?}");
}
