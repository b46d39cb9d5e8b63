//! Parts of resampling: MIS weights, reservoir streams, packed reservoirs, and light samples in eight bytes.

use crate::support::{
    compose::{Def, flag},
    gpu::{Bound, Gpu, gpu},
    light_scene::{IDENTITY, LightScene},
    oracle::{environment::Map, mis::weight},
    stats::{Random, assert_family, chi_squared, mean_and_error, z_test},
};
use bevy_restir::testing::gpu_layout::*;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Case {
    pub kind: u32,
    pub count: u32,
    pub confidence: [f32; 7],
    pub targets: [[f32; 7]; 7],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Weights {
    pub all: [f32; 7],
    asked: [f32; 7],
}

pub(super) fn weights(gpu: &Gpu, cases: &[Case]) -> Vec<Weights> {
    let (input, output) = (gpu.storage(cases), gpu.zeroed::<Weights>(cases.len()));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    gpu.kernel("mis", include_str!("../support/kernels/mis.wgsl"), &[flag("MANY_NEIGHBORS")])
        .run([(cases.len() as u32).div_ceil(64), 1, 1], &bound);
    gpu.read(&output)
}

/// Values of target functions: ordinary, failed, all equal, tiny, huge.
fn target(random: &mut Random, range: u32) -> f32 {
    let u = random.unit();
    match range {
        0 => u as f32 + 1e-3,
        1 => [0.0, 0.0, 0.3, 2.0][(random.unit() * 4.0) as usize],
        2 => 10f64.powf(60.0 * u - 30.0) as f32,
        3 => 10f64.powf(2.0 * u + 36.0) as f32,
        _ => f32::from_bits((u * f64::from(1 << 23)) as u32),
    }
}

/// Random inputs of every MIS kind, number of neighbors and range of targets.  `one_point`: all samples are the same point.
fn random_cases(one_point: bool, ranges: core::ops::Range<u32>) -> Vec<Case> {
    let mut random = Random(1 + u64::from(one_point));
    let mut cases = Vec::new();
    for (kind, count, range) in
        (0..6).flat_map(|kind| (1..=7).flat_map(move |count| (0..5).map(move |range| (kind, count, range))))
    {
        for _ in 0..if ranges.contains(&range) { 100 } else { 0 } {
            let mut case = Case { kind, count, confidence: [0.0; 7], targets: [[0.0; 7]; 7] };
            for i in 0..count as usize {
                // The canonical input holds the candidates of one frame; neighbors have a history or are empty.
                let some = 20.0 * random.unit() as f32;
                let history = random.pick(&[0.0, 1.0, 3.0, 20.0, some]);
                case.confidence[i] = if i == 0 { 1.0 } else { history };
                for j in 0..count as usize {
                    case.targets[i][j] = target(&mut random, range);
                }
            }
            for row in &mut case.targets {
                if one_point {
                    let first = row[0];
                    row.fill(first);
                }
            }
            cases.push(case);
        }
    }
    cases
}

fn oracle(case: &Case, j: usize) -> f64 {
    let n = case.count as usize;
    let c: Vec<f64> = case.confidence[..n].iter().map(|&c| f64::from(c)).collect();
    let p: Vec<f64> = case.targets[..n].iter().map(|row| f64::from(row[j])).collect();
    weight(case.kind, &c, &p, j)
}

#[test]
fn mis_weights_follow_their_formulas() {
    let Some(gpu) = gpu() else { return };
    let cases = random_cases(false, 0..4);
    for (case, w) in cases.iter().zip(weights(gpu, &cases)) {
        for j in 0..case.count as usize {
            let expected = oracle(case, j);
            let difference = (f64::from(w.all[j]) - expected).abs();
            assert!(difference < 2e-6, "input {j}: {} and not {expected} in {case:?}", w.all[j]);
            // No weight uses a target function that its kind does not need.
            assert_eq!(w.all[j].to_bits(), w.asked[j].to_bits(), "input {j} depends on an unneeded target: {case:?}");
        }
    }
}

#[test]
fn mis_weights_sum_to_one_over_the_inputs_that_can_produce_the_sample() {
    let Some(gpu) = gpu() else { return };
    let cases = random_cases(true, 0..5);
    for (case, w) in cases.iter().zip(weights(gpu, &cases)) {
        let n = case.count as usize;
        // If the target of the pixel itself is 0, the weights do not matter; drivers may flush denormals to zero.
        let canonical = case.targets[0][0];
        if canonical == 0.0 || canonical.is_subnormal() {
            assert!(w.all.iter().all(|w| (0.0..=1.0 + 1e-5).contains(w)), "{case:?}: {w:?}");
            continue;
        }
        let could = |j: &usize| case.targets[*j][*j] > 0.0 || case.kind == MIS_UNIFORM;
        let sum: f64 = (0..n).filter(could).map(|j| f64::from(w.all[j])).sum();
        assert!((sum - 1.0).abs() < 1e-5, "{sum} in {case:?}");
        let lost: f32 = (0..n).filter(|j| !could(j)).map(|j| w.all[j]).sum();
        assert_eq!(lost, 0.0, "inputs that cannot produce the sample have weight 0: {case:?}");
    }
}

fn alike(kind: u32, confidence: &[f32]) -> Case {
    let mut case = Case { kind, count: confidence.len() as u32, confidence: [0.0; 7], targets: [[0.7; 7]; 7] };
    case.confidence[..confidence.len()].copy_from_slice(confidence);
    case
}

#[test]
fn mis_weights_of_equal_targets_have_their_closed_forms() {
    let Some(gpu) = gpu() else { return };
    let of = |kind, confidence: &[f32]| f64::from(weights(gpu, &[alike(kind, confidence)])[0].all[0]);
    let long = [1.0, 20.0, 20.0, 20.0];
    // 1/4 (1 + 3·(1/3)/(20 + 1/3)), and 1/61 + 3·20/61·1/61 for the pairwise weights by confidence.
    for (kind, expected) in [
        (MIS_UNIFORM, 1.0 / 61.0),
        (MIS_BALANCE, 1.0 / 61.0),
        (MIS_ONE_OVER_Z, 1.0 / 61.0),
        (MIS_PAIRWISE, 1.0 / 61.0),
        (MIS_DEFENSIVE_PAIRWISE, 1.0 / 61.0 + 60.0 / 61.0 / 61.0),
        (MIS_DEFENSIVE_PAIRWISE_GRIS, 0.25 * (1.0 + 1.0 / (20.0 + 1.0 / 3.0))),
    ] {
        assert!((of(kind, &long) - expected).abs() < 1e-6, "{kind:?}: {}", of(kind, &long));
        assert_eq!(of(kind, &[1.0]), 1.0, "{kind:?}: a single input");
    }
    assert!((of(MIS_DEFENSIVE_PAIRWISE, &long) - 2.0 / 61.0).abs() < 3e-4);
    assert!((of(MIS_DEFENSIVE_PAIRWISE_GRIS, &long) - 0.262).abs() < 3e-4);
}

#[test]
fn pairwise_weights_of_one_neighbor_equal_the_balance_heuristic() {
    let Some(gpu) = gpu() else { return };
    let kinds = [MIS_BALANCE, MIS_PAIRWISE];
    let cases: Vec<Case> = random_cases(false, 0..3).into_iter().filter(|c| c.count == 2).collect();
    // With a canonical target of 0 the two differ, but the pixel is black.
    let cases: Vec<Case> =
        cases.into_iter().filter(|c| c.targets[0][..2].iter().all(|&p| p > 0.0) && c.confidence[1] > 0.0).collect();
    let [balance, pairwise] =
        kinds.map(|kind| weights(gpu, &cases.iter().map(|c| Case { kind, ..*c }).collect::<Vec<_>>()));
    for (a, b) in balance.iter().zip(&pairwise) {
        assert!((0..2).all(|j| (a.all[j] - b.all[j]).abs() < 1e-6), "{a:?} {b:?}");
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Outcome {
    selected: u32,
    sum: f32,
    toy: f32,
    accepted: u32,
}

fn streams(gpu: &Gpu, seed: u32, weights: &[f32], count: usize) -> Vec<Outcome> {
    let words: Vec<f32> = std::iter::once(f32::from_bits(seed)).chain(weights.iter().copied()).collect();
    let (input, output) = (gpu.storage(&words), gpu.zeroed::<Outcome>(count));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    gpu.kernel("stream", include_str!("../support/kernels/stream.wgsl"), &[]).run([count as u32 / 64, 1, 1], &bound);
    gpu.read(&output)
}

#[test]
fn streams_select_by_weight_and_never_an_invalid_sample() {
    let Some(gpu) = gpu() else { return };
    const BAD: [f32; 5] = [0.0, f32::NAN, f32::INFINITY, -1.0, f32::NEG_INFINITY];
    let sets: [Vec<f32>; 4] = [
        vec![1.0; 8],
        vec![0.5, 0.0, f32::NAN, 3.0, f32::INFINITY, -1.0, 1.5, f32::NEG_INFINITY, 0.01],
        vec![1e-30, 2e-30, 1e-30],
        vec![1e30, 1.0, 2e30, f32::NAN],
    ];
    let good = |w: f32| w > 0.0 && w.is_finite();
    assert_family(sets.iter().enumerate().map(|(i, set)| {
        let test = move |seed: u32| {
            const COUNT: usize = 1 << 15;
            let mut counts = vec![0.0; set.len()];
            for o in streams(gpu, seed, set, COUNT) {
                assert!(good(set[o.selected as usize]), "{set:?}: {o:?}");
                // The last accepted sample is the selected one.
                assert_eq!(31 - o.accepted.leading_zeros(), o.selected, "{set:?}: {o:?}");
                counts[o.selected as usize] += 1.0;
            }
            let total: f64 = set.iter().filter(|w| good(**w)).map(|&w| f64::from(w)).sum();
            let expected = |w: f32| if good(w) { COUNT as f64 * f64::from(w) / total } else { 0.0 };
            let cells: Vec<(f64, f64)> =
                set.iter().zip(&counts).filter(|(w, _)| good(**w)).map(|(&w, &c)| (c, expected(w))).collect();
            let (counts, expected): (Vec<f64>, Vec<f64>) = cells.into_iter().unzip();
            chi_squared(&counts, &expected)
        };
        (format!("set {i}"), Box::new(test) as Box<dyn Fn(u32) -> f64>)
    }));
    for o in streams(gpu, 1, &BAD, 64) {
        assert_eq!((o.selected, o.sum, o.accepted), (NONE, 0.0, 0));
    }
}

#[test]
fn the_contribution_weight_of_a_stream_integrates_without_bias() {
    let Some(gpu) = gpu() else { return };
    let test = |seed: u32| {
        let toys: Vec<f64> = streams(gpu, seed, &[1.0], 1 << 18).iter().map(|o| f64::from(o.toy)).collect();
        let squares = toys.iter().map(|t| t * t).sum();
        let p = z_test(toys.iter().sum(), squares, toys.len() as f64, 1.0 / 3.0);
        // A weight that is wrong by three percent is found.
        assert!(z_test(1.03 * toys.iter().sum::<f64>(), 1.03 * 1.03 * squares, toys.len() as f64, 1.0 / 3.0) < 1e-6);
        p
    };
    assert_family([("∫x²".to_string(), Box::new(test) as Box<dyn Fn(u32) -> f64>)]);
}

/// `UNSEEN` of `shaders/restir/di/reservoir.wgsl`.
const UNSEEN: u32 = 1 << 31;

#[test]
fn packed_reservoirs_keep_their_content_and_drop_invalid_numbers() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(5);
    let numbers = [0.0, 1.0, 1e-30, 3e38, f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.1];
    let words: Vec<[u32; 4]> = (0..4096)
        .map(|_| {
            let bits = random.bits();
            let mut number = || random.pick(&numbers).to_bits();
            [bits as u32, (bits >> 32) as u32, number(), number()]
        })
        .collect();
    let (input, output) = (gpu.storage(&words), gpu.zeroed::<[u32; 4]>(words.len()));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    gpu.kernel("reservoir", include_str!("../support/kernels/reservoir.wgsl"), &[]).run([64, 1, 1], &bound);
    for (before, after) in words.iter().zip(gpu.read::<[u32; 4]>(&output)) {
        // The sign of the confidence says whether the sample was visible.
        let is_sound = |w: u32| f32::from_bits(w) >= 0.0 && f32::from_bits(w).is_finite();
        let sound = is_sound(before[2]) && is_sound(before[3] & !UNSEEN);
        assert_eq!(after, if sound { *before } else { [NONE, 0, 0, UNSEEN] }, "{before:x?}");
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Sample {
    wi: [f32; 3],
    distance: f32,
    radiance: [f32; 3],
    pdf: f32,
    position: [f32; 3],
    delta: u32,
    normal: [f32; 3],
    light: u32,
    barycentrics: [f32; 2],
    density: f32,
    rounding: f32,
}

fn points(lit: &LightScene, light: u32, any: bool, defs: &[Def]) -> Vec<[Sample; 2]> {
    many_points(lit, light, any, defs, 1 << 12)
}

/// Samples, and the same samples after packing.
fn many_points(lit: &LightScene, light: u32, any: bool, defs: &[Def], count: usize) -> Vec<[Sample; 2]> {
    let all = ["LIGHT_TRIANGLES", "LIGHT_POINTS", "LIGHT_DIRECTIONAL", "ENVIRONMENT"].map(flag);
    let defs: Vec<_> = all.into_iter().chain(defs.iter().copied()).collect();
    let point = [0.2f32, -0.7, 0.4].map(f32::to_bits);
    let query = lit.gpu.storage(&[point[0], point[1], point[2], light, 7, u32::from(any), 0, 0]);
    let samples = lit.gpu.zeroed::<[Sample; 2]>(count);
    let bound = [(2, 0, Bound::Buffer(&query)), (2, 1, Bound::Buffer(&samples))];
    lit.run("light_point", include_str!("../support/kernels/light_point.wgsl"), &defs, count as u32, &bound);
    lit.gpu.read(&samples)
}

fn lights(gpu: &Gpu) -> LightScene<'_> {
    let mut lit = LightScene::new(gpu);
    lit.set_triangle([[0.0, 1.0, 0.0], [1.0, 1.2, 0.1], [0.2, 0.9, 1.3]]);
    lit.instances = vec![GpuInstance { world_from_object: IDENTITY, triangle_count: 1, ..Default::default() }];
    lit.materials = vec![GpuMaterial { emissive: [1.0, 2.0, 3.0], flags: MATERIAL_DOUBLE_SIDED, ..Default::default() }];
    let light = |kind| GpuLight { position: [1.0, 2.0, 3.0], emission: [10.0; 3], kind, ..Default::default() };
    lit.lights = vec![
        light(LIGHT_TRIANGLE),
        light(LIGHT_POINT),
        GpuLight { direction: [0.0, -1.0, 0.0], data: [1f32.to_bits(), 0.5f32.to_bits()], ..light(LIGHT_SPOT) },
        GpuLight { direction: [0.6, -0.8, 0.0], ..light(LIGHT_DIRECTIONAL) },
    ];
    // The instance and triangle index of the emissive triangle are 0.
    lit.lights[0].data = [0, 0];
    lit.set_powers(&[1.0; 4]);
    lit
}

#[test]
fn packed_light_samples_unpack_to_the_same_sample() {
    let Some(gpu) = gpu() else { return };
    let mut lit = lights(gpu);
    let mut random = Random(3);
    let texels = (0..16 * 8).map(|_| DVec3::splat(random.unit() + 0.05)).collect();
    for light in 0..4 {
        for [a, b] in points(&lit, light, false, &[]) {
            let near = |a: &[f32], b: &[f32], by: f32| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= by);
            assert!(near(&a.position, &b.position, 3e-5) && near(&a.wi, &b.wi, 3e-5), "{light}: {a:?} {b:?}");
            assert!(
                near(&a.radiance, &b.radiance, 1e-6) && (a.pdf - b.pdf).abs() <= 2e-4 * a.pdf,
                "{light}: {a:?} {b:?}"
            );
            assert!(a.normal == b.normal && (a.light, a.delta) == (b.light, b.delta) && b.light == light);
            assert!(near(&a.barycentrics, &b.barycentrics, 1.01 / 65535.0), "{light}: {a:?} {b:?}");
        }
    }
    // The environment: the density and radiance are those of the decoded direction.
    lit.set_map(&Map { width: 16, height: 8, texels }, 16, 8);
    for [a, b] in points(&lit, ENVIRONMENT, false, &[flag("ENVIRONMENT_MAP")]) {
        let angle = DVec3::from(a.wi.map(f64::from)).angle_between(DVec3::from(b.wi.map(f64::from)));
        assert!(angle < 1e-4 && b.pdf == b.density && b.pdf > 0.0 && b.delta == 0, "{a:?} {b:?}");
        assert!((a.radiance[0] - b.radiance[0]).abs() < 1e-3, "{a:?} {b:?}");
    }
}

/// A rounded direction may lie in another cell than the one that it was sampled in.
#[test]
fn packed_samples_of_a_tiny_sun_have_the_mean_of_the_original_samples() {
    let Some(gpu) = gpu() else { return };
    let mut lit = lights(gpu);
    let (width, height) = (1024, 512);
    let mut texels = vec![DVec3::splat(0.01); width * height];
    texels[200 * width + 700] = DVec3::splat(1e5);
    lit.set_map(&Map { width, height, texels }, width as u32, height as u32);
    let samples = many_points(&lit, ENVIRONMENT, false, &[flag("ENVIRONMENT_MAP")], 1 << 18);
    let term = |s: &Sample, density: f32| f64::from(s.radiance[0] / density);
    let original = samples.iter().map(|[a, _]| term(a, a.pdf)).sum::<f64>() / samples.len() as f64;
    let differences = |density: fn(&Sample) -> f32| {
        mean_and_error(samples.iter().map(|[a, b]| (term(b, density(b)) - term(a, a.pdf)) / original))
    };
    let (bias, error) = differences(|b| b.pdf * b.rounding);
    eprintln!("{:+.3} % ± {:.3}", 100.0 * bias, 100.0 * error);
    assert!(bias.abs() < 4.0 * error + 5e-4 && error < 1e-3, "{bias:+.1e} ± {error:.1e}");
    let (bias, error) = differences(|b| b.pdf);
    assert!(bias > 0.004 && bias > 6.0 * error, "without the ratio: {bias:+.1e} ± {error:.1e}");
}

/// `ENVIRONMENT_LIGHT` of `shaders/light/types.wgsl`.
const ENVIRONMENT: u32 = 0xffff_fffe;

#[test]
fn all_packed_coordinates_are_inside_of_the_triangle() {
    let Some(gpu) = gpu() else { return };
    for [_, s] in points(&lights(gpu), 0, true, &[]) {
        let [b, c] = s.barycentrics;
        assert!(b >= 0.0 && c >= 0.0 && b + c <= 1.000_000_2 && s.pdf.is_finite(), "{s:?}");
    }
}
