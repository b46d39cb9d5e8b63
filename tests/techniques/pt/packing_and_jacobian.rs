//! Parts of path resampling: packed reservoirs keep their content, and the Jacobian of a reconnection equals finite differences.

use crate::support::{
    gpu::{Bound, gpu},
    scenes::Random,
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Pair {
    from: [f32; 3],
    pad_a: f32,
    to: [f32; 3],
    pad_b: f32,
    normal: [f32; 3],
    pad_c: f32,
}

/// Solid angle at `from` per area at `to`, from the points where rays in two nearby directions hit the plane at `to`.
fn by_finite_differences(from: DVec3, to: DVec3, normal: DVec3) -> f64 {
    let direction = (to - from).normalize();
    let (u, v) = direction.any_orthonormal_pair();
    let step = 1e-5;
    let meet = |d: DVec3| from + d * ((to - from).dot(normal) / d.dot(normal));
    let along =
        |t: DVec3| (meet((direction + step * t).normalize()) - meet((direction - step * t).normalize())) / (2.0 * step);
    1.0 / along(u).cross(along(v)).length()
}

#[test]
fn the_jacobian_of_a_reconnection_is_that_of_finite_differences() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(3);
    let pairs: Vec<Pair> = (0..20_000)
        .map(|i| {
            let scale = 10f32.powi(i % 7 - 3);
            let at = |random: &mut Random| random.point(scale);
            Pair { from: at(&mut random), to: at(&mut random), normal: random.direction(), ..Default::default() }
        })
        .collect();
    let (input, output) = (gpu.storage(&pairs), gpu.zeroed::<f32>(pairs.len()));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    let groups = (pairs.len() as u32).div_ceil(64);
    gpu.kernel("geometry factor", include_str!("../../support/kernels/geometry_factor.wgsl"), &[])
        .run([groups, 1, 1], &bound);
    let (mut worst, mut checked) = (0.0f64, 0);
    for (pair, factor) in pairs.iter().zip(gpu.read::<f32>(&output)) {
        let of = |p: [f32; 3]| DVec3::from(p.map(f64::from));
        let (from, to, normal) = (of(pair.from), of(pair.to), of(pair.normal));
        // Nearly edge-on, neither f32 nor finite differences are precise enough.
        if (to - from).normalize().dot(normal).abs() > 0.02 {
            worst = worst.max((f64::from(factor) / by_finite_differences(from, to, normal) - 1.0).abs());
            checked += 1;
        }
    }
    eprintln!("{checked} pairs, error at most {worst:e}");
    assert!(checked > 15_000 && worst < 1e-4, "{worst}");
}

/// Runs a kernel that unpacks and packs elements of `N` words.
fn repacked<const N: usize>(name: &str, kernel: &str, words: &[[u32; N]]) -> Option<Vec<[u32; N]>>
where
    [u32; N]: Pod,
{
    let gpu = gpu()?;
    let flat: Vec<u32> = words.iter().flatten().copied().collect();
    let (input, output) = (gpu.storage(&flat), gpu.zeroed::<u32>(flat.len()));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    gpu.kernel(name, kernel, &[]).run([(words.len() as u32).div_ceil(64), 1, 1], &bound);
    Some(gpu.read::<u32>(&output).chunks_exact(N).map(|c| c.try_into().expect("of N")).collect())
}

fn bits(random: &mut Random, count: u32) -> u32 {
    random.bits() & ((1 << count) - 1)
}

/// The words of a path that both reservoirs share: structure, birth, reconnection vertex and a direction that packing keeps.
fn path_words(random: &mut Random) -> (u32, u32, [u32; 4]) {
    let structure = bits(random, 23);
    // Barycentrics inside of their triangle.
    let (b, c) = (bits(random, 23), bits(random, 23));
    let confidence = bits(random, 12).min(255 * 16);
    let birth = bits(random, 16) | (b & 0xffff) << 16;
    let instance = bits(random, 24) | b >> 16 << 24;
    let triangle = bits(random, 28) | confidence >> 8 << 28;
    (structure, birth, [instance, triangle, c | (confidence & 0xff) << 24, 0x7fff_7fff & random.bits()])
}

const NUMBERS: [f32; 8] = [0.0, 1.0, 1e-30, 3e38, 0.1, f32::NAN, f32::INFINITY, f32::NEG_INFINITY];

/// Usually a valid number.
fn number(random: &mut Random) -> u32 {
    let count = if random.unit() < 0.9 { 5 } else { 8 };
    NUMBERS[random.below(count)].to_bits()
}

#[test]
fn path_reservoirs_keep_their_content_in_64_bytes_and_drop_invalid_numbers() {
    let mut random = Random::new(11);
    let words: Vec<[u32; 16]> = (0..8192)
        .map(|_| {
            let mut w = [0; 16];
            let (structure, birth, vertex) = path_words(&mut random);
            (w[0], w[1], w[2]) = (structure, random.bits(), birth);
            w[4..8].copy_from_slice(&vertex);
            (w[12], w[13]) = (random.bits(), random.bits());
            for i in [3, 8, 9, 10, 11, 14, 15] {
                w[i] = number(&mut random);
            }
            w
        })
        .collect();
    let kernel = include_str!("../../support/kernels/path_reservoir.wgsl");
    let Some(after) = repacked("path reservoir", kernel, &words) else { return };
    let mut lost = 0;
    for (before, after) in words.iter().zip(after) {
        let sound = [3, 8, 9, 10, 11, 14, 15].iter().all(|&i| f32::from_bits(before[i]).is_finite());
        lost += u32::from(!sound);
        // Packing may change the direction to a neighboring code: one unit of 16 bits.
        let near = |a: u32, b: u32| (a as i32 - b as i32).abs() <= 1;
        let directions = near(before[7] & 0xffff, after[7] & 0xffff) && near(before[7] >> 16, after[7] >> 16);
        if sound {
            let same = (0..16).all(|i| i == 7 || before[i] == after[i]);
            assert!(same && directions, "{before:x?}\n{after:x?}");
        } else {
            assert_eq!((after[0], after[3]), (0, 0), "an invalid sample and its weight are dropped");
        }
    }
    assert!(lost > 500);
}

#[test]
fn gi_reservoirs_keep_their_content_in_52_bytes_and_drop_invalid_numbers() {
    let mut random = Random::new(12);
    let words: Vec<[u32; 13]> = (0..8192)
        .map(|_| {
            let mut w = [0; 13];
            let (structure, birth, vertex) = path_words(&mut random);
            (w[0], w[1], w[2]) = (structure, random.bits(), birth);
            w[4..8].copy_from_slice(&vertex);
            for i in [3, 8] {
                w[i] = number(&mut random);
            }
            (w[9], w[10]) = (random.bits(), random.bits());
            // A path that ends by a BSDF ray stores `mis_coefficients` in place of the coordinates of the point on its light.
            if w[0] & 7 != 1 {
                w[10] = number(&mut random);
            }
            // The largest channel uses all of its 18 bits.
            let exponent = 30 + random.bits() % 200;
            (w[11], w[12]) = (random.bits() | 1 << 17, exponent << 22 | random.bits() & 0x3f_ffff);
            w
        })
        .collect();
    let kernel = include_str!("../../support/kernels/indirect_reservoir.wgsl");
    let Some(after) = repacked("indirect reservoir", kernel, &words) else { return };
    for (before, after) in words.iter().zip(after) {
        let hit = before[0] & 7 != 1;
        let sound = [3, 8].iter().chain(hit.then_some(&10)).all(|&i| f32::from_bits(before[i]).is_finite());
        let near = |a: u32, b: u32| (a as i32 - b as i32).abs() <= 1;
        let directions = near(before[7] & 0xffff, after[7] & 0xffff) && near(before[7] >> 16, after[7] >> 16);
        if sound {
            let same = (0..13).all(|i| i == 7 || before[i] == after[i]);
            assert!(same && directions, "{before:x?}\n{after:x?}");
        } else {
            assert_eq!((after[0], after[3]), (0, 0), "an invalid sample and its weight are dropped");
        }
    }
}

#[test]
fn packed_radiance_has_18_bits_of_its_largest_channel() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(13);
    let colors: Vec<[f32; 4]> = (0..20_000)
        .map(|i| {
            let scale = 10f32.powf(random.range(-29.0, 37.0));
            [random.unit() * scale, random.unit() * scale, if i % 3 == 0 { 0.0 } else { random.unit() * scale }, 0.0]
        })
        .collect();
    let (input, output) = (gpu.storage(&colors), gpu.zeroed::<[f32; 4]>(colors.len()));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    let groups = (colors.len() as u32).div_ceil(64);
    gpu.kernel("packed radiance", include_str!("../../support/kernels/packed_radiance.wgsl"), &[])
        .run([groups, 1, 1], &bound);
    let worst = colors
        .iter()
        .zip(gpu.read::<[f32; 4]>(&output))
        .flat_map(|(before, after)| {
            let greatest = before.iter().copied().fold(0.0, f32::max);
            (0..3).map(move |i| (after[i] - before[i]).abs() / greatest)
        })
        .fold(0.0, f32::max);
    eprintln!("error at most {worst:e} of the largest channel");
    assert!(worst <= 1.0 / (1 << 18) as f32, "{worst:e}");
}
