//! Energy compensation (Turquin 2019; paper 002, 2.1.3) gives back what single scattering loses, and no more.

use super::support::{
    compose::flag,
    gpu::gpu,
    materials::{Query, Sampler, at_angle, evaluate, metal, random_material},
    oracle::{bsdf::Material, quadrature::PolarCells},
    stats::{Random, mean_and_error},
};
use bevy_restir::scene::albedo::{SIZE, directional_albedo, table};
use glam::DVec3;

#[test]
fn the_table_is_the_integral_of_the_lobe() {
    // By another way than visible normals: the oracle's lobe over directions.
    for alpha in [0.05, 0.3, 1.0] {
        for degrees in [0.0, 45.0, 75.0] {
            let m = Material { base: DVec3::ONE, ..metal(alpha) };
            let wo = at_angle(&m, degrees);
            let mirror = 2.0 * m.n.dot(wo) * m.n - wo;
            let cells = PolarCells::about(mirror, 1e-3, 9, 10);
            let lobe: f64 = cells.integrate(|wi| m.eval_all(wo, wi).y, 1e-6).iter().sum();
            let albedo = directional_albedo(alpha, degrees.to_radians().cos(), 256);
            assert!((lobe - albedo).abs() < 2e-3, "α = {alpha} at {degrees}: {lobe} and {albedo}");
        }
    }
}

#[test]
fn a_coarse_table_is_close_between_its_entries() {
    let table = table();
    let last = (SIZE - 1) as f64;
    let lookup = |roughness: f64, cos: f64| {
        let (x, y) = (cos * last, roughness * last);
        let (i, j) = ((x as usize).min(SIZE - 2), (y as usize).min(SIZE - 2));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let at = |i: usize, j: usize| f64::from(table[j * SIZE + i]);
        (at(i, j) * (1.0 - fx) + at(i + 1, j) * fx) * (1.0 - fy)
            + (at(i, j + 1) * (1.0 - fx) + at(i + 1, j + 1) * fx) * fy
    };
    for k in 0..20 {
        for l in 0..20 {
            let (roughness, cos) = (0.1 + 0.9 * (f64::from(k) + 0.3) / 20.0, 0.04 + 0.96 * (f64::from(l) + 0.7) / 20.0);
            let exact = directional_albedo(roughness * roughness, cos, 96);
            let error = (lookup(roughness, cos) - exact).abs();
            assert!(error < 0.01, "roughness {roughness}, cos {cos}: {error}");
        }
    }
}

#[test]
fn a_rough_white_metal_gives_all_light_back() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[flag("ENERGY_COMPENSATION")]);
    for alpha in [0.01, 0.1, 0.4, 1.0] {
        for degrees in [0.0, 50.0, 80.0] {
            let plain = Material { base: DVec3::ONE, ..metal(alpha) };
            let wo = at_angle(&plain, degrees);
            let e = directional_albedo(alpha, plain.n.dot(wo), 96);
            let m = Material { compensation: (1.0 - e) / e, ..plain };
            let samples = sampler.run(Query::new(&m, wo, DVec3::Z, 3), 1 << 14);
            let (mean, error) = mean_and_error(samples.iter().map(|s| if s.valid() { s.weight().y } else { 0.0 }));
            assert!((mean - 1.0).abs() < 5.0 * error + 1e-3, "α = {alpha} at {degrees}: {mean} ± {error}");
            if alpha >= 0.4 {
                assert!(mean * e < 0.97, "without it some light is lost: {}", mean * e);
            }
        }
    }
}

#[test]
fn compensated_values_equal_the_oracle() {
    let Some(gpu) = gpu() else { return };
    let mut r = Random(9);
    let queries: Vec<Query> = (0..20_000)
        .map(|_| {
            let mut m = random_material(&mut r);
            m.alpha = 0.1 + 0.9 * r.unit();
            m.compensation = 2.0 * r.unit();
            let wo = r.direction();
            let wo = if m.n.dot(wo) < 0.0 { -wo } else { wo };
            Query::new(&m, wo, r.direction(), 0)
        })
        .collect();
    let answers = evaluate(gpu, &queries, &[flag("TRANSMISSION"), flag("ENERGY_COMPENSATION")]);
    let mut compared = 0;
    for (q, answer) in queries.iter().zip(answers) {
        let (m, wo, wi) = (q.material(), q.wo(), q.wi());
        let h = if m.n.dot(wi) > 0.0 { wo + wi } else { wo + m.eta * wi };
        let cosines = [m.n.dot(wo), m.n.dot(wi), m.n_geo.dot(wo), m.n_geo.dot(wi)];
        if h.length() < 0.1 || cosines.iter().any(|c| c.abs() < 1e-2) {
            continue;
        }
        let exact = m.eval_all(wo, wi);
        let value = DVec3::new(answer[0][0].into(), answer[0][1].into(), answer[0][2].into());
        assert!((value - exact).length() <= 2e-3 * exact.length() + 1e-6, "{q:?}: {value} and {exact}");
        compared += 1;
    }
    assert!(compared > 10_000);
}
