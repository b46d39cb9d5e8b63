//! Random numbers are uniform and independent over (pixel, frame, stream, dimension), and directions survive their encodings.

use crate::support::{
    gpu::{Bound, Gpu, gpu},
    oracle::environment::uv,
    stats::{Random, assert_family, chi_squared},
};
use glam::DVec3;
use std::collections::HashSet;

/// Size of a block of counters: 4 dimensions, 64x64 pixels, 4 frames, 4 streams.
const COUNT: usize = 1 << 18;

type Out = ([u32; 4], [f32; 4]);

fn block(gpu: &Gpu, seed: u32) -> Vec<Out> {
    let seed = gpu.storage(&[seed]);
    let samples = gpu.zeroed::<[u32; 8]>(COUNT);
    let kernel = gpu.kernel("rng", include_str!("../support/kernels/rng.wgsl"), &[]);
    kernel.run([COUNT as u32 / 64, 1, 1], &[(0, 0, Bound::Buffer(&seed)), (0, 1, Bound::Buffer(&samples))]);
    let of = |v: &[u32; 8]| ([v[0], v[1], v[2], v[3]], [v[4], v[5], v[6], v[7]].map(f32::from_bits));
    gpu.read::<[u32; 8]>(&samples).iter().map(of).collect()
}

#[test]
fn numbers_lie_in_0_to_1() {
    let Some(gpu) = gpu() else { return };
    for (bits, unit) in block(gpu, 1) {
        for (b, u) in bits.iter().zip(unit) {
            assert!((0.0..1.0).contains(&u) && (f64::from(u) - f64::from(*b) / 2f64.powi(32)).abs() < 1e-7);
        }
    }
}

#[test]
fn numbers_are_uniform() {
    let Some(gpu) = gpu() else { return };
    assert_family((0..4).map(|channel| {
        let test = move |seed: u32| {
            let mut counts = vec![0.0; 1024];
            for (_, unit) in block(gpu, seed) {
                counts[(unit[channel] * 1024.0) as usize] += 1.0;
            }
            chi_squared(&counts, &[COUNT as f64 / 1024.0; 1024])
        };
        (format!("channel {channel}"), Box::new(test) as Box<dyn Fn(u32) -> f64>)
    }));
}

/// Pairs of numbers fill a 32x32 grid evenly: neighbors in every part of the counter, and channels of one call.
#[test]
fn neighbors_are_independent() {
    let Some(gpu) = gpu() else { return };
    let steps = [("dimension", 0), ("x", 2), ("y", 8), ("frame", 14), ("stream", 16)];
    let pairs = steps
        .into_iter()
        .flat_map(|(name, shift)| [(0, 0), (0, 1), (1, 0), (3, 2)].map(|c| (name, 1usize << shift, c)));
    let channels = [(0, 1), (0, 2), (1, 3)].map(|c| ("the same call", 0, c));
    assert_family(pairs.chain(channels).map(|(name, step, (a, b))| {
        let test = move |seed: u32| {
            let numbers = block(gpu, seed + 100);
            let mut counts = vec![0.0; 1024];
            for i in (0..COUNT).filter(|i| i & step == 0) {
                let cell = |x: f32| (x * 32.0) as usize;
                counts[cell(numbers[i].1[a]) * 32 + cell(numbers[i | step].1[b])] += 1.0;
            }
            let total: f64 = counts.iter().sum();
            chi_squared(&counts, &[total / 1024.0; 1024])
        };
        (format!("{name}: {a}, {b}"), Box::new(test) as Box<dyn Fn(u32) -> f64>)
    }));
}

#[test]
fn no_two_counters_collide() {
    let Some(gpu) = gpu() else { return };
    // One block holds (frame + a, stream + b) for all small a, b; the others hold neighboring seeds.
    let mut seen = HashSet::new();
    for seed in 0..4 {
        for (bits, _) in block(gpu, seed) {
            assert!(seen.insert(bits), "two counters give the same numbers");
        }
    }
}

#[test]
fn encoded_directions_decode_to_the_same_direction() {
    let Some(gpu) = gpu() else { return };
    let mut r = Random(3);
    let mut directions: Vec<DVec3> = (0..20_000).map(|_| r.direction()).collect();
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        directions.extend([axis, -axis]);
        // Most are random; the rest lie on an axis, where frames and maps have their seams and poles.
        directions.extend((0..500).map(|_| (axis + 10f64.powf(-7.0 * r.unit()) * r.direction()).normalize()));
        directions.extend((0..500).map(|_| (10f64.powf(-7.0 * r.unit()) * r.direction() - axis).normalize()));
    }
    let input: Vec<[f32; 4]> = directions.iter().map(|d| d.extend(0.0).as_vec4().to_array()).collect();
    let input_buffer = gpu.storage(&input);
    let output = gpu.zeroed::<[[f32; 4]; 4]>(directions.len());
    let kernel = gpu.kernel("math", include_str!("../support/kernels/math.wgsl"), &[]);
    let bound = [(0, 0, Bound::Buffer(&input_buffer)), (0, 1, Bound::Buffer(&output))];
    kernel.run([directions.len().div_ceil(64) as u32, 1, 1], &bound);
    for (d, [octahedral, equirectangular, t, b]) in input.iter().zip(gpu.read::<[[f32; 4]; 4]>(&output)) {
        let vector = |v: [f32; 4]| DVec3::new(v[0].into(), v[1].into(), v[2].into());
        let d = vector(*d).normalize();
        assert!((vector(octahedral) - d).length() < 1e-4, "{d}: {octahedral:?}");
        assert!((vector(equirectangular) - d).length() < 3e-6, "{d}: {equirectangular:?}");
        let (u, v) = uv(d);
        let apart = (f64::from(octahedral[3]) - u).abs();
        let exact_u = apart.min(1.0 - apart) < 3e-7 || (d.x * d.x + d.z * d.z).sqrt() < 1e-6;
        assert!(
            exact_u && (f64::from(equirectangular[3]) - v).abs() < 3e-7,
            "{d}: {} {}, not {u} {v}",
            octahedral[3],
            equirectangular[3]
        );
        let azimuth = (f64::from(octahedral[3]) - 0.5) * std::f64::consts::TAU;
        let apart = (f64::from(t[3]) - azimuth.sin()).abs().max((f64::from(b[3]) - azimuth.cos()).abs());
        assert!(apart < 1e-6, "sine {} and cosine {} of {azimuth}", t[3], b[3]);
        let (t, b) = (vector(t), vector(b));
        assert!(t.dot(b).abs().max(t.dot(d).abs()).max(b.dot(d).abs()) < 1e-6, "{d}: not orthogonal");
        assert!((t.cross(b) - d).length() < 1e-6, "{d}: not right-handed");
    }
}

/// Where many light paths land in one pixel, the shortest times decide: they need relative precision.
#[test]
fn exponential_times_are_precise_where_they_are_short() {
    let Some(gpu) = gpu() else { return };
    let mut r = Random(4);
    let mut bits: Vec<u32> = (0..10_000).map(|_| (2f64.powf(32.0 * r.unit()) as u32).saturating_sub(1)).collect();
    bits.extend([0, 1, 1 << 25, (1 << 25) - 1, u32::MAX - 1, u32::MAX]);
    let input = gpu.storage(&bits);
    let output = gpu.zeroed::<f32>(bits.len());
    let kernel = gpu.kernel("exponential_time", include_str!("../support/kernels/exponential_time.wgsl"), &[]);
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    kernel.run([bits.len().div_ceil(64) as u32, 1, 1], &bound);
    for (bits, time) in bits.iter().zip(gpu.read::<f32>(&output)) {
        let u = (f64::from(*bits) + 0.5) * 0.5f64.powi(32);
        let expected = -(-u).ln_1p();
        // Beyond 24 bits below 1, u is rounded.
        let error = (f64::from(time) - expected).abs() / expected;
        assert!(error < if u < 0.999 { 1e-4 } else { 0.5 }, "{bits}: {time}, not {expected}");
    }
}

/// Numbers with a small bias and numbers that predict their neighbor fail the statistics above.
#[test]
fn bad_numbers_are_found() {
    let Some(gpu) = gpu() else { return };
    let numbers = block(gpu, 7);
    let mut bent = vec![0.0; 1024];
    let mut paired = vec![0.0; 1024];
    for pair in numbers.chunks(2) {
        let [a, b] = [pair[0].1[0], pair[1].1[0]];
        bent[(a.powf(1.1) * 1024.0) as usize] += 1.0;
        paired[(a * 32.0) as usize * 32 + ((0.85 * b + 0.15 * a) * 32.0) as usize] += 1.0;
    }
    let expected = [COUNT as f64 / 2048.0; 1024];
    assert!(chi_squared(&bent, &expected) < 1e-6 && chi_squared(&paired, &expected) < 1e-6);
}
