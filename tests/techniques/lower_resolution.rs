//! Pictures that are traced at a lower resolution and enlarged have the light of the reference.

use crate::support::app::*;
use bevy::{
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    prelude::*,
};
use bevy_restir::{Jitter, Paths, Restir, Technique};

const SIZE: u32 = 32;
/// Side of the regions that are compared, pixels.
const REGION: u32 = 8;
/// Restarts, and frames after each of them: frames of one run are correlated, and runs are not.
const RUNS: u32 = 24;
const FRAMES: u32 = 12;

/// A floor before a wall, under a lamp that the camera does not see: light is smooth everywhere.
fn corner() -> Option<Rig> {
    let mut rig = Rig::new(SIZE, SIZE)?;
    rig.spawn(square(8.0), lambert(0.7), Transform::default());
    let red = StandardMaterial { base_color: Color::linear_rgb(0.9, 0.3, 0.2), ..lambert(0.0) };
    rig.spawn(square(8.0), red, Transform::from_xyz(-1.2, 0.0, 0.0).looking_to(Vec3::NEG_X, Vec3::Y));
    rig.spawn(square(1.0), lamp(8.0, 8.0, 8.0), Transform::from_xyz(1.0, 0.5, 2.0).looking_to(Vec3::Z, Vec3::Y));
    let bare = (Tonemapping::None, DebandDither::Disabled, Msaa::Off, orthographic(2.0, 2.0));
    // The lamp is behind the near plane of this camera.
    rig.insert(rig.camera, (bare, Transform::from_xyz(0.0, 0.0, 1.5)));
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = float_target(UVec2::splat(SIZE)));
    Some(rig)
}

/// Sums of light over the regions, in rows.
fn regions(colors: impl Iterator<Item = Vec3>) -> Vec<f64> {
    let per_row = SIZE / REGION;
    let mut sums = vec![0.0; (per_row * per_row) as usize];
    for (i, color) in colors.enumerate() {
        let (x, y) = (i as u32 % SIZE, i as u32 / SIZE);
        sums[(y / REGION * per_row + x / REGION) as usize] += f64::from(color.element_sum());
    }
    sums
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_at_half_the_resolution_keep_the_light_of_smooth_regions() {
    let Some(mut rig) = corner() else { return };
    let settings = Restir { jitter: Jitter::Always, bounces: 3, accumulate: true, ..plain() };
    rig.set(|restir| *restir = settings.clone());
    let truth = regions(rig.picture(600).iter().map(|(_, color)| color));
    let paths = Paths { candidates: 4, ..plain().paths };
    let mut runs: Vec<Vec<f64>> = Vec::new();
    for seed in 0..RUNS {
        rig.set(|restir| {
            *restir = Restir {
                technique: Technique::Pt,
                resolution_scale: 0.5,
                seed,
                paths: paths.clone(),
                ..settings.clone()
            };
        });
        assert_eq!(rig.picture(FRAMES).size, UVec2::splat(SIZE / 2));
        runs.push(regions(rig.drawn_light().into_iter()));
    }
    let check = |name: &str, ratios: Vec<f64>, margin: f64| {
        let (mean, error) = mean_and_error(ratios);
        let off = mean - 1.0;
        eprintln!("{name}: off by {:+.2} % ± {:.2}", 100.0 * off, 100.0 * error);
        assert!(error < 0.5 * margin, "{name}: the test has no power: standard error {error}");
        assert!(off.abs() < margin + 3.0 * error, "{name}: {off} off, standard error {error}");
    };
    let sum = |regions: &[f64]| regions.iter().sum::<f64>();
    check("the whole picture", runs.iter().map(|run| sum(run) / sum(&truth)).collect(), 0.01);
    for (i, truth) in truth.iter().enumerate() {
        check(&format!("region {i}"), runs.iter().map(|run| run[i] / truth).collect(), 0.03);
    }
    rig.assert_sound();
}
