//! Energy compensation (Turquin 2019; Lanz 2025, 2.1.3) restores the energy that single scattering loses, and adds none beyond it.

use crate::support::{
    app::*,
    compose::flag,
    gpu::gpu,
    materials::{self, Query, Sampler, at_angle, brushed, evaluate, every_lobe, metal, random_material, varnished},
    oracle::{
        bsdf::Material,
        directional_albedo::{directional_albedo, entry},
        quadrature::PolarCells,
    },
    stats::Random,
};
use bevy::prelude::*;
use bevy_restir::testing::material::directional_albedo::{SIZE, TABLE};
use glam::DVec3;

/// The table as it is sent to the GPU.
fn table() -> Vec<f32> {
    bytemuck::pod_collect_to_vec(TABLE)
}

#[test]
fn each_entry_of_the_table_is_its_integral() {
    for (k, stored) in table().iter().enumerate() {
        let exact = entry(k / SIZE, k % SIZE, 96);
        assert!((f64::from(*stored) - exact).abs() < 3e-4, "{k}: {stored} and {exact}");
    }
}

#[test]
fn the_integral_of_the_table_is_that_of_the_lobe() {
    // The table integrates over visible normals; this test integrates the oracle's lobe over directions.
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
                assert!(mean * e < 0.97, "without compensation some light is lost: {}", mean * e);
            }
        }
    }
}

/// Compensation uses one α for both axes: the root of their mean square.
#[test]
fn a_rough_white_brushed_metal_gives_most_light_back() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[flag("ENERGY_COMPENSATION")]);
    for (along, across) in [(1.0, 0.05), (1.0, 0.3), (0.5, 0.1)] {
        for (degrees, azimuth) in [(0.0, 0.0), (50.0, 0.0), (50.0, 90.0), (75.0, 0.0), (75.0, 90.0)] {
            let plain = Material { base: DVec3::ONE, ..brushed(along, across) };
            let (s, c) = f64::to_radians(degrees).sin_cos();
            let (y, x) = f64::to_radians(azimuth).sin_cos();
            let wo = DVec3::new(s * x, s * y, c);
            let e = directional_albedo(((along * along + across * across) / 2.0f64).sqrt(), c, 96);
            let m = Material { compensation: (1.0 - e) / e, ..plain };
            let samples = sampler.run(Query::new(&m, wo, DVec3::Z, 3), 1 << 14);
            let (mean, error) = mean_and_error(samples.iter().map(|s| if s.valid() { s.weight().y } else { 0.0 }));
            println!("α = {along}, {across} at {degrees} {azimuth}: {mean:.3} ± {error:.3}");
            let least = if azimuth > 0.0 && degrees > 60.0 { 0.7 } else { 0.88 };
            assert!(mean > least && mean < 1.12, "α = {along}, {across} at {degrees} {azimuth}: {mean} ± {error}");
        }
    }
}

/// The compensation of a coat restores a little of the energy that its microfacets lose, and never adds energy.
#[test]
fn a_compensated_coat_over_white_gains_nothing() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[flag("ENERGY_COMPENSATION")]);
    for alpha in [0.1, 0.4, 1.0] {
        for degrees in [0.0, 50.0, 80.0] {
            let m = varnished(materials::plain(), 1.0, alpha);
            let wo = at_angle(&m, degrees);
            let e = directional_albedo(alpha, m.coat_n.dot(wo), 96);
            let m = Material { coat_compensation: (1.0 - e) / e, ..m };
            let samples = sampler.run(Query::new(&m, wo, DVec3::Z, 3), 1 << 14);
            let (mean, error) = mean_and_error(samples.iter().map(|s| if s.valid() { s.weight().y } else { 0.0 }));
            assert!(mean < 1.0 + 5.0 * error, "α = {alpha} at {degrees}: {mean} ± {error}");
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
            m.alpha_along = m.alpha.max(m.alpha_along);
            m.coat_alpha = 0.1 + 0.9 * r.unit();
            (m.compensation, m.coat_compensation) = (2.0 * r.unit(), 2.0 * r.unit());
            let wo = r.direction();
            let wo = if m.n.dot(wo) < 0.0 { -wo } else { wo };
            Query::new(&m, wo, r.direction(), 0)
        })
        .collect();
    let answers = evaluate(gpu, &queries, &[every_lobe(), vec![flag("ENERGY_COMPENSATION")]].concat());
    let mut compared = 0;
    for (q, answer) in queries.iter().zip(answers) {
        let (m, wo, wi) = (q.material(), q.wo(), q.wi());
        let cosines = [m.n, m.n_geo, m.coat_n].map(|n| n.dot(wo).abs().min(n.dot(wi).abs()));
        if m.half_length(wo, wi) < 0.1 || cosines.iter().any(|c| *c < 1e-2) {
            continue;
        }
        let exact = m.eval_all(wo, wi);
        let value = DVec3::new(answer[0][0].into(), answer[0][1].into(), answer[0][2].into());
        assert!((value - exact).length() <= 2e-3 * exact.length() + 1e-6, "{q:?}: {value} and {exact}");
        compared += 1;
    }
    assert!(compared > 10_000);
}

/// Shaders read the table entry of the right angle and roughness.
#[test]
fn rough_white_metals_vanish_in_a_white_world_at_every_angle() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.insert(rig.camera, (sky(1.0), orthographic(0.1, 0.1)));
    rig.set(|restir| restir.energy_compensation = true);
    let plane = rig.spawn(square(8.0), lambert(1.0), Transform::default());
    for perceptual_roughness in [0.35, 0.6, 1.0] {
        let metal = StandardMaterial { metallic: 1.0, perceptual_roughness, ..Color::WHITE.into() };
        let handle = rig.add::<StandardMaterial>(metal);
        rig.insert(plane, MeshMaterial3d(handle));
        for degrees in [0.0f32, 45.0, 75.0] {
            rig.insert(plane, Transform::from_rotation(Quat::from_rotation_y(degrees.to_radians())));
            let mean = rig.picture(48).mean();
            println!("roughness {perceptual_roughness} at {degrees}: {mean:.4}");
            assert!((mean - 1.0).abs() < 0.01, "roughness {perceptual_roughness} at {degrees}: {mean}");
        }
    }
    rig.assert_sound();
}
