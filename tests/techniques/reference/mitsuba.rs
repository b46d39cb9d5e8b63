//! Compares the reference tracer and bidirectional path tracing with pictures of an independent renderer (Mitsuba 3); the long form is in
//! `docs/proof-matrix.md`.
//!
//! Two runs with different seeds give a picture and, by their difference, its noise.  Means of the image and of tiles must agree within a
//! floor plus four (tiles: five) standard errors; a firefly raises both the mean and its standard error.  The floor of tiles also covers
//! errors that the noise between pixels does not show: all pixels share the jitter of a frame, so that a silhouette is shifted everywhere
//! at once.  The tests check their own power: a reference that is scaled by `planted`, or brighter by 40 % in one tile with little noise,
//! must be rejected.  Those with many samples also limit what floor and noise allow together: the image agrees within half a percent.

use crate::support::{
    app::*,
    cli::{Exr, Folder, asset, reference_entry},
};
use bevy::{
    light::{RectLight, SunDisk},
    prelude::*,
};
use bevy_restir::{Jitter, Technique};
use bevy_restir_support::environment::argument_of_reference;
use core::f32::consts::PI;

/// A scene, and how closely it must agree.
struct Case {
    technique: &'static str,
    scene: &'static str,
    /// The number of frames of each of the two runs.
    frames: u32,
    /// The relative difference of image means that is allowed beyond noise.
    floor: f64,
    /// The relative difference of tile means that is allowed beyond noise.
    tile_floor: f64,
    /// The greatest relative difference of image means that floor and noise together may allow, if that is limited.
    limit: Option<f64>,
    /// A relative error of the whole image that must be found.
    planted: f64,
}

const SIZE: usize = 128;
const TILE: usize = 32;

impl Case {
    /// A comparison with the reference tracer that allows half a percent, noise included.
    const fn within_half_a_percent(scene: &'static str, frames: u32, floor: f64) -> Self {
        let (tile_floor, limit, planted) = (0.02, Some(0.005), 0.01);
        Self { technique: "reference", scene, frames, floor, tile_floor, limit, planted }
    }

    /// The difference of image means that is allowed at this standard error.
    fn allowed(&self, error: f64) -> f64 {
        self.floor + 4.0 * error
    }
}

/// The mean of the channels of each pixel.
fn values(exr: &Exr) -> Vec<f64> {
    assert_eq!((exr.width, exr.height), (SIZE, SIZE));
    exr.pixels.iter().map(|p| p.iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0).collect()
}

/// Two independent estimates of every pixel, and the reference.
struct Pictures {
    halves: [Vec<f64>; 2],
    reference: Vec<f64>,
    reference_error: Vec<f64>,
}

impl Pictures {
    /// The relative difference of the means over some pixels, with its standard error.
    fn difference(&self, pixels: &[usize], reference_scale: impl Fn(usize) -> f64) -> (f64, f64) {
        let [a, b] = &self.halves;
        let reference: f64 = pixels.iter().map(|&i| self.reference[i] * reference_scale(i)).sum();
        let mean: f64 = pixels.iter().map(|&i| 0.5 * (a[i] + b[i])).sum();
        // Pixels are independent: the variance of a mean is the sum of theirs, (a - b)²/4 each, and that of the reference.
        let variance: f64 =
            pixels.iter().map(|&i| 0.25 * (a[i] - b[i]).powi(2) + self.reference_error[i].powi(2)).sum();
        // Differences in dark tiles are relative to a tenth of the mean tile.
        let average = self.reference.iter().sum::<f64>() / (SIZE * SIZE) as f64;
        let scale = reference.max(0.1 * average * pixels.len() as f64);
        ((mean - reference) / scale, variance.sqrt() / scale)
    }

    /// The reason why the picture disagrees with a scaled reference, if it does.
    fn disagreement(&self, case: &Case, scale: impl Fn(usize) -> f64) -> Option<String> {
        let all: Vec<usize> = (0..SIZE * SIZE).collect();
        let (difference, error) = self.difference(&all, &scale);
        if difference.abs() > case.allowed(error) {
            return Some(format!("the image differs by {difference:.5}, standard error {error:.5}"));
        }
        tiles().find_map(|tile| {
            let (difference, error) = self.difference(&tile, &scale);
            (difference.abs() > case.tile_floor + 5.0 * error).then(|| {
                format!("the tile from pixel {} differs by {difference:.4}, standard error {error:.4}", tile[0])
            })
        })
    }
}

fn tiles() -> impl Iterator<Item = Vec<usize>> {
    let across = SIZE / TILE;
    (0..across * across).map(move |t| {
        let (x0, y0) = (t % across * TILE, t / across * TILE);
        (0..TILE * TILE).map(|i| (y0 + i / TILE) * SIZE + x0 + i % TILE).collect()
    })
}

/// Renders a scene with the settings of `references.json`.
fn render_once(folder: &Folder, technique: &str, scene: &str, frames: u32, seed: u32) -> Exr {
    let entry = reference_entry(scene);
    let (bounces, frames, seed) = (entry["bounces"].to_string(), frames.to_string(), seed.to_string());
    let env = argument_of_reference(&entry, &asset(""));
    let mut arguments = [
        ["--technique", technique],
        ["--size", "128x128"],
        ["--set", "energy_compensation=false"],
        ["--bounces", &bounces],
        ["--frames", &frames],
        ["--seed", &seed],
        ["--out", "out.exr"],
    ]
    .concat();
    if let Some(env) = &env {
        arguments.extend(["--env", env]);
    }
    // Pixels that share samples are not independent, as the standard errors here take them to be.  `techniques::bdpt` proves reuse.
    if technique != "reference" {
        arguments.extend(["--set", "paths.reuse.temporal=false", "--set", "paths.reuse.spatial_samples=0"]);
    }
    folder.render(&asset(&format!("{scene}.glb")), &arguments).succeeded();
    Exr::read(&folder.path("out.exr"))
}

/// Renders a scene by the program.
fn check(case: Case) {
    let Some(folder) = Folder::new(&format!("{}_{}_{}", case.technique, case.scene, case.frames)) else { return };
    let render = |seed| values(&render_once(&folder, case.technique, case.scene, case.frames, seed));
    compare(&case, [11, 12].map(render));
}

/// Compares two independent pictures with the reference of a scene.
fn compare(case: &Case, halves: [Vec<f64>; 2]) {
    let exr = |name: String| values(&Exr::read(&asset(&name)));
    let (reference, reference_error) = (exr(format!("{}.exr", case.scene)), exr(format!("{}_se.exr", case.scene)));
    let pictures = Pictures { halves, reference, reference_error };
    let all: Vec<usize> = (0..SIZE * SIZE).collect();
    let (difference, error) = pictures.difference(&all, |_| 1.0);
    println!("{}, {}: {difference:+.5}, standard error {error:.5}", case.scene, case.technique);
    let is_powerful = case.limit.is_none_or(|limit| case.allowed(error) <= limit);
    assert!(is_powerful, "{}: too few samples, standard error {error:.5}", case.scene);
    if let Some(why) = pictures.disagreement(case, |_| 1.0) {
        panic!("{}: {why}", case.scene);
    }
    for scale in [1.0 + case.planted, 1.0 - case.planted] {
        assert!(pictures.disagreement(case, |_| scale).is_some(), "{}: {scale} of the reference passes", case.scene);
    }
    // Only tiles with little noise can show it.
    let average = pictures.reference.iter().sum::<f64>() / (SIZE * SIZE) as f64;
    let is_quiet = |tile: &Vec<usize>| {
        let light = tile.iter().map(|&i| pictures.reference[i]).sum::<f64>() / tile.len() as f64;
        light > 0.2 * average && case.tile_floor + 8.0 * pictures.difference(tile, |_| 1.0).1 < 0.28
    };
    let quiet: Vec<_> = tiles().filter(is_quiet).collect();
    assert!(quiet.len() >= 2, "{}: only {} tiles have little enough noise", case.scene, quiet.len());
    for tile in quiet {
        let inside = |i: usize| if tile.contains(&i) { 1.4 } else { 1.0 };
        assert!(pictures.disagreement(case, inside).is_some(), "{}: a tile brighter by 40 % passes", case.scene);
    }
}

macro_rules! scenes {
    ($($(#[$attribute:meta])* $name:ident: $technique:literal, $scene:literal, $frames:literal, $floor:literal, $tile_floor:literal, $planted:literal;)*) => {
        $(#[test]
        $(#[$attribute])*
        fn $name() {
            check(Case {
                technique: $technique,
                scene: $scene,
                frames: $frames,
                floor: $floor,
                tile_floor: $tile_floor,
                limit: None,
                planted: $planted,
            });
        })*
    };
}

scenes! {
    cornell_is_what_an_independent_renderer_shows: "reference", "cornell", 16, 0.003, 0.02, 0.03;
    glossy_is_what_an_independent_renderer_shows: "reference", "glossy", 16, 0.003, 0.02, 0.03;
    #[ignore = "second tier: ./run test --more"]
    blinds_is_what_an_independent_renderer_shows: "reference", "blinds", 16, 0.003, 0.02, 0.03;
    #[ignore = "second tier: ./run test --more"]
    punctual_is_what_an_independent_renderer_shows: "reference", "punctual", 64, 0.003, 0.04, 0.03;
    furnace_is_what_an_independent_renderer_shows: "reference", "furnace", 12, 0.003, 0.02, 0.03;
    #[ignore = "second tier: ./run test --more"]
    ajar_is_what_an_independent_renderer_shows: "reference", "ajar", 24, 0.005, 0.03, 0.06;
    #[ignore = "second tier: ./run test --more"]
    many_lights_is_what_an_independent_renderer_shows: "reference", "many_lights", 24, 0.01, 0.03, 0.1;
    #[ignore = "second tier: ./run test --more"]
    glass_lamp_is_what_an_independent_renderer_shows: "reference", "glass_lamp", 32, 0.01, 0.03, 0.06;
    #[ignore = "second tier: ./run test --more"]
    caustic_egg_is_what_an_independent_renderer_shows: "reference", "caustic_egg", 16, 0.01, 0.03, 0.06;
    #[ignore = "second tier: ./run test --more"]
    mirror_room_is_what_an_independent_renderer_shows: "reference", "mirror_room", 32, 0.01, 0.03, 0.06;
    textured_is_what_an_independent_renderer_shows: "reference", "textured", 32, 0.005, 0.02, 0.03;
    sky_is_what_an_independent_renderer_shows: "reference", "sky", 32, 0.003, 0.02, 0.03;
    #[ignore = "second tier: ./run test --more"]
    interior_is_what_an_independent_renderer_shows: "reference", "interior", 32, 0.003, 0.03, 0.03;
    bodies_are_what_an_independent_integral_over_their_surfaces_shows: "reference", "bodies", 32, 0.004, 0.03, 0.03;
    // A frame of a technique that resamples has one jitter for all pixels: a visible lamp needs many frames, not many pixels.
    #[ignore = "second tier: ./run test --more"]
    bidirectional_cornell_is_what_an_independent_renderer_shows: "bdpt", "cornell", 96, 0.003, 0.02, 0.03;
    #[ignore = "minutes: ./run test --full"]
    full_length_bidirectional_glossy_is_what_an_independent_renderer_shows: "bdpt", "glossy", 96, 0.003, 0.02, 0.03;
    #[ignore = "minutes: ./run test --full"]
    full_length_bidirectional_punctual_is_what_an_independent_renderer_shows: "bdpt", "punctual", 32, 0.003, 0.04, 0.03;
    #[ignore = "second tier: ./run test --more"]
    bidirectional_furnace_is_what_an_independent_renderer_shows: "bdpt", "furnace", 12, 0.003, 0.02, 0.03;
    #[ignore = "minutes: ./run test --full"]
    full_length_bidirectional_ajar_is_what_an_independent_renderer_shows: "bdpt", "ajar", 48, 0.005, 0.03, 0.06;
    #[ignore = "second tier: ./run test --more"]
    bidirectional_glass_lamp_is_what_an_independent_renderer_shows: "bdpt", "glass_lamp", 8, 0.01, 0.03, 0.06;
    #[ignore = "second tier: ./run test --more"]
    bidirectional_caustic_egg_is_what_an_independent_renderer_shows: "bdpt", "caustic_egg", 8, 0.01, 0.03, 0.06;
}

/// Textures with transforms, a normal map, an alpha mask, an emissive picture and a spot light.
#[test]
#[ignore = "second tier: ./run test --more"]
fn textured_agrees_with_an_independent_renderer_within_half_a_percent() {
    check(Case::within_half_a_percent("textured", 512, 0.003));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn sky_agrees_with_an_independent_renderer_within_half_a_percent() {
    check(Case::within_half_a_percent("sky", 256, 0.003));
}

/// The reference has a standard error of 0.108 %, so that there is no room for a floor.
#[test]
#[ignore = "second tier: ./run test --more"]
fn bodies_agree_with_an_integral_over_their_surfaces_within_half_a_percent() {
    check(Case { tile_floor: 0.03, ..Case::within_half_a_percent("bodies", 1024, 0.0) });
}

/// glTF has no area lights: this test adds those of the reference.
#[test]
#[ignore = "second tier: ./run test --more"]
fn area_lights_agree_with_an_independent_renderer_within_half_a_percent() {
    let case = Case::within_half_a_percent("area_lights", 512, 0.002);
    let Some(mut rig) = Rig::load(case.scene, SIZE as u32) else { return };
    // The lights of `make.py`: a sphere of radiance (6, 3, 2), a rectangle of (2, 4, 5), and a sun of 0.8 lux, 0.2 radians wide.
    let radius = 0.4;
    let candela = 6.0 * PI * radius * radius;
    let color = Color::linear_rgb(1.0, 0.5, 1.0 / 3.0);
    let sphere = PointLight { color, intensity: 4.0 * PI * candela, radius, ..default() };
    rig.spawn_bundle((sphere, Transform::from_xyz(-1.0, 2.8, 1.5)));
    let color = Color::linear_rgb(0.4, 0.8, 1.0);
    let rectangle = RectLight { color, intensity: 5.0 * PI * 1.2 * 0.5, width: 1.2, height: 0.5, ..default() };
    rig.spawn_bundle((rectangle, Transform::from_xyz(1.6, 2.5, 1.0).looking_at(Vec3::new(0.2, 0.3, -0.2), Vec3::Y)));
    let sun = DirectionalLight { illuminance: 0.8, ..default() };
    let disk = SunDisk { angular_size: 0.2, intensity: 1.0 };
    rig.spawn_bundle((sun, disk, Transform::default().looking_to(Vec3::new(-1.0, -2.0, -1.0), Vec3::Y)));
    rig.set(|restir| {
        restir.bounces = reference_entry(case.scene)["bounces"].as_u64().expect("the entry names them") as u32;
        (restir.technique, restir.jitter, restir.accumulate) = (Technique::Reference, Jitter::Always, true);
    });
    let halves = [11, 12].map(|seed| {
        rig.set(|restir| restir.seed = seed);
        rig.picture(case.frames).iter().map(|(_, color)| f64::from(color.element_sum()) / 3.0).collect()
    });
    compare(&case, halves);
    rig.assert_sound();
}

/// The mean over 8 x 8-pixel tiles of the absolute relative difference of luminance; dark tiles count as at least 2 % of the mean.
fn tile_difference(picture: &Exr, reference: &Exr) -> f64 {
    let luminance = |p: &[f32; 3]| 0.2126 * f64::from(p[0]) + 0.7152 * f64::from(p[1]) + 0.0722 * f64::from(p[2]);
    let tiles = |exr: &Exr| -> Vec<f64> {
        let mut sums = vec![0.0; (SIZE / 8) * (SIZE / 8)];
        for (i, pixel) in exr.pixels.iter().enumerate() {
            sums[(i / SIZE / 8) * (SIZE / 8) + i % SIZE / 8] += luminance(pixel) / 64.0;
        }
        sums
    };
    let (a, b) = (tiles(picture), tiles(reference));
    let mean = b.iter().sum::<f64>() / b.len() as f64;
    a.iter().zip(&b).map(|(a, b)| (a - b).abs() / b.max(0.02 * mean)).sum::<f64>() / a.len() as f64
}

/// Prints a table of `docs/proof-matrix.md`.
#[test]
#[ignore = "half an hour: ./run test --full"]
fn the_reference_tracer_meets_its_margins_at_full_length() {
    let Some(folder) = Folder::new("full_length") else { return };
    let mut failed = Vec::new();
    for (scene, frames, mean_margin, tile_margin) in [
        ("punctual", 512, 0.003, 0.01),
        ("furnace", 256, 0.003, 0.01),
        ("cornell", 640, 0.003, 0.01),
        ("glossy", 3072, 0.003, 0.01),
        ("blinds", 2048, 0.003, 0.01),
        ("ajar", 6144, 0.005, 0.02),
        ("many_lights", 1024, 0.01, 0.03),
        ("glass_lamp", 2048, 0.01, 0.03),
        ("caustic_egg", 512, 0.01, 0.03),
        ("mirror_room", 1024, 0.01, 0.03),
        ("bodies", 2048, 0.004, 0.02),
        ("textured", 768, 0.003, 0.01),
        ("sky", 768, 0.003, 0.01),
        ("interior", 3072, 0.003, 0.02),
    ] {
        let picture = render_once(&folder, "reference", scene, frames, 0);
        let reference = Exr::read(&asset(&format!("{scene}.exr")));
        let mean = |exr: &Exr| values(exr).iter().sum::<f64>() / (SIZE * SIZE) as f64;
        let difference = (mean(&picture) - mean(&reference)) / mean(&reference);
        let tiles = tile_difference(&picture, &reference);
        println!("| {scene} | {frames} | {:+.3} % | {:.2} % |", 100.0 * difference, 100.0 * tiles);
        if difference.abs() > mean_margin || tiles > tile_margin {
            failed.push(scene);
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}
