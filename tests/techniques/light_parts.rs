//! Diffuse and specular light: the parts of a frame sum to its light, surfaces with one kind of lobe have one part, and each part has the mean
//! that the reference gives it.

use crate::support::{
    app::*,
    reuse_settings::{di, paths, pixels, subsurface},
    small_scenes::{facing, shiny},
    stats::{chi_squared_of_differences, sidak},
};
use bevy::prelude::*;
use bevy_restir::{Bdpt, DebugView, Jitter, LightTechniques, Paths, Restir, Reuse, Subsurface, Technique};
use std::collections::BTreeMap;

const SIZE: u32 = 32;
/// Pixels per meter.
const SCALE: f32 = 8.0;

/// A sphere and the center of its pixels.
type Sample = (&'static str, IVec2);
const METAL: Sample = ("metal", IVec2::new(6, 9));
const PLASTIC: Sample = ("plastic", IVec2::new(16, 9));
const LACQUER: Sample = ("lacquer", IVec2::new(26, 9));
const GLASS: Sample = ("glass", IVec2::new(6, 22));
const BODY: Sample = ("body", IVec2::new(16, 22));
const CHALK: Sample = ("chalk", IVec2::new(26, 22));
/// Those of the first tier, whose shaders compile quickly, come first.
const SAMPLES: [Sample; 6] = [METAL, PLASTIC, CHALK, LACQUER, GLASS, BODY];
const SIMPLE: usize = 3;

/// The first `count` spheres before a wall that does not reflect everything diffusely, a lamp and a dim sky.
fn spheres(count: usize) -> Option<Rig> {
    let mut rig = Rig::new(SIZE, SIZE)?;
    rig.insert(rig.camera, (orthographic(4.0, 4.0), sky(0.3)));
    let lacquer = StandardMaterial {
        clearcoat: 1.0,
        clearcoat_perceptual_roughness: 0.3,
        ..shiny(Color::linear_rgb(0.2, 0.4, 0.7), 0.8, 0.0)
    };
    let glass =
        StandardMaterial { specular_transmission: 1.0, thickness: 0.8, ior: 1.5, ..shiny(Color::WHITE, 0.3, 0.0) };
    let materials = [
        shiny(Color::linear_rgb(0.9, 0.7, 0.4), 0.4, 1.0),
        shiny(Color::linear_rgb(0.3, 0.7, 0.3), 0.5, 0.0),
        lambert(0.6),
        lacquer,
        glass,
        StandardMaterial { reflectance: 0.5, ..lambert(0.8) },
    ];
    for ((name, at), material) in SAMPLES.into_iter().zip(materials).take(count) {
        let place = Vec3::new(at.x as f32 / SCALE - 2.0, 2.0 - at.y as f32 / SCALE, 0.0);
        let sphere = rig.spawn(Sphere::new(0.5).mesh().uv(24, 16), material, Transform::from_translation(place));
        if name == BODY.0 {
            rig.insert(sphere, Subsurface { mean_free_path: Vec3::new(0.2, 0.1, 0.05), weight: 0.7 });
        }
    }
    rig.spawn(square(3.8), shiny(Color::linear_rgb(0.6, 0.5, 0.5), 0.6, 0.3), Transform::from_xyz(0.0, 0.1, -0.7));
    rig.spawn(square(0.9), lamp(4.0, 5.0, 6.0), facing(Vec3::new(0.2, 2.2, 1.0), Vec3::ZERO));
    let unlit = StandardMaterial { unlit: true, ..Color::linear_rgb(0.2, 0.1, 0.3).into() };
    rig.spawn(square(0.3), unlit, Transform::from_xyz(0.0, 0.0, 0.2));
    Some(rig)
}

fn paths() -> Paths {
    Paths { candidates: 4, ..paths::all_reuse() }
}

/// Every technique, with its settings of reuse.
fn techniques() -> [(&'static str, Restir); 7] {
    let of = |technique| Restir {
        technique,
        jitter: Jitter::Always,
        energy_compensation: true,
        bounces: if technique.has_indirect_light() { 4 } else { 1 },
        direct: di::all_reuse(),
        subsurface: subsurface::all_reuse(),
        paths: paths(),
        bdpt: Bdpt { techniques: LightTechniques::Full, ..default() },
        ..plain()
    };
    let separate = Restir { paths: Paths { separate_direct_light: true, ..paths() }, ..of(Technique::Pt) };
    let selected = Reuse { shade_all: false, temporal: true, radius: pixels(6.0, SIZE), ..paths().reuse };
    [
        ("reference", of(Technique::Reference)),
        ("di", of(Technique::Di)),
        ("pt", of(Technique::Pt)),
        ("pt, selected", Restir { paths: Paths { reuse: selected, ..paths() }, ..of(Technique::Pt) }),
        ("gi", of(Technique::Gi)),
        ("pt, separate", separate),
        ("bdpt", of(Technique::Bdpt)),
    ]
}

/// Light, diffuse light, specular light and emission in the last one of some frames.
fn parts(rig: &mut Rig, settings: &Restir, frames: u32) -> [Picture; 4] {
    use DebugView::*;
    [(Off, settings.bounces), (DiffuseLight, settings.bounces), (SpecularLight, settings.bounces), (Off, 0)].map(
        |(debug_view, bounces)| {
            rig.set(|r| *r = Restir { debug_view, bounces, ..settings.clone() });
            rig.picture(frames)
        },
    )
}

/// The pixels of a sphere that do not touch its edge.
fn disk((_, center): Sample) -> impl Iterator<Item = (u32, u32)> {
    let offsets = (-3..3).flat_map(|y| (-3..3).map(move |x| IVec2::new(x, y)));
    offsets.filter(|d| (d.as_vec2() + 0.5).length() < 2.6).map(move |d| ((center + d).x as u32, (center + d).y as u32))
}

/// The parts sum to the light of the same frame, and surfaces with one kind of lobe have one part.
fn check_sums(names: &[&str], count: usize) {
    let Some(mut rig) = spheres(count) else { return };
    for (name, settings) in techniques().into_iter().filter(|(name, _)| names.contains(name)) {
        let all = parts(&mut rig, &settings, 3);
        let [light, diffuse, specular, emission] = &all;
        println!("{name}: {:?}", all.each_ref().map(Picture::mean));
        for (at, sum) in light.iter() {
            let [d, s, e] = [diffuse, specular, emission].map(|part| part.at(at.x, at.y));
            let error = (d + s + e - sum).abs().max_element();
            assert!(error <= 1e-5 * sum.max_element(), "{name} at {at}: {d} + {s} + {e} and {sum}");
        }
        let sum_over = |part: &Picture, sample| disk(sample).map(|(x, y)| part.at(x, y).element_sum()).sum::<f32>();
        let one_part = [(METAL, diffuse, specular), (GLASS, diffuse, specular), (CHALK, specular, diffuse)];
        for (sample, empty, full) in one_part.into_iter().filter(|(sample, ..)| SAMPLES[..count].contains(sample)) {
            let [empty, full] = [empty, full].map(|part| sum_over(part, sample));
            assert!(empty <= 1e-7 * full && full > 0.0, "{name}, {}: {empty} beside {full}", sample.0);
        }
        for sample in [PLASTIC, LACQUER, BODY].into_iter().filter(|sample| SAMPLES[..count].contains(sample)) {
            let [d, s] = [diffuse, specular].map(|part| sum_over(part, sample));
            assert!(d > 0.0 && s > 0.0, "{name}, {}: {d} and {s}", sample.0);
        }
    }
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn diffuse_and_specular_light_sum_to_the_light_of_a_frame() {
    check_sums(&["reference", "pt"], SIMPLE);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_diffuse_and_specular_light_sum_to_the_light_of_a_frame_in_every_technique() {
    check_sums(&["reference", "di", "pt", "pt, selected", "gi", "pt, separate", "bdpt"], SAMPLES.len());
}

/// Means of a part over the spheres and the whole picture, for each restart.
fn means(
    rig: &mut Rig,
    settings: &Restir,
    view: DebugView,
    seeds: core::ops::Range<u32>,
    frames: u32,
) -> Vec<Vec<f64>> {
    rig.set(|r| *r = Restir { debug_view: view, accumulate: true, ..settings.clone() });
    let mut means = vec![Vec::new(); SAMPLES.len() + 1];
    for seed in seeds {
        rig.set(|r| r.seed = seed);
        let picture = rig.picture(frames);
        for (means, &sample) in means.iter_mut().zip(&SAMPLES) {
            let sum: f64 = disk(sample).map(|(x, y)| f64::from(picture.at(x, y).element_sum())).sum();
            means.push(sum / disk(sample).count() as f64 / 3.0);
        }
        means[SAMPLES.len()].push(picture.mean());
    }
    means
}

/// Each part of each technique has the reference's mean.
fn check_means(names: &[&str], ours: (u32, u32), (restarts, length): (u32, u32)) {
    let Some(mut rig) = spheres(SAMPLES.len()) else { return };
    let seeds = 1000..1000 + restarts;
    let cases: Vec<_> = techniques().into_iter().filter(|(name, _)| names.contains(name)).collect();
    for view in [DebugView::DiffuseLight, DebugView::SpecularLight] {
        // By the number of bounces.
        let mut truths = BTreeMap::new();
        for (name, settings) in &cases {
            let reference = Restir { technique: Technique::Reference, ..settings.clone() };
            let truth = truths.entry(settings.bounces);
            let truth = truth.or_insert_with(|| means(&mut rig, &reference, view, seeds.clone(), length)).clone();
            let ours = means(&mut rig, settings, view, 0..ours.0, ours.1);
            let of = |v: &[f64]| mean_and_error(v.iter().copied());
            for (i, (a, b)) in ours.iter().zip(&truth).enumerate() {
                println!("{name}, {view:?}, {}: {:.4?}, {:.4?}", SAMPLES.get(i).map_or("all", |s| s.0), of(a), of(b));
            }
            let whole = of(&truth[SAMPLES.len()]).0;
            let p = chi_squared_of_differences(ours.into_iter().zip(truth), 1e-5 * whole);
            println!("{name}, {view:?}: p = {p:.2e}");
            assert!(p > sidak(2 * cases.len()), "{name}, {view:?}: p = {p:e}");
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn each_part_of_the_light_equals_that_of_the_reference() {
    check_means(&["di", "pt"], (10, 16), (10, 64));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_each_part_of_the_light_equals_that_of_the_reference_in_every_technique() {
    check_means(&["di", "pt", "gi", "bdpt"], (10, 16), (10, 64));
}
