//! Lights and the environment are chosen with probability proportional to power, and alias tables represent the powers that they were
//! built from.

use crate::support::{
    app::*,
    compose::{Def, flag},
    gpu::{Bound, gpu},
    light_scene::LightScene,
    oracle::{
        light_choice::{Bin, choose},
        pairs::pcg4d,
    },
    stats::{assert_family, chi_squared},
};
use bevy::prelude::*;
use bevy_restir::{
    DebugView, Direct, Restir, Reuse, Technique,
    testing::gpu_layout::{GpuLight, NONE},
    testing::light::alias_table::alias_table,
};
use std::f64::consts::PI;

const ENVIRONMENT_LIGHT: u32 = u32::MAX - 1;
/// Least probability of the environment: `PROBABILITY_MIN` of `shaders/light/select.wgsl`.
const PROBABILITY_MIN: f64 = 0.2;

/// The choices of the kernel: the light and the bits of its pmf come first.
fn select(lit: &LightScene, seed: u32, count: usize, defs: &[Def]) -> Vec<[u32; 4]> {
    let seed = lit.gpu.storage(&[seed]);
    let choices = lit.gpu.zeroed::<[u32; 4]>(count);
    let bound = [(2, 0, Bound::Buffer(&seed)), (2, 1, Bound::Buffer(&choices))];
    lit.run("light_select", include_str!("../support/kernels/light_select.wgsl"), defs, count as u32, &bound);
    lit.gpu.read(&choices)
}

#[test]
fn lights_are_chosen_by_power() {
    let Some(gpu) = gpu() else { return };
    let mut many: Vec<f64> = (0..1000).map(|i| f64::from(i % 7) * f64::from(i % 13)).collect();
    many[17] = 5000.0;
    let spread: Vec<f64> = (0..3000).map(|i| (f64::from(i) * 0.01).exp()).collect();
    let cases = [vec![3.0], vec![1.0, 3.0], vec![0.0, 2.0, f64::NAN, 1.0, -1.0, f64::INFINITY], many, spread];
    // Radiance of the environment, and the limit of its probability.
    let environments = [(0.0, 0.8), (1.0, 0.8), (1e-9, 0.8), (1e9, 0.8), (1e9, 0.5)];
    let lit: Vec<_> = cases
        .iter()
        .flat_map(|powers| environments.map(|(environment, limit)| (powers, environment, limit)))
        .map(|(powers, environment, limit)| {
            let mut lit = LightScene::new(gpu);
            lit.lights = vec![GpuLight::default(); powers.len()];
            lit.set_powers(powers);
            lit.scene.radius = 2.0;
            lit.view.environment_color = [environment as f32; 3];
            lit.scene.environment_limit = limit;
            (lit, powers, environment)
        })
        .collect();
    assert_family(lit.iter().map(|(lit, powers, environment)| {
        let usable = |p: &f64| if p.is_finite() { p.max(0.0) } else { 0.0 };
        let total: f64 = powers.iter().map(usable).sum();
        let flux = 4.0 * PI * PI * 4.0 * environment;
        let has_environment = *environment > 0.0;
        let limit = f64::from(lit.scene.environment_limit);
        let share = if has_environment { (flux / (flux + total)).clamp(PROBABILITY_MIN, limit) } else { 0.0 };
        let pmf: Vec<f64> = powers.iter().map(|p| usable(p) / total * (1.0 - share)).chain([share]).collect();
        let test = move |seed: u32| {
            let mut counts = vec![0.0; pmf.len()];
            let defs: &[Def] = if has_environment { &[flag("ENVIRONMENT")] } else { &[] };
            for [light, choice, again, _] in select(lit, seed, 1 << 17, defs) {
                let light = if light == ENVIRONMENT_LIGHT { powers.len() } else { light as usize };
                counts[light] += 1.0;
                let choice = f64::from(f32::from_bits(choice));
                assert!(
                    (choice - pmf[light]).abs() <= 1e-4 * pmf[light] + 1e-8,
                    "{light}: {choice}, not {}",
                    pmf[light]
                );
                assert!(choice.to_bits() == f64::from(f32::from_bits(again)).to_bits() && choice > 0.0);
            }
            let expected: Vec<f64> = pmf.iter().map(|p| p * f64::from(1 << 17)).collect();
            chi_squared(&counts, &expected)
        };
        (
            format!("{} lights, environment {environment} up to {limit}", powers.len()),
            Box::new(test) as Box<dyn Fn(u32) -> f64>,
        )
    }));
}

/// Bins with the powers of a light or of the triangles of a mesh, and the light of an environment.
fn tables() -> Vec<(Vec<Vec<f64>>, f32)> {
    let uneven: Vec<f64> = (0..1000).map(|i| f64::from(i % 7) * f64::from(i % 13)).collect();
    let many: Vec<f64> = (0..100_000).map(|i| 1.0 + f64::from(i % 5)).collect();
    let hard = vec![vec![5.0], vec![0.0, 2.0, f64::NAN, -1.0], vec![f64::INFINITY], vec![0.0; 3], vec![1.0, 3.0]];
    let lamps = (0..3000).map(|i| vec![f64::from(i % 3)]).chain([many.clone()]).collect::<Vec<_>>();
    let cases = [vec![vec![1.0, 3.0]], vec![uneven, vec![3.0], vec![7.0; 600]], hard, vec![many], lamps];
    cases.into_iter().flat_map(|bins| [(bins.clone(), 0.0), (bins, 1e9)]).collect()
}

/// The probability of a triangle is that of its mesh times its share of it; each choice is the oracle's.
#[test]
fn triangles_of_meshes_are_chosen_by_power() {
    let Some(gpu) = gpu() else { return };
    let scenes: Vec<_> = tables()
        .into_iter()
        .map(|(bins, environment)| {
            let mut lit = LightScene::new(gpu);
            lit.set_bins(&bins);
            lit.view.environment_color = [environment; 3];
            lit.scene.environment_limit = 0.5;
            let share: f64 = if environment > 0.0 { 0.5 } else { 0.0 };
            (lit, bins, share)
        })
        .collect();
    assert_family(scenes.iter().map(|(lit, bins, share)| {
        let usable = |p: &f64| if p.is_finite() { p.max(0.0) } else { 0.0 };
        let total: f64 = bins.iter().flatten().map(usable).sum();
        // By the ids of the lights.
        let mut pmf = vec![0.0; lit.lights.len()];
        for (bin, powers) in bins.iter().enumerate() {
            let first = lit.first_light(bin);
            for (pmf, power) in pmf[first..].iter_mut().zip(powers) {
                *pmf = usable(power) / total * (1.0 - share);
            }
        }
        pmf.push(*share);
        let bin_of = |(bin, (light, powers)): (usize, (&GpuLight, &Vec<f64>))| {
            let count = if powers.len() > 1 { powers.len() } else { 0 };
            let triangles = &lit.lights[lit.first_light(bin)..][..count];
            Bin { entry: light.into(), triangles: triangles.iter().map(Into::into).collect() }
        };
        let table: Vec<Bin> = lit.bins().iter().zip(bins).enumerate().map(bin_of).collect();
        let test = move |seed: u32| {
            let mut counts = vec![0.0; pmf.len()];
            let defs: &[Def] =
                if *share > 0.0 { &[flag("LIGHT_TRIANGLES"), flag("ENVIRONMENT")] } else { &[flag("LIGHT_TRIANGLES")] };
            let mut others = 0;
            for ([light, choice, again, _], id) in select(lit, seed, 1 << 17, defs).into_iter().zip(0..) {
                let chosen = if light == ENVIRONMENT_LIGHT { lit.lights.len() } else { light as usize };
                counts[chosen] += 1.0;
                let choice = f64::from(f32::from_bits(choice));
                let wanted = pmf[chosen];
                assert!((choice - wanted).abs() <= 1e-4 * wanted + 1e-10, "{chosen}: {choice}, not {wanted}");
                assert!(choice.to_bits() == f64::from(f32::from_bits(again)).to_bits() && choice > 0.0);
                let [x, y, ..] = pcg4d([id, seed, 79, 0]);
                let oracle = choose(&table, [x >> 8, y >> 8], *share);
                let oracle = oracle.map(|(bin, triangle)| lit.first_light(bin) + triangle);
                others += u32::from(oracle.unwrap_or(lit.lights.len()) != chosen);
            }
            // f32 rounds where a coin is tossed at the probability itself.
            assert!(others <= 2, "{others} choices differ from those of the oracle");
            let expected: Vec<f64> = pmf.iter().map(|p| p * f64::from(1 << 17)).collect();
            chi_squared(&counts, &expected)
        };
        (format!("{} bins, environment {share}", bins.len()), Box::new(test) as Box<dyn Fn(u32) -> f64>)
    }));
}

/// The numbers of choices of each light, by the first random numbers behind those of the environment.  Divided by `COLUMNS` and 2^24, they
/// are the probabilities of lights that no other numbers choose.
fn first_choices(lit: &LightScene, environment: f32) -> Vec<u32> {
    const ROWS: u32 = 3;
    let gpu = lit.gpu;
    let chosen = gpu.zeroed::<u32>((COLUMNS * ROWS) as usize);
    let first = gpu.storage(&[(environment * 16_777_216.0f32).ceil() as u32]);
    let bound = [(2, 0, Bound::Buffer(&first)), (2, 1, Bound::Buffer(&chosen))];
    let kernel = include_str!("../support/kernels/light_select_first.wgsl");
    let defs = [flag("ENVIRONMENT"), flag("LIGHT_TRIANGLES")];
    lit.run("light_select_first", kernel, &defs, COLUMNS * ROWS, &bound);
    let mut counts = vec![0; lit.lights.len()];
    gpu.read::<u32>(&chosen).into_iter().for_each(|light| counts[light as usize] += 1);
    counts
}

/// The columns of the kernel `light_select_first`.
const COLUMNS: u32 = 1 << 20;

/// The random numbers have 24 bits; a dim light has a part of the smallest of their steps.
#[test]
fn a_dim_light_is_chosen_with_its_probability() {
    let Some(gpu) = gpu() else { return };
    let mut lit = LightScene::new(gpu);
    // A dim mesh keeps the shares of its triangles.
    for dim in [vec![3e-8], vec![0.75e-8, 2.25e-8]] {
        lit.set_bins(&[vec![1.0], dim.clone()]);
        for environment in [0.0, 0.8] {
            // A share of 0.8 is that of any bright environment.
            lit.view.environment_color = [1e9 * environment; 3];
            let counts = first_choices(&lit, environment);
            for (count, power) in counts[lit.first_light(1)..].iter().zip(&dim) {
                let wanted = power * (1.0 - f64::from(environment)) * f64::from(COLUMNS) * 16_777_216.0;
                let ratio = f64::from(*count) / wanted;
                println!("{dim:?} with an environment of {environment}: {ratio:.4} times the probability");
                assert!(
                    (ratio - 1.0).abs() < 4.0 / wanted.sqrt(),
                    "{dim:?} with an environment of {environment}: {ratio}"
                );
            }
        }
    }
}

#[test]
fn a_dim_triangle_of_a_mesh_is_chosen_with_its_probability() {
    const COINS: u32 = 1024;
    let Some(gpu) = gpu() else { return };
    let mut lit = LightScene::new(gpu);
    lit.set_bins(&[vec![1.0, 3e-8]]);
    for (place, power) in [(0x4000_0000u32, 0.0), (0xc000_0000, 3e-8)] {
        let chosen = gpu.zeroed::<u32>(64 * COINS as usize);
        let place = gpu.storage(&[place]);
        let bound = [(2, 0, Bound::Buffer(&place)), (2, 1, Bound::Buffer(&chosen))];
        let kernel = include_str!("../support/kernels/light_of_bin.wgsl");
        lit.run("light_of_bin", kernel, &[flag("LIGHT_TRIANGLES")], 64 * COINS, &bound);
        let second = lit.first_light(0) as u32 + 1;
        let count = gpu.read::<u32>(&chosen).into_iter().filter(|light| *light == second).count();
        // Each place is one half of the table.
        let probability = 0.5 * count as f64 / 64.0 / 2f64.powi(32);
        println!("{probability:e} of {power:e}");
        assert!((probability - power).abs() <= 5e-4 * power, "{probability:e}, not {power:e}");
    }
}

/// The flux of a sun grows with the ground around a room, in which it may light nothing.
#[test]
fn a_sun_over_a_wide_ground_leaves_light_candidates_to_a_lamp() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, orthographic(2.0, 2.0));
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn(square(2000.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -10.0));
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 2.0)));
    // It shines on the backs of both.
    let sun = DirectionalLight { illuminance: 1e4, ..default() };
    rig.spawn_bundle((sun, Transform::default().looking_to(Vec3::Z, Vec3::Y)));
    let direct = Direct {
        reuse: Reuse { temporal: false, spatial_samples: 0, ..Reuse::SPATIOTEMPORAL },
        candidates: 16,
        ..default()
    };
    rig.set(|r| *r = Restir { technique: Technique::Di, direct, ..plain() });
    // One of five candidates is the lamp: 97 % of the pixels find it.
    let lit = rig.picture(1).iter().filter(|(_, light)| light.x > 0.0).count();
    assert!(lit > 200, "{lit} of 256 pixels find the lamp");
}

#[test]
fn without_lights_nothing_is_chosen() {
    let Some(gpu) = gpu() else { return };
    let mut lit = LightScene::new(gpu);
    let on = [flag("ENVIRONMENT")];
    let choice = |lit: &LightScene, defs: &[Def]| {
        let c = select(lit, 1, 64, defs)[3];
        (c[0], f32::from_bits(c[1]))
    };
    assert_eq!(choice(&lit, &[]), (NONE, 0.0));
    assert_eq!(choice(&lit, &on), (ENVIRONMENT_LIGHT, 1.0));
    // A scene without extent still has its environment; if a power exceeds f32, both sides keep a share.
    lit.scene.radius = 0.0;
    assert_eq!(choice(&lit, &on), (ENVIRONMENT_LIGHT, 1.0));
    lit.view.environment_color = [0.0; 3];
    assert_eq!(choice(&lit, &on), (NONE, 0.0));
    lit.view.environment_color = [1.0; 3];
    lit.lights = vec![GpuLight::default()];
    lit.set_powers(&[1.0]);
    for (power, radius) in
        [(1.0, 0.0), (f32::INFINITY, 1.0), (1.0, 1e30), (f32::MAX, 1e30), (1e-30, 1.0), (1e30, 1e-20)]
    {
        lit.scene.light_power = power;
        lit.scene.radius = radius;
        let found: Vec<_> = select(&lit, 1, 1 << 12, &on).iter().map(|c| (c[0], f32::from_bits(c[1]))).collect();
        assert!(found.iter().all(|f| f.1 >= 0.19 && f.1 <= 0.81), "{power}, {radius}: {:?}", found[0]);
        assert!(found.iter().any(|f| f.0 == 0) && found.iter().any(|f| f.0 == ENVIRONMENT_LIGHT));
    }
}

#[test]
fn a_textured_lamp_is_chosen_by_its_textured_power() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    // Two lamps of one square meter; the texture of one is half black.
    let board = rig.add::<Image>(texture(8, 8, |x, y| if (x + y) % 2 == 0 { [255; 4] } else { [0, 0, 0, 255] }));
    for (x, emissive_texture) in [(-2.0, None), (2.0, Some(board))] {
        let lamp = StandardMaterial { emissive_texture, ..lamp(1.0, 1.0, 1.0) };
        rig.spawn(square(1.0), lamp, Transform::from_xyz(x, 6.0, 4.0).looking_to(Vec3::Z, Vec3::Y));
    }
    let direct = Direct {
        reuse: Reuse { temporal: false, spatial_samples: 0, ..Reuse::SPATIOTEMPORAL },
        candidates: 1,
        bsdf_candidate: false,
        ..default()
    };
    rig.set(|r| *r = Restir { technique: Technique::Di, direct, ..plain() });
    let weights = rig.debug(DebugView::ReservoirWeights);
    // A candidate's weight is 1 / pmf of its triangle.  The lamps are chosen with 2/3 and 1/3, each split over two triangles.
    let near = |value: f32| weights.iter().filter(|(_, w)| (w.x / value - 1.0).abs() < 1e-3).count();
    let (plain, textured) = (near(3.0), near(6.0));
    let lit = weights.iter().filter(|(_, w)| w.x > 0.0).count();
    println!("{plain} for the plain lamp, {textured} for the textured one, of {lit}");
    assert!(plain > 400 && textured > 80 && plain + textured == lit, "{plain}, {textured} of {lit}");
}

#[test]
fn alias_tables_hold_their_powers() {
    assert!(alias_table(&[]).is_none());
    assert!(alias_table(&[0.0, -1.0, f64::NAN, f64::INFINITY]).is_none());
    let hard: Vec<f64> = (0..100_000u32).map(|i| if i % 3 == 0 { 0.0 } else { f64::from(i).powi(9) }).collect();
    for powers in [vec![1.0], vec![0.0, 1e308, 1e308, 1e-308], vec![0.1; 10], hard, vec![f64::MAX; 1000]] {
        let table = alias_table(&powers).expect("some power is usable");
        let max = powers.iter().copied().fold(0.0, f64::max);
        let sum: f64 = powers.iter().map(|p| p / max).sum();
        for (p, entry) in powers.iter().zip(&table) {
            let pmf = p / max / sum;
            assert!(
                (f64::from(entry.pmf) - pmf).abs() <= 1e-5 * pmf + 1e-7 / powers.len() as f64,
                "{entry:?} for {pmf}"
            );
            assert!(entry.pmf > 0.0 || *p < max * 1e-6, "{entry:?} for {p}");
            assert!(*p > 0.0 || (entry.pmf == 0.0 && entry.probability == 0.0), "{entry:?} for a black light");
            assert!((entry.alias as usize) < powers.len() && (0.0..=1.0).contains(&entry.probability));
        }
    }
}
