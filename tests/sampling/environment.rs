//! The environment is sampled by its density, also at the poles, at the seam and for single bright texels.

use crate::support::{
    compose::flag,
    gpu::{Gpu, gpu, wide},
    light_scene::{EnvironmentSample, LightScene},
    oracle::environment::{Map, direction, luminance, solid_angle, uv},
    stats::{Random, Statistical, assert_family, chi_squared, failures_of_family, z_test},
};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;

const SAMPLES: usize = 1 << 16;

fn run(lit: &LightScene, seed: u32, samples: &[EnvironmentSample], mapped: bool) -> Vec<EnvironmentSample> {
    let all = ["ENVIRONMENT", "ENVIRONMENT_MAP"].map(flag);
    lit.sample_environment(seed, samples, if mapped { &all } else { &all[..1] })
}

struct Case<'g> {
    name: String,
    lit: LightScene<'g>,
    map: Map,
    rotation: DMat3,
    width: usize,
    height: usize,
    table: Vec<f64>,
}

/// Maps that are hard to sample, with importance tables that are finer, coarser or squarer than the map.
fn cases(gpu: &Gpu) -> Vec<Case<'_>> {
    let gray = |x: f64| DVec3::new(x, 0.5 * x, 2.0 * x);
    let maps = [
        ("constant", Map::new(8, 4, |_, _| gray(1.0))),
        ("spike", Map::new(32, 16, |x, y| gray(if (x, y) == (31, 5) { 1e5 } else { 1e-2 }))),
        ("lone spike at the seam", Map::new(32, 16, |x, y| gray(if (x, y) == (0, 9) { 10.0 } else { 0.0 }))),
        ("gradient", Map::new(24, 10, |x, y| gray(x as f64 + 3.0 * y as f64))),
        ("black half", Map::new(16, 8, |x, _| gray(f64::from(u8::from(x < 8))))),
        ("north pole", Map::new(16, 8, |_, y| gray(f64::from(u8::from(y == 0))))),
        ("south pole", Map::new(16, 8, |x, y| gray(if y == 7 { x as f64 } else { 0.0 }))),
        ("one texel", Map::new(1, 1, |_, _| gray(3.0))),
    ];
    let mut cases = Vec::new();
    for (i, (name, map)) in maps.into_iter().enumerate() {
        for (width, height) in [(16, 8), (64, 32), (16, 16), (8, 2)] {
            let rotation =
                if i % 2 == 0 { DMat3::IDENTITY } else { DMat3::from_rotation_y(1.0) * DMat3::from_rotation_x(0.7) };
            let mut lit = LightScene::new(gpu);
            lit.rotate(rotation);
            lit.view.environment_color = [2.0, 1.0, 0.5];
            lit.set_map(&map, width as u32, height as u32);
            let table = (0..width * height).map(|i| map.importance(i % width, i / width, width, height)).collect();
            cases.push(Case {
                name: format!("{name}, {width}x{height}"),
                lit,
                map: map.clone(),
                rotation,
                width,
                height,
                table,
            });
        }
    }
    cases
}

#[test]
fn the_table_holds_the_bilinear_map() {
    let Some(gpu) = gpu() else { return };
    for mut case in cases(gpu) {
        let total: f64 = case.table.iter().sum();
        let level = case.lit.set_map(&case.map, case.width as u32, case.height as u32);
        for (gpu, oracle) in level.iter().zip(&case.table) {
            assert!(
                (f64::from(*gpu) - oracle).abs() <= 2e-3 * oracle + 1e-6 * total,
                "{}: {gpu}, not {oracle}",
                case.name
            );
        }
    }
}

#[test]
fn radiance_is_bilinear_and_never_unreachable() {
    let Some(gpu) = gpu() else { return };
    let mut r = Random(9);
    for case in cases(gpu) {
        let asked: Vec<_> = (0..4000)
            .map(|i| {
                // The poles and the seam are included.
                let d = match i % 4 {
                    0 => direction(r.unit(), 1e-4 * r.unit()),
                    1 => direction(r.unit(), 1.0 - 1e-4 * r.unit()),
                    2 => direction(1e-4 * (r.unit() - 0.5), r.unit()),
                    _ => r.direction(),
                };
                EnvironmentSample {
                    direction: (case.rotation.transpose() * d).as_vec3().to_array(),
                    pdf: 1.0,
                    ..Default::default()
                }
            })
            .collect();
        let scale = case.map.texels.iter().map(|t| t.max_element()).fold(0.0, f64::max);
        for s in run(&case.lit, 0, &asked, true) {
            let d = case.rotation * wide(s.direction).normalize();
            let expected = case.map.radiance(d) * DVec3::new(2.0, 1.0, 0.5);
            // Near a pole, the rounding of a direction is a large distance in u.
            let tolerance = 2e-4 + 1e-6 / (d.x.hypot(d.z) + 1e-6);
            let near = (wide(s.radiance) - expected).abs().max_element() < tolerance * scale;
            assert!(near, "{}: {s:?}, not {expected}", case.name);
            assert!(s.pdf_again > 0.0 || s.radiance[1] < 1e-4 * scale as f32, "{}: {s:?} is never sampled", case.name);
            assert!(s.pdf_again.is_finite());
        }
    }
}

/// p-values of sampled directions against the table.  Each cell is cut into quarters of equal solid angle.
fn direction_tests<'a>(cases: &'a [Case], wrong: f64) -> Vec<Statistical<'a>> {
    cases
        .iter()
        .map(|case| {
            let test = move |seed: u32| {
                let total: f64 = case.table.iter().sum();
                let mut counts = vec![0.0; case.table.len() * 4];
                for s in run(&case.lit, seed, &vec![EnvironmentSample::default(); SAMPLES], true) {
                    let (u, v) = uv(case.rotation * wide(s.direction).normalize());
                    let x = ((u * case.width as f64) as usize).min(case.width - 1);
                    let y = ((v * case.height as f64) as usize).min(case.height - 1);
                    let cos = |v: f64| (v * PI / case.height as f64).cos();
                    let middle = (cos(y as f64) + cos((y + 1) as f64)) / 2.0;
                    let quarter =
                        usize::from(u * case.width as f64 - x as f64 > 0.5) + 2 * usize::from((v * PI).cos() < middle);
                    counts[(y * case.width + x) * 4 + quarter] += 1.0;
                    // A sample may fall on the edge of its cell; elsewhere the densities agree.
                    let exact = case.table[y * case.width + x] / total / solid_angle(y, case.width, case.height);
                    let edge =
                        [u * case.width as f64, v * case.height as f64].iter().any(|t| (t - t.round()).abs() < 1e-3);
                    let agree = |pdf: f32| (f64::from(pdf) - exact).abs() <= 5e-3 * exact + 1e-5;
                    assert!(
                        s.pdf > 0.0 && (edge || (agree(s.pdf) && agree(s.pdf_again))),
                        "{}: {s:?}, not {exact}",
                        case.name
                    );
                }
                let mut expected: Vec<f64> =
                    case.table.iter().flat_map(|t| [t / total * SAMPLES as f64 / 4.0; 4]).collect();
                expected[0] *= wrong;
                chi_squared(&counts, &expected)
            };
            (case.name.clone(), Box::new(test) as Box<dyn Fn(u32) -> f64>)
        })
        .collect()
}

#[test]
fn directions_follow_the_table() {
    let Some(gpu) = gpu() else { return };
    assert_family(direction_tests(&cases(gpu), 1.0));
}

#[test]
fn one_wrong_cell_is_found() {
    let Some(gpu) = gpu() else { return };
    let cases: Vec<_> = cases(gpu).into_iter().filter(|c| c.name == "north pole, 8x2").collect();
    assert_eq!(failures_of_family(direction_tests(&cases, 1.5)).len(), 1);
}

#[test]
fn samples_average_to_the_irradiance_of_the_sphere() {
    let Some(gpu) = gpu() else { return };
    let cases = cases(gpu);
    assert_family(cases.iter().map(|case| {
        let color = DVec3::new(2.0, 1.0, 0.5);
        // ∫ L dω over a fine grid in (u, cosθ).
        const N: usize = 1000;
        let mut exact = 0.0;
        for j in 0..N {
            for i in 0..N / 2 {
                let at = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
                exact += luminance(case.map.at(at(i, N / 2), (1.0 - 2.0 * at(j, N)).acos() / PI) * color);
            }
        }
        exact *= 4.0 * PI / (N * N / 2) as f64;
        let test = move |seed: u32| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for s in run(&case.lit, seed + 20, &vec![EnvironmentSample::default(); SAMPLES], true) {
                let e = luminance(wide(s.radiance)) / f64::from(s.pdf);
                sum += e;
                squares += e * e;
            }
            // The grid has an error of 2e-4.
            let n = SAMPLES as f64;
            z_test(sum, squares + (2e-4 * exact * n).powi(2), n, exact)
        };
        (case.name.clone(), Box::new(test) as Box<dyn Fn(u32) -> f64>)
    }));
}

#[test]
fn without_a_map_the_sphere_is_uniform() {
    let Some(gpu) = gpu() else { return };
    let lit = LightScene::new(gpu);
    let lit = &lit;
    let test = move |seed: u32| {
        let mut counts = vec![0.0; 200];
        for s in run(lit, seed, &vec![EnvironmentSample::default(); SAMPLES], false) {
            let d = wide(s.direction);
            let (u, _) = uv(d);
            counts[((u * 20.0) as usize).min(19) * 10 + (((d.y + 1.0) * 5.0) as usize).min(9)] += 1.0;
            assert!((f64::from(s.pdf) * 4.0 * PI - 1.0).abs() < 1e-6 && s.pdf == s.pdf_again && s.radiance == [1.0; 3]);
        }
        chi_squared(&counts, &[SAMPLES as f64 / 200.0; 200])
    };
    assert_family([("uniform".to_string(), Box::new(test) as Box<dyn Fn(u32) -> f64>)]);
}

#[test]
fn a_black_map_is_no_light() {
    let Some(gpu) = gpu() else { return };
    let mut lit = LightScene::new(gpu);
    lit.set_map(&Map::new(4, 2, |_, _| DVec3::ZERO), 4, 2);
    for s in run(&lit, 1, &[EnvironmentSample::default(); 64], true) {
        assert!(
            s.pdf == 0.0 && s.pdf_again == 0.0 && s.radiance == [0.0; 3] && s.direction.iter().all(|x| x.is_finite())
        );
    }
}
