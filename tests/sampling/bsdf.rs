//! The BSDF equals the f64 oracle, and its samples follow its densities.

use crate::support::{
    compose::flag,
    gpu::gpu,
    materials::{
        Query, Sampler, at_angle, brushed, coated, entry, evaluate, every_lobe, everything, fleshy, glass, leaf, metal,
        mixture, pane, plain, random_material, varnished,
    },
    oracle::{
        bsdf::{LOBES, Lobe, Material},
        quadrature::PolarCells,
    },
    stats::{Random, Statistical, assert_family, chi_squared, failures_of_family, mean_and_error, z_test},
};
use glam::DVec3;

/// Number of samples of one chi-squared test.
const SAMPLES: usize = 1 << 16;

fn close(gpu: f64, oracle: f64, relative: f64, absolute: f64) -> bool {
    (gpu - oracle).abs() <= relative * oracle.abs() + absolute
}

/// Random queries: uniform, mirrored, refracted and grazing directions.
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
            // Some see the triangle from the front and its normal from behind.
            let up = if r.unit() < 0.8 { m.n } else { m.n_geo };
            wo = if up.dot(wo) < 0.0 { -wo } else { wo };
            let scatter = r.direction() * m.alpha * r.pick(&[0.0, 0.3, 1.0]);
            let wi = match (r.unit() * 5.0) as u32 {
                0 => r.direction(),
                1 => {
                    let w = r.direction();
                    graze(&mut r, w)
                }
                2 => (2.0 * m.n.dot(wo) * m.n - wo + scatter).normalize(),
                3 => (2.0 * m.coat_n.dot(wo) * m.coat_n - wo + r.direction() * m.coat_alpha).normalize(),
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
    for (q, answer) in queries.iter().zip(evaluate(gpu, &queries, &every_lobe())) {
        assert!(answer.iter().flatten().all(|x| x.is_finite() && *x >= 0.0), "{q:?} gave {answer:?}");
        let (m, wo, wi) = (q.material(), q.wo(), q.wi());
        // On either side of a threshold, f32 may take the other branch.
        if [m.n, m.n_geo, m.coat_n].iter().any(|n| n.dot(wo).abs() < 1e-6 || n.dot(wi).abs() < 1e-6) {
            continue;
        }
        // f32 cannot represent an h that is the difference of almost equal vectors.
        let narrowest = if m.coat > 0.0 { m.alpha.min(m.coat_alpha) } else { m.alpha };
        let length = m.half_length(wo, wi);
        let relative = 2e-4 + (3e-6 + 2e-7 / narrowest + 2e-7 / length) / length;
        if relative > 0.02 {
            continue;
        }
        // f32 directions have an error of about 1e-7; its effect on the value does not count as an error of the formula.
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

/// The configurations for sampling tests: (name, material, wo, axis and finest angle of the cells).
fn cases() -> Vec<(String, Material, DVec3, DVec3, f64)> {
    let mut cases = Vec::new();
    let mut add = |name: &str, m: Material, degrees: f64, lobe: Lobe| {
        let wo = at_angle(&m, degrees);
        let axis = m.delta_direction(wo, lobe).unwrap_or(m.n);
        // Refraction narrows the lobe where the indices are similar.
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
        add("brushed 0.5 along 0.05", brushed(0.5, 0.05), degrees, Lobe::Reflection);
        add("brushed 1 along 0.01", brushed(1.0, 0.01), degrees, Lobe::Reflection);
        add("brushed glass", Material { alpha_along: 0.6, ..glass(0.1, 1.5) }, degrees, Lobe::Transmission);
        add("pane 0.05", pane(0.05), degrees, Lobe::Transmission);
        add("pane 0.4", pane(0.4), degrees, Lobe::Transmission);
        add("pane delta", pane(1e-4), degrees, Lobe::Transmission);
        add("leaf 0.4", leaf(0.4), degrees, Lobe::Reflection);
        add("leaf 1", leaf(1.0), degrees, Lobe::Reflection);
        add("fleshy leaf", fleshy(0.4), degrees, Lobe::Reflection);
        add("entry", entry(), degrees, Lobe::Diffuse);
        add("varnish 0.1 on lambert", varnished(plain(), 1.0, 0.1), degrees, Lobe::Coat);
        add("varnish 1 on metal", varnished(metal(0.3), 0.5, 1.0), degrees, Lobe::Reflection);
        add("varnish delta on a coat", varnished(coated(0.3), 1.0, 1e-4), degrees, Lobe::Reflection);
        add("varnish 0.05 on a mirror", varnished(metal(1e-4), 1.0, 0.05), degrees, Lobe::Coat);
        add("varnish on black", Material { base: DVec3::ZERO, ..varnished(plain(), 0.7, 0.2) }, degrees, Lobe::Coat);
    }
    for degrees in [20.0, 75.0] {
        add("mixture from outside", mixture(0.2, 1.5), degrees, Lobe::Reflection);
        add("mixture from inside", mixture(0.2, 1.0 / 1.5), degrees, Lobe::Transmission);
        add("mixture unbent", mixture(0.3, 1.0), degrees, Lobe::Reflection);
        add("everything", everything(0.2, 1.5, false), degrees, Lobe::Coat);
        add("everything, thin", everything(0.2, 1.5, true), degrees, Lobe::Transmission);
    }
    // At a silhouette: the triangle faces the viewer, and its normal does not.
    let leaning = |m: Material| Material { n_geo: at_angle(&m, 40.0), ..m };
    for degrees in [91.0, 100.0] {
        add("leaning lambert", leaning(plain()), degrees, Lobe::Diffuse);
        add("leaning coat 0.3", leaning(coated(0.3)), degrees, Lobe::Diffuse);
        add("leaning metal 1", leaning(metal(1.0)), degrees, Lobe::Diffuse);
        add("leaning brushed", leaning(brushed(1.0, 0.4)), degrees, Lobe::Diffuse);
        add("leaning leaf", leaning(leaf(1.0)), degrees, Lobe::Diffuse);
        add("leaning varnish", leaning(varnished(plain(), 0.7, 0.5)), degrees, Lobe::Diffuse);
    }
    add("near the critical angle", glass(0.1, 1.0 / 1.5), 41.8, Lobe::Reflection);
    add("metal all but grazing", metal(0.1), 89.99, Lobe::Reflection);
    cases
}

/// The p-value of samples against the density integrated over cells; invalid and delta samples have cells of their own.
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
fn a_biased_sampler_is_found() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[flag("PLANTED")]);
    let tests =
        || cases().into_iter().filter(|c| c.0.contains("at 50") && !c.0.contains("delta") && !c.0.contains("mirror"));
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

/// The mean of the weights equals the integral of f, which the oracle computes.
#[test]
fn samples_average_to_the_albedo() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let albedo_test = |(name, m, wo, axis, finest): (String, Material, DVec3, DVec3, f64)| {
        let query = Query::new(&m, wo, DVec3::Z, 0);
        let (m, wo) = (query.material(), query.wo());
        let cells = PolarCells::about(axis, finest, 9, 10);
        let albedo: f64 = cells.integrate(|wi| m.eval_all(wo, wi).y, 1e-6).iter().sum();
        let sampler = &sampler;
        let test = move |seed: u32| {
            let (mut sum, mut squares) = (0.0, 0.0);
            let samples = sampler.run(Query::new(&m, wo, DVec3::Z, seed + 10), SAMPLES);
            for s in samples.iter().filter(|s| s.valid() && !s.delta()) {
                sum += s.weight().y;
                squares += s.weight().y.powi(2);
            }
            // The quadrature has an error of 1e-4.
            z_test(sum, squares + 1e-8 * SAMPLES as f64 * SAMPLES as f64 * albedo * albedo, SAMPLES as f64, albedo)
        };
        (name, Box::new(test) as Box<dyn Fn(u32) -> f64>)
    };
    assert_family(cases().into_iter().map(albedo_test));
}

#[test]
fn delta_lobes_have_the_weights_of_reflection_and_refraction() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let mut materials = vec![metal(1e-4), coated(5e-4), plain()];
    materials[2].alpha = 1e-4;
    materials.extend([1.0, 1.5, 2.4, 1.0 / 1.5].map(|eta| glass(1e-4, eta)));
    materials.extend([1.0, 1.5, 1.0 / 1.5].map(|eta| mixture(1e-4, eta)));
    materials.extend([pane(1e-4), Material { transmission: 0.5, ..pane(1e-4) }]);
    materials.extend([plain(), metal(1e-4), glass(1e-4, 1.5), pane(1e-4)].map(|m| varnished(m, 0.7, 1e-4)));
    materials.push(varnished(metal(0.3), 1.0, 5e-4));
    for (m, degrees) in materials.iter().flat_map(|m| [0.0, 30.0, 60.0, 89.0].map(|d| (m, d))) {
        let query = Query::new(m, at_angle(m, degrees), DVec3::Z, 5);
        let (m, wo) = (query.material(), query.wo());
        let c = m.n.dot(wo);
        let samples = sampler.run(query, 1 << 14);
        for lobe in [Lobe::Reflection, Lobe::Transmission, Lobe::Coat].into_iter().filter(|l| m.is_delta(*l)) {
            let (p, whole) = match lobe {
                Lobe::Coat => (m.p_coat(wo), DVec3::splat(m.coat_reflected(wo))),
                Lobe::Reflection => (m.p_reflect(c), m.reflected(c)),
                _ => (1.0 - m.p_reflect(c), m.refracted(c) / m.eta.powi(2)),
            };
            let (p, whole) = match lobe {
                Lobe::Coat => (p, whole),
                _ => ((1.0 - m.p_coat(wo)) * m.p_microfacet(c) * p, whole * (1.0 - m.coat_share(wo))),
            };
            let Some(direction) = m.delta_direction(wo, lobe) else {
                assert!(p == 0.0, "total internal reflection");
                continue;
            };
            let n = if lobe == Lobe::Coat { m.coat_n } else { m.n };
            let side = n.dot(direction) * m.n_geo.dot(direction) > 0.0 && m.n_geo.dot(wo) > 0.0 && n.dot(wo) > 0.0;
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

/// A furnace: under unit radiance from everywhere, scaled by the squared index, the reflected radiance is at most 1.
#[test]
fn no_material_reflects_more_than_it_receives() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let mirror = Material { base: DVec3::ONE, ..metal(1e-4) };
    let mut tried = vec![(mirror, Some(1.0)), (glass(1e-4, 1.5), Some(1.0)), (glass(1e-4, 1.0 / 1.5), Some(1.0))];
    tried.extend([(glass(1e-4, 1.0), Some(1.0)), (plain(), Some(1.0))]);
    tried.push((Material { base: DVec3::ZERO, ..mirror }, Some(0.0)));
    let white_pane = |alpha: f64| Material { base: DVec3::ONE, ..pane(alpha) };
    tried.extend([(white_pane(1e-4), Some(1.0)), (Material { transmission: 0.3, f0_d: DVec3::ZERO, ..plain() }, None)]);
    tried.extend([0.3, 1.0].map(|share| (Material { diffuse_transmission: share, ..plain() }, Some(1.0))));
    tried.push((varnished(plain(), 1.0, 1e-4), None));
    tried.push((Material { coat_n: DVec3::Z, ..varnished(plain(), 1.0, 1e-4) }, Some(1.0)));
    for alpha in [2e-3, 0.05, 0.3, 1.0] {
        tried.push((Material { base: DVec3::ONE, ..metal(alpha) }, None));
        tried.extend([0.5, 1.0 / 1.5, 1.0, 1.01, 1.5, 2.4].map(|eta| (glass(alpha, eta), None)));
        tried.push((white_pane(alpha), None));
        tried.push((Material { base: DVec3::ONE, ..brushed(alpha.max(0.6), alpha) }, None));
        tried.extend([0.5, 1.0].map(|coat| (varnished(plain(), coat, alpha), None)));
        tried.push((varnished(Material { base: DVec3::ONE, ..metal(alpha) }, 1.0, 0.1), None));
    }
    for (m, degrees) in tried.iter().flat_map(|m| [0.0, 45.0, 80.0, 89.9].map(|d| (m, d))) {
        let (m, exact) = m;
        let query = Query::new(m, at_angle(m, degrees), DVec3::Z, 6);
        let samples = sampler.run(query, 1 << 13);
        let gain = |s: &crate::support::materials::Sample| {
            if s.valid() { s.weight().y * f64::from(s.eta).powi(2) } else { 0.0 }
        };
        let (mean, error) = mean_and_error(samples.iter().map(gain));
        match exact {
            Some(exact) => assert!((mean - exact).abs() <= 5.0 * error + 1e-5, "{m:?} at {degrees}: {mean} ± {error}"),
            None => assert!(mean <= 1.0 + 5.0 * error + 1e-5, "{m:?} at {degrees}: {mean} ± {error}"),
        }
    }
}

/// f(wo, wi) = f(wi, wo) for each lobe; for refraction, f divided by the squared index on wo's side is symmetric.  The coat is excluded:
/// its share depends on wo alone.  So are the interface that light crosses into a body, which belongs to a path below the surface, and normals
/// that are bent towards wo.
#[test]
fn the_bsdf_is_reciprocal() {
    let Some(gpu) = gpu() else { return };
    let bare = |q: Query| {
        let material = Material { coat: 0.0, entry_f0: DVec3::ZERO, ..q.material() };
        Query::new(&material, q.wo(), q.wi(), 0)
    };
    let forth: Vec<_> = random_queries(50_000).into_iter().map(bare).collect();
    let turned = |q: &Query| {
        let (mut m, wo, wi) = (q.material(), q.wo(), q.wi());
        if m.n.dot(wi) < 0.0 {
            m = Material { n: -m.n, n_geo: -m.n_geo, eta: 1.0 / m.eta, ..m };
        }
        Query::new(&m, wi, wo, 0)
    };
    let back: Vec<_> = forth.iter().map(turned).collect();
    let mut compared = [0; 3];
    for (q, (f, b)) in
        forth.iter().zip(evaluate(gpu, &forth, &every_lobe()).iter().zip(evaluate(gpu, &back, &every_lobe())))
    {
        let (m, wo, wi) = (q.material(), q.wo(), q.wi());
        // Where h is short, or n.h is small, f32 is not precise enough.
        let through = m.n.dot(wi) < 0.0;
        let h = match through {
            true if m.thin => wo + wi - 2.0 * m.n.dot(wi) * m.n,
            true => wo + m.eta * wi,
            false => wo + wi,
        };
        let cosines = [m.n.dot(wo), m.n.dot(wi), h.normalize().dot(wo)];
        if m.n.dot(wo) < 0.0 || cosines.iter().any(|c| c.abs() < 0.05) || m.half_length(wo, wi) < 0.05 || m.alpha < 0.01
        {
            continue;
        }
        for (lobe, compared) in compared.iter_mut().enumerate() {
            let scale = if through && lobe == Lobe::Transmission as usize { m.eta * m.eta } else { 1.0 };
            for channel in 0..3 {
                let there = f64::from(f[lobe + 1][channel]) / m.n.dot(wi).abs() * scale;
                let home = f64::from(b[lobe + 1][channel]) / m.n.dot(wo).abs();
                assert!(close(there, home, 3e-3, 1e-5), "{there} and {home} of {q:?}");
                *compared += u32::from(there > 0.0);
            }
        }
    }
    assert!(compared.iter().all(|c| *c > 2_500), "{compared:?}");
}

/// A material without a lobe has the same value in shaders that are specialized for that lobe and in shaders that are not.
#[test]
fn lobes_that_a_material_lacks_change_nothing() {
    let Some(gpu) = gpu() else { return };
    let plain = |m: Material| Material {
        transmission: 0.0,
        thin: false,
        diffuse_transmission: 0.0,
        coat: 0.0,
        alpha_along: m.alpha,
        subsurface: DVec3::ZERO,
        entry_f0: DVec3::ZERO,
        ..m
    };
    let queries: Vec<_> =
        random_queries(20_000).iter().map(|q| Query::new(&plain(q.material()), q.wo(), q.wi(), 0)).collect();
    let with = evaluate(gpu, &queries, &every_lobe());
    let without = evaluate(gpu, &queries, &[]);
    for ((q, a), b) in queries.iter().zip(with).zip(without) {
        // Rounding differs because the frame around n differs.
        let slack = 2e-3 + 2e-6 / q.material().alpha / (q.wo() + q.wi()).length();
        let same = |a: f32, b: f32| close(a.into(), b.into(), slack, 1e-6);
        assert!(slack > 0.02 || a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| same(*a, *b)), "{q:?}");
    }
}

/// A known property of this formula and of glTF's: the coat's Fresnel factor at h leaves the diffuse lobe bright at grazing angles, where
/// the coat itself is a mirror.  The bound is the largest gain for a white base.
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

/// Strength stretches the highlight along the tangent and keeps its width across (`KHR_materials_anisotropy`).  Measured by the second
/// moments of sampled directions about the mirror direction.
#[test]
fn anisotropy_stretches_the_highlight_along_the_tangent() {
    let Some(gpu) = gpu() else { return };
    let sampler = Sampler::new(gpu, &[]);
    let spread = |m: Material| {
        let samples = sampler.run(Query::new(&m, DVec3::Z, DVec3::Z, 7), 1 << 13);
        let squares = |axis: DVec3| {
            mean_and_error(samples.iter().filter(|s| s.valid()).map(|s| s.wi().dot(axis).powi(2))).0.sqrt()
        };
        (squares(m.tangent), squares(m.n.cross(m.tangent)))
    };
    let round = spread(metal(0.05));
    assert!((round.0 / round.1 - 1.0).abs() < 0.1, "{round:?}");
    for tangent in [DVec3::X, DVec3::Y, DVec3::new(0.6, -0.8, 0.0)] {
        let (along, across) = spread(Material { tangent, ..brushed(0.5, 0.05) });
        assert!(along > 3.0 * across && across > 0.5 * round.1 && across < 1.5 * round.1, "{along} and {across}");
    }
}

/// A thin wall transmits the mirrored lobe to the other side: the same f except for the Fresnel factor and the base color.
#[test]
fn a_thin_wall_transmits_through_the_mirrored_direction() {
    let Some(gpu) = gpu() else { return };
    let mut r = Random(4);
    let m = Material { f0_d: DVec3::splat(0.3), base: DVec3::ONE, alpha_along: 0.8, ..pane(0.2) };
    let upper = |r: &mut Random| {
        let w = r.direction();
        DVec3::new(w.x, w.y, w.z.abs())
    };
    let pairs: Vec<_> = (0..2000).map(|_| (upper(&mut r), upper(&mut r))).collect();
    let all = |side: f64| {
        let queries: Vec<_> =
            pairs.iter().map(|(o, i)| Query::new(&m, *o, DVec3::new(i.x, i.y, side * i.z), 0)).collect();
        evaluate(gpu, &queries, &every_lobe())
    };
    for ((wo, wi), (above, below)) in pairs.iter().zip(all(1.0).iter().zip(all(-1.0))) {
        let f = 0.3 + 0.7 * (1.0 - wo.dot((*wo + *wi).normalize())).powi(5);
        let (reflected, through) = (f64::from(above[2][0]), f64::from(below[3][0]));
        assert!(close(through * f, reflected * (1.0 - f), 2e-3, 1e-6), "{reflected} and {through} at F = {f}");
    }
}
