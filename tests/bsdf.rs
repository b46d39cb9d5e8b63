//! The BSDF is design 2's, and its samples follow its densities.

use super::support::{
    compose::flag,
    gpu::gpu,
    materials::{Query, Sampler, at_angle, coated, evaluate, glass, metal, mixture, plain, random_material},
    oracle::{
        bsdf::{LOBES, Lobe, Material},
        quadrature::PolarCells,
    },
    stats::{Random, Statistical, assert_family, chi_squared, failures_of_family, mean_and_error, z_test},
};
use glam::DVec3;

/// Samples of one chi-squared test.
const SAMPLES: usize = 1 << 16;

fn close(gpu: f64, oracle: f64, relative: f64, absolute: f64) -> bool {
    (gpu - oracle).abs() <= relative * oracle.abs() + absolute
}

/// Random queries: any directions, mirrored ones, refracted ones, grazing ones.
fn random_queries(count: usize) -> Vec<Query> {
    let mut r = Random(1);
    (0..count)
        .map(|_| {
            let m = random_material(&mut r);
            let graze = |r: &mut Random, w: DVec3| {
                let height = r.pick(&[1e-6, 1e-4, 1e-2]);
                let tangent = w - m.n.dot(w) * m.n;
                (tangent.normalize() + height * m.n).normalize()
            };
            let mut wo = r.direction();
            wo = if r.unit() < 0.2 { graze(&mut r, wo) } else { wo };
            wo = if m.n.dot(wo) < 0.0 { -wo } else { wo };
            let scatter = r.direction() * m.alpha * r.pick(&[0.0, 0.3, 1.0]);
            let wi = match (r.unit() * 4.0) as u32 {
                0 => r.direction(),
                1 => {
                    let w = r.direction();
                    graze(&mut r, w)
                }
                2 => (2.0 * m.n.dot(wo) * m.n - wo + scatter).normalize(),
                _ => m.delta_direction(wo, Lobe::Transmission).map_or(-wo, |w| (w + scatter).normalize()),
            };
            Query::new(&m, wo, wi, 0)
        })
        .collect()
}

#[test]
fn eval_and_pdf_equal_the_oracle() {
    let Some(gpu) = gpu() else { return };
    let queries = random_queries(100_000);
    let mut bad = Vec::new();
    let mut compared = 0;
    for (q, answer) in queries.iter().zip(evaluate(gpu, &queries, &[flag("TRANSMISSION")])) {
        assert!(answer.iter().flatten().all(|x| x.is_finite() && *x >= 0.0), "{q:?} gave {answer:?}");
        let (m, wo, wi) = (q.material(), q.wo(), q.wi());
        // On a threshold, f32 may fall on either side.
        if [m.n.dot(wo), m.n_geo.dot(wo), m.n.dot(wi), m.n_geo.dot(wi)].iter().any(|c| c.abs() < 1e-6) {
            continue;
        }
        // Nor does f32 know an h that is the difference of almost equal vectors.
        let h = if m.n.dot(wi) > 0.0 { wo + wi } else { wo + m.eta * wi };
        let relative = 2e-4 + (3e-6 + 2e-7 / m.alpha) / h.length();
        if relative > 0.02 {
            continue;
        }
        // f32 directions are good to about 1e-7: what that does to the value is no error of the formula.
        let wiggle = |f: &dyn Fn(DVec3, DVec3) -> f64| {
            let exact = f(wo, wi);
            let (t, b) = wi.any_orthonormal_pair();
            let (s, c) = wo.any_orthonormal_pair();
            let zero = DVec3::ZERO;
            let spread = [(t, s), (b, c), (-t, -s), (-b, -c), (m.n, zero), (-m.n, zero), (zero, m.n), (zero, -m.n)]
                .iter()
                .map(|(d, e)| (f((wo + 3e-7 * e).normalize(), (wi + 3e-7 * d).normalize()) - exact).abs())
                .fold(0.0, f64::max);
            (exact, 5.0 * spread)
        };
        for (k, lobe) in LOBES.iter().enumerate() {
            for (channel, &value) in answer[k + 1][..3].iter().enumerate() {
                let (f, slack) = wiggle(&|o, i| m.eval(o, i, *lobe)[channel]);
                if !close(value.into(), f, relative, 1e-6 + slack) {
                    bad.push(format!("f of {lobe:?}: {} for {f} in {q:?}", value));
                }
            }
            let (pdf, slack) = wiggle(&|o, i| m.pdf(o, i, *lobe));
            if !close(answer[k + 1][3].into(), pdf, relative, 1e-6 + slack) {
                bad.push(format!("pdf of {lobe:?}: {} for {pdf} in {q:?}", answer[k + 1][3]));
            }
            compared += 1;
        }
        let sum: f64 = answer[1..].iter().map(|a| f64::from(a[3])).sum();
        assert!(close(answer[0][3].into(), sum, 1e-5, 0.0), "the marginal is the sum of the lobes");
    }
    assert!(compared > 200_000);
    assert!(bad.is_empty(), "{} of {compared}:\n{}", bad.len(), bad[..bad.len().min(5)].join("\n"));
}

/// What the samplers are tried on: (name, material, wo, axis and finest angle of the cells).
fn cases() -> Vec<(String, Material, DVec3, DVec3, f64)> {
    let mut cases = Vec::new();
    let mut add = |name: &str, m: Material, degrees: f64, lobe: Lobe| {
        let wo = at_angle(&m, degrees);
        let axis = m.delta_direction(wo, lobe).unwrap_or(m.n);
        // Refraction narrows the lobe where the indices are close.
        let bend = if lobe == Lobe::Transmission { (2.0 * (m.eta - 1.0).abs()).min(1.0) } else { 1.0 };
        cases.push((format!("{name} at {degrees}"), m, wo, axis, (0.5 * m.alpha * bend).clamp(1e-3, 0.3)));
    };
    for degrees in [0.0, 50.0, 89.0] {
        add("lambert", plain(), degrees, Lobe::Diffuse);
        add("coat 0.3", coated(0.3), degrees, Lobe::Reflection);
        add("coat delta", coated(1e-4), degrees, Lobe::Reflection);
        add("metal 0.01", metal(0.01), degrees, Lobe::Reflection);
        add("metal 0.3", metal(0.3), degrees, Lobe::Reflection);
        add("metal 1", metal(1.0), degrees, Lobe::Reflection);
        add("glass 0.05 from outside", glass(0.05, 1.5), degrees, Lobe::Transmission);
        add("glass 0.4 from outside", glass(0.4, 1.5), degrees, Lobe::Transmission);
        add("glass 0.4 from inside", glass(0.4, 1.0 / 1.5), degrees, Lobe::Reflection);
        add("glass 0.2 almost unbent", glass(0.2, 1.01), degrees, Lobe::Transmission);
    }
    for degrees in [20.0, 75.0] {
        add("mixture from outside", mixture(0.2, 1.5), degrees, Lobe::Reflection);
        add("mixture from inside", mixture(0.2, 1.0 / 1.5), degrees, Lobe::Transmission);
        add("mixture unbent", mixture(0.3, 1.0), degrees, Lobe::Reflection);
    }
    add("near the critical angle", glass(0.1, 1.0 / 1.5), 41.8, Lobe::Reflection);
    add("metal all but grazing", metal(0.1), 89.99, Lobe::Reflection);
    cases
}

/// p-value of samples against the density, integrated over cells; what is lost or delta is a cell too.
fn sampling_test<'a>(
    sampler: &'a Sampler<'a>,
    (name, m, wo, axis, finest): (String, Material, DVec3, DVec3, f64),
) -> Statistical<'a> {
    let query = Query::new(&m, wo, DVec3::Z, 0);
    let (m, wo) = (query.material(), query.wo());
    let cells = PolarCells::about(axis, finest, 9, 10);
    let mut expected = cells.integrate(|wi| m.pdf_all(wo, wi), 1e-6);
    let total: f64 = expected.iter().sum();
    assert!(total <= 1.0 + 1e-4, "{name}: the density integrates to {total}");
    expected.push((1.0 - total).max(0.0));
    for e in &mut expected {
        *e *= SAMPLES as f64;
    }
    let test = move |seed: u32| {
        let query = Query::new(&m, wo, DVec3::Z, seed);
        let mut counts = vec![0.0; expected.len()];
        for s in sampler.run(query, SAMPLES) {
            let cell = if s.valid() && !s.delta() { cells.cell_of(s.wi()) } else { cells.count() };
            counts[cell] += 1.0;
        }
        chi_squared(&counts, &expected)
    };
    (name, Box::new(test))
}

#[test]
fn samples_follow_the_density() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    assert_family(cases().into_iter().map(|case| sampling_test(&sampler, case)));
}

#[test]
fn a_bent_sampler_is_found() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[flag("PLANTED")]);
    let tests = || cases().into_iter().filter(|c| c.0.contains("at 50") && !c.0.contains("delta"));
    let found = failures_of_family(tests().map(|case| sampling_test(&sampler, case)));
    assert_eq!(found.len(), tests().count(), "found only {found:?}");
}

#[test]
fn weights_are_value_over_density() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    for (name, m, wo, ..) in cases() {
        let query = Query::new(&m, wo, DVec3::Z, 3);
        for s in sampler.run(query, 1 << 12).iter().filter(|s| s.valid() && !s.delta()) {
            for channel in 0..3 {
                let (weight, ratio) = (s.weight()[channel], s.ratio()[channel]);
                assert!(close(weight, ratio, 1e-5, 1e-9), "{name}: {s:?}");
            }
            assert!(s.weight().is_finite() && s.pdf > 0.0, "{name}: {s:?}");
        }
    }
}

/// Mean of weight·eta² over samples is the albedo, which the oracle integrates.
#[test]
fn samples_average_to_the_albedo() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let albedo_test = |(name, m, wo, axis, finest): (String, Material, DVec3, DVec3, f64)| {
        let query = Query::new(&m, wo, DVec3::Z, 0);
        let (m, wo) = (query.material(), query.wo());
        let cells = PolarCells::about(axis, finest, 9, 10);
        let scale = |wi: DVec3| if m.n.dot(wi) < 0.0 { m.eta * m.eta } else { 1.0 };
        let albedo: f64 = cells.integrate(|wi| m.eval_all(wo, wi).y * scale(wi), 1e-6).iter().sum();
        let sampler = &sampler;
        let test = move |seed: u32| {
            let (mut sum, mut squares) = (0.0, 0.0);
            let samples = sampler.run(Query::new(&m, wo, DVec3::Z, seed + 10), SAMPLES);
            for s in samples.iter().filter(|s| s.valid() && !s.delta()) {
                let w = s.weight().y * f64::from(s.eta).powi(2);
                sum += w;
                squares += w * w;
            }
            // 1e-4 of the quadrature.
            z_test(sum, squares + 1e-8 * SAMPLES as f64 * SAMPLES as f64 * albedo * albedo, SAMPLES as f64, albedo)
        };
        (name, Box::new(test) as Box<dyn Fn(u32) -> f64>)
    };
    assert_family(cases().into_iter().map(albedo_test));
}

#[test]
fn deltas_weigh_what_they_reflect_and_refract() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let mut materials = vec![metal(1e-4), coated(5e-4), plain()];
    materials[2].alpha = 1e-4;
    materials.extend([1.0, 1.5, 2.4, 1.0 / 1.5].map(|eta| glass(1e-4, eta)));
    materials.extend([1.0, 1.5, 1.0 / 1.5].map(|eta| mixture(1e-4, eta)));
    for (m, degrees) in materials.iter().flat_map(|m| [0.0, 30.0, 60.0, 89.0].map(|d| (m, d))) {
        let query = Query::new(m, at_angle(m, degrees), DVec3::Z, 5);
        let (m, wo) = (query.material(), query.wo());
        let c = m.n.dot(wo);
        let samples = sampler.run(query, 1 << 14);
        for lobe in [Lobe::Reflection, Lobe::Transmission] {
            let share = if lobe == Lobe::Reflection { m.p_reflect(c) } else { 1.0 - m.p_reflect(c) };
            let p = m.p_microfacet(c) * share;
            let Some(direction) = m.delta_direction(wo, lobe) else {
                assert!(p == 0.0, "total reflection");
                continue;
            };
            let whole = if lobe == Lobe::Reflection { m.reflected(c) } else { m.refracted(c) / m.eta.powi(2) };
            let side = m.n.dot(direction) * m.n_geo.dot(direction) > 0.0 && m.n_geo.dot(wo) > 0.0;
            let of_lobe: Vec<_> = samples.iter().filter(|s| s.valid() && s.lobe() == lobe).collect();
            for s in &of_lobe {
                assert!(s.delta() && s.pdf == 0.0 && (s.wi() - direction).length() < 1e-5, "{m:?}: {s:?}");
                assert!(
                    (s.weight() * p - whole).abs().max_element() < 1e-5,
                    "{m:?} at {degrees}: {s:?}, not {whole} / {p}"
                );
            }
            let expected = if side && whole.max_element() > 0.0 { p } else { 0.0 };
            let n = samples.len() as f64;
            let error = 5.0 * (expected * (1.0 - expected) * n).sqrt() + 1e-3;
            assert!(
                (of_lobe.len() as f64 - expected * n).abs() <= error,
                "{m:?} at {degrees}: {lobe:?} {}",
                of_lobe.len()
            );
        }
    }
}

/// A furnace: unit radiance from everywhere, scaled by the square of the index, comes back as at most 1.
#[test]
fn nothing_reflects_more_than_it_gets() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let mirror = Material { base: DVec3::ONE, ..metal(1e-4) };
    let mut tried = vec![(mirror, Some(1.0)), (glass(1e-4, 1.5), Some(1.0)), (glass(1e-4, 1.0 / 1.5), Some(1.0))];
    tried.extend([(glass(1e-4, 1.0), Some(1.0)), (plain(), Some(1.0))]);
    tried.push((Material { base: DVec3::ZERO, ..mirror }, Some(0.0)));
    for alpha in [2e-3, 0.05, 0.3, 1.0] {
        tried.push((Material { base: DVec3::ONE, ..metal(alpha) }, None));
        tried.extend([0.5, 1.0 / 1.5, 1.0, 1.01, 1.5, 2.4].map(|eta| (glass(alpha, eta), None)));
    }
    for (m, degrees) in tried.iter().flat_map(|m| [0.0, 45.0, 80.0, 89.9].map(|d| (m, d))) {
        let (m, exact) = m;
        let query = Query::new(m, at_angle(m, degrees), DVec3::Z, 6);
        let samples = sampler.run(query, 1 << 13);
        let gain = |s: &super::support::materials::Sample| {
            if s.valid() { s.weight().y * f64::from(s.eta).powi(2) } else { 0.0 }
        };
        let (mean, error) = mean_and_error(samples.iter().map(gain));
        match exact {
            Some(exact) => assert!((mean - exact).abs() <= 5.0 * error + 1e-5, "{m:?} at {degrees}: {mean} ± {error}"),
            None => assert!(mean <= 1.0 + 5.0 * error + 1e-5, "{m:?} at {degrees}: {mean} ± {error}"),
        }
    }
}

/// f(wo, wi) = f(wi, wo) for reflection; for refraction f / (index on wo's side)² is symmetric.
#[test]
fn light_may_travel_either_way() {
    let Some(gpu) = gpu() else { return };
    let forth = random_queries(50_000);
    let turned = |q: &Query| {
        let (mut m, wo, wi) = (q.material(), q.wo(), q.wi());
        if m.n.dot(wi) < 0.0 {
            m = Material { n: -m.n, n_geo: -m.n_geo, eta: 1.0 / m.eta, ..m };
        }
        Query::new(&m, wi, wo, 0)
    };
    let back: Vec<_> = forth.iter().map(turned).collect();
    let defs = [flag("TRANSMISSION")];
    let mut compared = 0;
    for (q, (f, b)) in forth.iter().zip(evaluate(gpu, &forth, &defs).iter().zip(evaluate(gpu, &back, &defs))) {
        let (m, wo, wi) = (q.material(), q.wo(), q.wi());
        // Where h is short, f32 does not know it.
        let h = if m.n.dot(wi) > 0.0 { wo + wi } else { wo + m.eta * wi };
        let cosines = [m.n.dot(wo), m.n.dot(wi), h.normalize().dot(wo), h.normalize().dot(wi)];
        if cosines.iter().any(|c| c.abs() < 0.05) || h.length() < 0.05 || m.alpha < 0.01 {
            continue;
        }
        let scale = if m.n.dot(wi) > 0.0 { 1.0 } else { m.eta * m.eta };
        for channel in 0..3 {
            let there = f64::from(f[0][channel]) / m.n.dot(wi).abs() * scale;
            let home = f64::from(b[0][channel]) / m.n.dot(wo).abs();
            assert!(close(there, home, 3e-3, 1e-5), "{there} and {home} of {q:?}");
            compared += u32::from(there > 0.0);
        }
    }
    assert!(compared > 10_000, "{compared}");
}

#[test]
fn without_the_feature_nothing_is_transmitted() {
    let Some(gpu) = gpu() else { return };
    let queries: Vec<_> = random_queries(20_000).into_iter().filter(|q| q.material().transmission == 0.0).collect();
    let with = evaluate(gpu, &queries, &[flag("TRANSMISSION")]);
    let without = evaluate(gpu, &queries, &[]);
    for ((q, a), b) in queries.iter().zip(with).zip(without) {
        assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() <= 1e-6 * a.abs()), "{q:?}");
    }
}

/// Known of design 2's formula, as of glTF's: the coat's Fresnel factor at h leaves the diffuse lobe bright at grazing angles where
/// the coat itself is a mirror.  The bound is what that costs at most for a white base.
#[test]
fn a_white_coated_surface_gains_at_grazing_angles() {
    let m = Material { base: DVec3::ONE, ..coated(0.1) };
    let albedo = |degrees: f64| {
        let wo = at_angle(&m, degrees);
        let cells = PolarCells::about(m.delta_direction(wo, Lobe::Reflection).unwrap_or(m.n), 0.05, 9, 10);
        cells.integrate(|wi| m.eval_all(wo, wi).y, 1e-6).iter().sum::<f64>()
    };
    let found = [0.0, 45.0, 60.0, 75.0, 85.0, 89.0].map(albedo);
    println!("albedo of a white coat: {found:?}");
    assert!(found[0] < 1.001 && found.iter().all(|a| *a < 1.9) && found[4] > 1.1, "{found:?}");
}
