//! Russian roulette equals the f64 oracle: in a closed room of one albedo, the light that a path collects tells how many events it
//! survived, exactly.  Any probability is unbiased as long as survivors are weighted by it, so the values and their frequencies are tested
//! rather than a mean.

use crate::support::{app::*, oracle::roulette::furnace, proof::Subject, reuse_settings::paths, stats::chi_squared};
use bevy::prelude::*;
use bevy_restir::{
    Technique,
    testing::{plant_shader_defs, shader_library::ShaderEdit},
};
use glam::DVec3;

const EVENTS: i32 = 12;
const FRAMES: u32 = 8;
const SIZE: u32 = 64;

/// A closed room and the material of its walls.
fn closed_room() -> Option<(Rig, Handle<StandardMaterial>)> {
    let mut rig = Rig::new(SIZE, SIZE)?;
    let walls = StandardMaterial { double_sided: true, cull_mode: None, ..lamp(1.0, 1.0, 1.0) };
    let room = rig.spawn(Cuboid::from_length(20.0), walls, Transform::default());
    rig.set(|r| r.bounces = EVENTS as u32);
    let walls = rig.material_of(room);
    Some((rig, walls))
}

fn paint(rig: &mut Rig, walls: &Handle<StandardMaterial>, albedo: Vec3) {
    rig.edit(walls, |m| m.base_color = Color::linear_rgb(albedo.x, albedo.y, albedo.z));
}

fn choose(rig: &mut Rig, technique: Technique) {
    rig.set(|r| {
        paths::candidates_only().apply_to(r);
        (r.technique, r.accumulate) = (technique, false);
    });
    // Paths hit the walls by BSDF samples only, without a weight against light samples.
    plant_shader_defs(&mut rig.app, &["TEST_HITS", "TEST_ALONE", "TEST_BSDF_ALONE"]);
}

fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// The share of pixels whose light matches no number of events, and the p-value of the counts of paths by their number of events.
fn compare(rig: &mut Rig, albedo: Vec3) -> (f64, f64) {
    let expected = furnace(albedo.as_dvec3(), EVENTS);
    rig.until_ready();
    let mut counts = vec![0.0; expected.len()];
    let (mut strange, mut all) = (0.0, 0.0);
    for seed in 0..FRAMES {
        rig.set(|r| r.seed = seed);
        for (_, seen) in rig.next().iter() {
            // The camera sees the emission of the walls, 1.  Resampling keeps the luminance of all paths together.
            let light = luminance(seen.as_dvec3() - 1.0);
            let near = |(_, l): &(f64, DVec3)| (light / luminance(*l) - 1.0).abs() < 1e-4;
            match expected.iter().position(near) {
                Some(n) => counts[n] += 1.0,
                None => strange += 1.0,
            }
            all += 1.0;
        }
    }
    let expected: Vec<f64> = expected.iter().map(|(p, _)| p * all).collect();
    // Nothing can end before the roulette: those cells hold no path.
    let cells = expected.iter().zip(&counts).filter(|(e, c)| **e > 0.0 || **c > 3.0).map(|(e, c)| (*c, e.max(1e-3)));
    let (counts, expected): (Vec<f64>, Vec<f64>) = cells.unzip();
    (strange / all, chi_squared(&counts, &expected))
}

const TECHNIQUES: [Technique; 2] = [Technique::Pt, Technique::Reference];
const ALBEDOS: [Vec3; 2] = [Vec3::new(0.8, 0.5, 0.3), Vec3::new(0.6, 0.99, 0.9)];

#[test]
#[ignore = "second tier: ./run test --more"]
fn roulette_lets_paths_survive_with_the_probability_that_weights_them() {
    let Some((mut rig, walls)) = closed_room() else { return };
    for technique in TECHNIQUES {
        choose(&mut rig, technique);
        for albedo in ALBEDOS {
            paint(&mut rig, &walls, albedo);
            let (strange, p) = compare(&mut rig, albedo);
            eprintln!("{technique:?}, albedo {albedo}: {:.4} % strange, p = {p:.1e}", 100.0 * strange);
            assert!(strange < 1e-3 && p > 1e-4, "{technique:?}, albedo {albedo}: {strange}, p = {p}");
        }
    }
    rig.assert_sound();
}

#[test]
fn without_roulette_every_path_survives_all_events() {
    let Some((mut rig, walls)) = closed_room() else { return };
    choose(&mut rig, Technique::Pt);
    let albedo = ALBEDOS[0];
    paint(&mut rig, &walls, albedo);
    rig.set(|r| r.research.russian_roulette = false);
    rig.until_ready();
    let all: f64 = (1..=EVENTS).map(|n| luminance(albedo.as_dvec3().powf(f64::from(n)))).sum();
    for (_, seen) in rig.next().iter() {
        let light = luminance(seen.as_dvec3() - 1.0);
        assert!((light / all - 1.0).abs() < 1e-4, "{light} instead of {all}");
    }
    rig.assert_sound();
}

const CANDIDATES: &str = "restir/pt/initial_candidates.wgsl";
const ROULETTE: &str = "path/roulette.wgsl";
const REFERENCE: &str = "path/reference_integrator.wgsl";

const WRONG: [(&str, Technique, &str, &str, &str); 9] = [
    ("weight without q", Technique::Pt, CANDIDATES, "value * ucw / (*c).survival", "value * ucw"),
    ("q in the weight", Technique::Pt, CANDIDATES, "c.survival *= q;", "c.survival *= 0.99 * q;"),
    ("q in the test", Technique::Pt, CANDIDATES, "rng_1(rng) < q", "rng_1(rng) < 0.95 * q"),
    ("greatest q", Technique::Pt, ROULETTE, "MAX_SURVIVAL: f32 = 0.95", "MAX_SURVIVAL: f32 = 0.9"),
    (
        "q of the first event on",
        Technique::Pt,
        ROULETTE,
        "const ROULETTE_FROM: u32 = 3u;",
        "const ROULETTE_FROM: u32 = 2u;",
    ),
    (
        "throughput of all paths",
        Technique::Pt,
        CANDIDATES,
        "survival_probability(c.throughput, eta_scale / c.survival)",
        "survival_probability(c.throughput, eta_scale)",
    ),
    (
        "q in the weight of the reference",
        Technique::Reference,
        REFERENCE,
        "throughput /= q;",
        "throughput /= 1.01 * q;",
    ),
    ("q in the test of the reference", Technique::Reference, REFERENCE, "rng_1(rng) < q", "rng_1(rng) < 0.95 * q"),
    (
        "greatest q of the reference",
        Technique::Reference,
        ROULETTE,
        "MAX_SURVIVAL: f32 = 0.95",
        "MAX_SURVIVAL: f32 = 0.9",
    ),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_wrong_probabilities_of_roulette_are_found() {
    // Both limits of q matter for this albedo.
    let albedo = Vec3::new(0.97, 0.5, 0.8);
    let Some((mut rig, walls)) = closed_room() else { return };
    paint(&mut rig, &walls, albedo);
    let mut last = None;
    for (name, technique, module, from, to) in WRONG {
        if last.replace(technique) != Some(technique) {
            choose(&mut rig, technique);
        }
        plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
        let (strange, p) = compare(&mut rig, albedo);
        eprintln!("{name}: {:.4} % strange, p = {p:.1e}", 100.0 * strange);
        assert!(strange > 0.01 || p < 1e-6, "{name} is not found: {strange}, p = {p}");
    }
}
