//! The inside of a glowing ball: every technique renders the sum of a geometric series, so that no reference is needed.  With eight and 32
//! bounces the factors of Russian roulette compound.  In a ball, unlike in a box, every point of the surface sends the same light to every
//! other, so that samples of lights and of the BSDF have hardly any variance.

use crate::support::{app::*, proof::first_seed, stats::mean_and_error};
use bevy::prelude::*;
use bevy_restir::{Denoiser, Jitter, Preset, Restir, Technique};

const EMISSION: f32 = 0.25;
const ALBEDO: f32 = 0.8;

/// A camera in a ball whose wall glows and reflects.
fn furnace() -> Option<Rig> {
    let mut rig = Rig::new(64, 64)?;
    let wall = StandardMaterial {
        emissive: LinearRgba::rgb(EMISSION, EMISSION, EMISSION),
        double_sided: true,
        cull_mode: None,
        ..lambert(ALBEDO)
    };
    // Flat normals: interpolated ones tilt the lobes by up to three degrees, and each event loses 0.015 % of its light behind the facet.
    let ball = Sphere::new(2.0).mesh().ico(12).expect("the number of triangles is legal");
    let ball = ball.with_duplicated_vertices().with_computed_flat_normals();
    rig.spawn(ball, wall, Transform::from_xyz(0.3, 0.2, 4.6));
    Some(rig)
}

/// The mean radiance over eight restarts equals the closed form within 0.2 %.  The standard error must be small enough for that.  Each
/// restart has `history` frames before the `frames` that count.
fn check(technique: Technique, preset: Preset, history: u32, frames: u32) {
    let Some(mut rig) = furnace() else { return };
    // Light paths end anywhere in a pixel, so that camera paths must start anywhere in it, too.
    let jitter = if technique == Technique::Bdpt { Jitter::Always } else { Jitter::Auto };
    rig.set(|r| *r = Restir { technique, jitter, denoiser: Denoiser::OFF, ..Restir::preset(preset) });
    rig.until_ready();
    let bounces = if technique.has_indirect_light() { Restir::preset(preset).bounces } else { 1 };
    let expected: f64 = (0..=bounces).map(|k| f64::from(EMISSION) * f64::from(ALBEDO).powi(k as i32)).sum();
    let means = (0..8).map(|seed| {
        rig.set(|r| (r.seed, r.accumulate) = (first_seed(seed), false));
        rig.frames(history);
        rig.set(|r| r.accumulate = true);
        rig.frames(frames - 1);
        rig.next().mean()
    });
    let (mean, error) = mean_and_error(means.collect::<Vec<_>>());
    let (difference, error) = (mean / expected - 1.0, error / expected);
    eprintln!("{technique:?}, {preset:?}: {:+.3} % ± {:.3}", 100.0 * difference, 100.0 * error);
    rig.assert_sound();
    assert!(error < 0.0006, "{technique:?}, {preset:?}: the error {error:.1e} is too large for the margin");
    assert!(difference.abs() < 0.002, "{technique:?}, {preset:?}: off by {difference:+.4}");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_closed_furnace_is_in_balance_with_direct_light() {
    check(Technique::Di, Preset::Balanced, 8, 4);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_closed_furnace_is_in_balance_with_paths() {
    check(Technique::Pt, Preset::Balanced, 20, 40);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_closed_furnace_is_in_balance_with_light_paths() {
    check(Technique::Bdpt, Preset::Balanced, 20, 60);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_closed_furnace_is_in_balance_with_32_bounces() {
    check(Technique::Reference, Preset::Unbiased, 0, 60);
}

/// Paths of 32 bounces are resampled from neighbors with other numbers of bounces, so that 0.2 % need four times the frames.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_closed_furnace_is_in_balance_with_paths_of_32_bounces() {
    check(Technique::Pt, Preset::Unbiased, 30, 120);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_closed_furnace_is_in_balance_with_indirect_light() {
    check(Technique::Gi, Preset::Balanced, 20, 45);
}
