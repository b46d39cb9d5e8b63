//! Exact bias of resampling: pixels with a few points each, all candidates, selections and passes enumerated in f64.  The sum over the
//! outcomes equals the integral to 1e-12 for every kind of MIS weights that is documented as unbiased, and differs from it with the
//! documented sign for the others.

use super::resampling::{Case, weights};
use crate::support::{
    gpu::gpu,
    oracle::{
        enumeration::{Domain, Outcomes, Rays, Reservoir, Weigh, candidates, reuse},
        mis::weight,
    },
    stats::Random,
};
use bevy_restir::testing::gpu_layout::*;
use std::{cell::RefCell, collections::HashMap};

const UNBIASED: [(&str, u32); 5] = [
    ("1/|Z|", MIS_ONE_OVER_Z),
    ("balance", MIS_BALANCE),
    ("pairwise", MIS_PAIRWISE),
    ("defensive pairwise", MIS_DEFENSIVE_PAIRWISE),
    ("defensive pairwise, GRIS", MIS_DEFENSIVE_PAIRWISE_GRIS),
];

const POINTS: usize = 4;

/// Two pixels that differ in everything: each point is invisible, black or out of reach of the shift for some of them, and targets differ
/// by orders of magnitude.
fn two_pixels(random: &mut Random) -> [Domain; 2] {
    std::array::from_fn(|pixel| {
        let mut of = |low: f64| -> Vec<f64> { (0..POINTS).map(|_| low + random.unit()).collect() };
        let (measure, mut source) = (of(0.1), of(0.1));
        let sum: f64 = source.iter().sum();
        source.iter_mut().for_each(|p| *p /= sum);
        let mut light: Vec<f64> = (0..POINTS).map(|_| 10f64.powf(4.0 * random.unit() - 3.0)).collect();
        let mut target: Vec<f64> = light.iter().map(|l| l * (0.5 + random.unit())).collect();
        for x in 0..POINTS {
            if random.unit() < 0.25 {
                (light[x], target[x]) = (0.0, 0.0);
            }
        }
        let mut often = |share: f64| -> Vec<bool> { (0..POINTS).map(|_| random.unit() < share).collect() };
        let (visible, shiftable) = (often(0.7), often(if pixel == 0 { 1.0 } else { 0.8 }));
        Domain { measure, source, light, target, visible, shiftable }
    })
}

fn with_confidence(outcomes: Outcomes<Reservoir>, confidence: f64) -> Outcomes<Reservoir> {
    outcomes.into_iter().map(|(p, r)| (p, Reservoir { confidence, ..r })).collect()
}

/// The bias of one iteration of reuse in the first pixel, where all inputs are shaded and where the selected one is.
fn bias_of_one_pass(d: &[Domain; 2], c: [f64; 2], rays: Rays, weigh: Weigh, order: &[usize]) -> [f64; 2] {
    let inputs = [0, 1].map(|i| with_confidence(candidates(&d[i], 2, rays), c[i]));
    let mut expected = [0.0; 2];
    for &(p, own) in &inputs[0] {
        for &(q, other) in &inputs[1] {
            let result = reuse(&[&d[0], &d[1]], &[own, other], rays, weigh, order);
            expected[0] += p * q * result.all_shaded;
            expected[1] += p * q * result.selected_shaded;
        }
    }
    relative(expected, d[0].integral())
}

/// The bias of a second iteration, in which each pixel resamples the samples that both pixels selected in the first one.
fn bias_of_two_passes(d: &[Domain; 2], c: [f64; 2], rays: Rays, weigh: Weigh) -> [f64; 2] {
    // The two pixels with exchanged roles; shifts fail at the same points as before.
    let mut back = [d[1].clone(), d[0].clone()];
    back[1].shiftable.clone_from(&d[1].shiftable);
    let inputs = [0, 1].map(|i| with_confidence(candidates(&d[i], 1, rays), c[i]));
    let mut expected = [0.0; 2];
    for &(p, own) in &inputs[0] {
        for &(q, other) in &inputs[1] {
            let here = reuse(&[&d[0], &d[1]], &[own, other], rays, weigh, &[0, 1]);
            let there = reuse(&[&back[0], &back[1]], &[other, own], rays, weigh, &[0, 1]);
            for &(s, own) in &here.reservoirs {
                for &(t, other) in &there.reservoirs {
                    let result = reuse(&[&d[0], &d[1]], &[own, other], rays, weigh, &[1, 0]);
                    expected[0] += p * q * s * t * result.all_shaded;
                    expected[1] += p * q * s * t * result.selected_shaded;
                }
            }
        }
    }
    relative(expected, d[0].integral())
}

fn relative(expected: [f64; 2], integral: f64) -> [f64; 2] {
    expected.map(|e| e / integral - 1.0)
}

/// Scenes with light in the first pixel, and confidences.
fn cases() -> Vec<([Domain; 2], [f64; 2])> {
    let mut random = Random(77);
    let mut all = Vec::new();
    while all.len() < 24 {
        let pixels = two_pixels(&mut random);
        let history = random.pick(&[0.0, 0.5, 1.0, 20.0]);
        if pixels[0].integral() > 0.0 {
            all.push((pixels, [1.0, history]));
        }
    }
    all
}

/// The largest bias over all scenes: one pass with both orders of the stream, and two passes.
fn worst_bias(rays: Rays, weigh: Weigh) -> f64 {
    let mut worst = 0.0f64;
    for (d, c) in cases() {
        for order in [[0, 1], [1, 0]] {
            worst = bias_of_one_pass(&d, c, rays, weigh, &order).iter().fold(worst, |w, b| w.max(b.abs()));
        }
        worst = bias_of_two_passes(&d, c, rays, weigh).iter().fold(worst, |w, b| w.max(b.abs()));
    }
    worst
}

#[test]
fn every_unbiased_kind_of_weights_sums_to_the_integral_over_all_outcomes() {
    for (name, kind) in UNBIASED {
        let weigh = move |c: &[f64], p: &[f64], j: usize| weight(kind, c, p, j);
        for (what, rays) in [("rays in targets", Rays::ALL), ("rays of shading", Rays::SHADING)] {
            let bias = worst_bias(rays, &weigh);
            eprintln!("{name}, {what}: bias at most {bias:e}");
            assert!(bias < 1e-12, "{name}, {what}: {bias:e}");
        }
    }
}

/// The same enumeration with the weights that the shader computes.
#[test]
fn the_weights_of_the_shader_sum_to_the_integral_over_all_outcomes() {
    let Some(gpu) = gpu() else { return };
    type Key = (u32, [u32; 2], [u32; 2], usize);
    for (name, kind) in UNBIASED {
        let key = |c: &[f64], p: &[f64], j: usize| -> Key {
            let bits = |v: &[f64]| [v[0], v[1]].map(|x| (x as f32).to_bits());
            (kind, bits(c), bits(p), j)
        };
        // The first enumeration collects the questions, and the shader answers all of them at once.
        let asked = RefCell::new(HashMap::<Key, f64>::new());
        worst_bias(Rays::ALL, &|c, p, j| {
            asked.borrow_mut().insert(key(c, p, j), f64::NAN);
            weight(kind, c, p, j)
        });
        let keys: Vec<Key> = asked.borrow().keys().copied().collect();
        let cases: Vec<Case> = keys
            .iter()
            .map(|&(kind, c, p, j)| {
                let mut case = Case { kind, count: 2, confidence: [0.0; 7], targets: [[0.0; 7]; 7] };
                for i in 0..2 {
                    case.confidence[i] = f32::from_bits(c[i]);
                    case.targets[i][j] = f32::from_bits(p[i]);
                }
                case
            })
            .collect();
        for (key, answer) in keys.iter().zip(weights(gpu, &cases)) {
            asked.borrow_mut().insert(*key, f64::from(answer.all[key.3]));
        }
        let bias = worst_bias(Rays::ALL, &|c, p, j| asked.borrow()[&key(c, p, j)]);
        eprintln!("{name}: {} weights of the shader, bias at most {bias:e}", keys.len());
        assert!(bias < 1e-5, "{name}: {bias:e}");
    }
}

/// The mean bias over the scenes, of one pass.
fn mean_bias(rays: Rays, weigh: Weigh) -> f64 {
    let all = cases();
    all.iter().map(|(d, c)| bias_of_one_pass(d, *c, rays, weigh, &[0, 1])[0]).sum::<f64>() / all.len() as f64
}

#[test]
fn every_biased_mode_has_its_documented_sign_exactly() {
    let of = |kind: u32| move |c: &[f64], p: &[f64], j: usize| weight(kind, c, p, j);
    let without_mis_rays = Rays { mis: false, ..Rays::ALL };
    let darker: [(&str, Rays, u32); 4] = [
        ("no correction", Rays::ALL, MIS_UNIFORM),
        ("1/|Z| that ignores visibility", without_mis_rays, MIS_ONE_OVER_Z),
        ("balance that ignores visibility", without_mis_rays, MIS_BALANCE),
        ("pairwise weights that ignore visibility", without_mis_rays, MIS_DEFENSIVE_PAIRWISE),
    ];
    for (name, rays, kind) in darker {
        let weigh = of(kind);
        let biases = cases().into_iter().map(|(d, c)| bias_of_one_pass(&d, c, rays, &weigh, &[0, 1])[0]);
        let greatest = biases.fold(f64::MIN, f64::max);
        let mean = mean_bias(rays, &weigh);
        eprintln!("{name}: {:+.2} % on average", 100.0 * mean);
        assert!(greatest < 1e-12 && mean < -0.01, "{name}: {mean}, at most {greatest}");
    }
    let discard = Rays { discard: true, ..Rays::ALL };
    let mean = mean_bias(discard, &of(MIS_BALANCE));
    eprintln!("dropped with their confidence: {:+.2} % on average", 100.0 * mean);
    assert!(mean > 0.001, "{mean}");
}

#[test]
fn wrong_weights_are_found_by_enumeration() {
    // A pair of a neighbor and the canonical domain, each a balance heuristic of two.
    let pair = |c: &[f64], p: &[f64], j: usize, swapped: bool| {
        let (own, other) = if swapped { (p[1 - j], p[j]) } else { (p[j], p[1 - j]) };
        let (a, b) = (c[j] * own, c[1 - j] * other);
        if a + b > 0.0 { a / (a + b) } else { f64::from(u8::from(j == 0)) }
    };
    assert!(worst_bias(Rays::ALL, &|c, p, j| pair(c, p, j, false)) < 1e-12);
    let wrong: [(&str, Weigh); 6] = [
        ("swapped targets", &|c, p, j| pair(c, p, j, true)),
        ("confidence of the own sample only", &|c, p, j| pair(&[c[0], if j == 0 { 1.0 } else { c[1] }], p, j, false)),
        ("Z counts all", &|c, p, j| weight(MIS_UNIFORM, c, p, j)),
        ("Z leaves out the sample's own domain", &|c, p, j| {
            let others: f64 = (0..2).filter(|&i| i != j && p[i] > 0.0).map(|i| c[i]).sum();
            if others > 0.0 { c[j] / others } else { 1.0 }
        }),
        ("Z without confidence in the numerator", &|c, p, j| weight(MIS_ONE_OVER_Z, c, p, j) / c[j].max(1e-9)),
        ("weights 1 % too large", &|c, p, j| 1.01 * weight(MIS_BALANCE, c, p, j)),
    ];
    for (name, weigh) in wrong {
        let bias = worst_bias(Rays::ALL, weigh);
        eprintln!("{name}: bias up to {:.1} %", 100.0 * bias);
        assert!(bias > 5e-3, "{name} is not found: {bias}");
    }
}

/// Three inputs: the candidate of a pixel, its sample of the last frame, in which the light moved, and the sample of a neighbor.
#[test]
fn temporal_and_spatial_inputs_together_sum_to_the_integral() {
    let mut random = Random(5);
    for _ in 0..12 {
        let ([now, neighbor], [before, _]) = (two_pixels(&mut random), two_pixels(&mut random));
        let domains = [now, before, neighbor];
        if domains[0].integral() <= 0.0 {
            continue;
        }
        let inputs: Vec<_> =
            (0..3).map(|i| with_confidence(candidates(&domains[i], 1, Rays::ALL), [1.0, 8.0, 20.0][i])).collect();
        let all: Vec<&Domain> = domains.iter().collect();
        for (name, kind) in UNBIASED {
            let weigh = move |c: &[f64], p: &[f64], j: usize| weight(kind, c, p, j);
            let mut expected = [0.0; 2];
            for &(p, a) in &inputs[0] {
                for &(q, b) in &inputs[1] {
                    for &(r, c) in &inputs[2] {
                        let result = reuse(&all, &[a, b, c], Rays::ALL, &weigh, &[0, 1, 2]);
                        expected[0] += p * q * r * result.all_shaded;
                        expected[1] += p * q * r * result.selected_shaded;
                    }
                }
            }
            let bias = relative(expected, domains[0].integral());
            assert!(bias.iter().all(|b| b.abs() < 1e-12), "{name}: {bias:?}");
        }
    }
}

/// Where a neighbor rarely finds the light that a pixel reflects most, 1/|Z| is unbiased and still dark in almost every frame: no run of
/// affordable length can show its mean.  That is why the matrix of `di/matrix.rs` leaves out the scenes with narrow lobes.
#[test]
fn one_over_z_is_unbiased_and_dark_in_almost_every_frame_between_narrow_lobes() {
    let lobe = |light: [f64; 2]| Domain {
        measure: vec![1.0; 2],
        source: vec![0.5; 2],
        light: light.to_vec(),
        target: light.to_vec(),
        visible: vec![true; 2],
        shiftable: vec![true; 2],
    };
    // Each pixel reflects one of two lights ten thousand times as strongly as the other.
    let pixels = [lobe([1.0, 1e-4]), lobe([1e-4, 1.0])];
    let inputs = pixels.each_ref().map(|d| candidates(d, 4, Rays::ALL));
    let integral = pixels[0].integral();
    let dark_share = |kind: u32| {
        let (mut mean, mut dark) = (0.0, 0.0);
        for &(p, own) in &inputs[0] {
            for &(q, other) in &with_confidence(inputs[1].clone(), 20.0) {
                let weigh = |c: &[f64], p: &[f64], j: usize| weight(kind, c, p, j);
                let light = reuse(&[&pixels[0], &pixels[1]], &[own, other], Rays::ALL, &weigh, &[0, 1]).all_shaded;
                mean += p * q * light;
                dark += if light < 0.2 * integral { p * q } else { 0.0 };
            }
        }
        assert!((mean / integral - 1.0).abs() < 1e-12, "{mean}");
        dark
    };
    let [z, balance] = [MIS_ONE_OVER_Z, MIS_BALANCE].map(dark_share);
    eprintln!(
        "frames with less than a fifth of the light: {:.2} % by 1/|Z|, {:.2} % by balance",
        100.0 * z,
        100.0 * balance
    );
    assert!(z > 0.9 && balance < 0.1, "{z} {balance}");
}
