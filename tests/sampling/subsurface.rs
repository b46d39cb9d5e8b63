//! The diffusion profile and its probes: values equal the f64 oracle, and probes find points with their density.

use crate::support::{
    compose::{Def, flag},
    gpu::{Gpu, back_ends, gpu, wide},
    oracle::subsurface::*,
    scenes::{TestScene, identity, soup, sphere},
    stats::{Random, Statistical, assert_family, chi_squared, failures_of_family},
};
use bevy_restir::testing::{
    geometry::triangulate::Geometry,
    gpu_layout::{GpuMaterial, INSTANCE_ALPHA, MATERIAL_ALPHA_BLEND, MATERIAL_ALPHA_MASK},
};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::{collections::BTreeSet, f64::consts::TAU};

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ProfileQuery {
    normal: [f32; 3],
    radius: f32,
    u: f32,
    pad: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ProfileAnswer {
    tangent: [f32; 3],
    profile: f32,
    bitangent: [f32; 3],
    pdf: f32,
    radius: f32,
    inverse: f32,
    pad: [u32; 2],
}

fn subsurface() -> Vec<Def> {
    vec![flag("SUBSURFACE")]
}

fn profiles(gpu: &Gpu, queries: &[ProfileQuery]) -> Vec<ProfileAnswer> {
    let kernel = gpu.kernel("profile", include_str!("../support/kernels/subsurface_profile.wgsl"), &subsurface());
    TestScene::of(sphere(4, 4, 0.0, |p| p)).run(gpu, &kernel, queries)
}

#[test]
fn the_oracle_of_the_profile_is_consistent() {
    // The CDF is the integral of the profile, by the midpoint rule in ln r.
    let steps = 200_000;
    let (low, high) = (RADIUS_MIN.ln(), 50f64.ln());
    let mut integral = cdf(RADIUS_MIN);
    for i in 0..steps {
        let step = (high - low) / f64::from(steps);
        let r = (low + (f64::from(i) + 0.5) * step).exp();
        integral += profile(r) * TAU * r * r * step;
        if i % 20_000 == 0 {
            let edge = (low + (f64::from(i) + 1.0) * step).exp();
            assert!((integral - cdf(edge)).abs() < 1e-8, "{integral} for {} at {edge}", cdf(edge));
        }
    }
    assert!((exact_cdf(REACH) - 0.999).abs() < 1e-5, "the reach holds 99.9 % of the profile");
    assert!((total() - 0.99975).abs() < 1e-6);
    for i in 0..1000 {
        let u = (f64::from(i) + 0.5) / 1000.0;
        assert!((cdf(inverse(u)) / total() - u).abs() < 1e-12, "{u}");
    }
    // The mean transmission is the integral over the hemisphere.
    for f0 in [0.0, 0.04, 0.5, 1.0] {
        let f90 = if f0 > 0.0 { 1.0 } else { 0.0 };
        let mean: f64 = (0..10_000)
            .map(|i| (f64::from(i) + 0.5) / 1e4)
            .map(|c| (1.0 - f0 - (f90 - f0) * (1.0 - c).powi(5)) * 2.0 * c * 1e-4)
            .sum();
        assert!((mean - mean_transmission(f0)).abs() < 1e-7, "{f0}");
    }
}

#[test]
fn the_profile_and_its_inverse_equal_the_oracle() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random(7);
    let queries: Vec<ProfileQuery> = (0..100_000)
        .map(|i| ProfileQuery {
            normal: (if i % 8 == 0 { (-DVec3::Y + 0.2 * random.direction()).normalize() } else { random.direction() })
                .as_vec3()
                .to_array(),
            radius: (1e-5f64 * 5e6f64.powf(random.unit())) as f32,
            u: if i % 2 == 0 { random.unit() as f32 } else { (10f64.powf(-6.0 * random.unit())) as f32 }
                .min(1.0 - 6e-8),
            pad: [0; 3],
        })
        .collect();
    for (q, a) in queries.iter().zip(profiles(gpu, &queries)) {
        let (r, u) = (f64::from(q.radius), f64::from(q.u));
        let close = |gpu: f32, oracle: f64, relative: f64, absolute: f64| {
            assert!(
                (f64::from(gpu) - oracle).abs() <= relative * oracle.abs() + absolute,
                "{gpu} for {oracle}: {q:?} {a:?}"
            );
        };
        close(a.profile, profile(r), 1e-5, 1e-12);
        close(a.pdf, profile(r) / total(), 1e-5, 1e-12);
        close(a.inverse, cdf(r) / total(), 1e-6, 3e-7);
        // Rounding of u shifts the radius by the error of u over the radial density 2πr p, which is small at great radii and near the core.
        let slack = 4e-7 / (TAU * inverse(u).max(1e-6) * profile(inverse(u)));
        close(a.radius, inverse(u), 1e-4, 1e-6 + slack);
        let [t, b, n] = [a.tangent, a.bitangent, q.normal].map(wide);
        for (x, y, expected) in [(t, t, 1.0), (b, b, 1.0), (t, b, 0.0), (t, n, 0.0), (b, n, 0.0)] {
            assert!((x.dot(y) - expected).abs() < 1e-5, "{q:?}: {a:?}");
        }
        assert!((t.cross(b) - n).length() < 1e-5, "right-handed: {q:?}");
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ProbeQuery {
    position: [f32; 3],
    seed: u32,
    normal: [f32; 3],
    index: u32,
    radius: [f32; 3],
    pad: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct ProbeAnswer {
    axis: u32,
    channel: u32,
    flags: u32,
    count: u32,
    triangles: [u32; 8],
    /// Position and density.
    hits: [[f32; 4]; 8],
}

impl ProbeAnswer {
    /// Triangle, position and density of each hit.
    fn found(&self) -> impl Iterator<Item = (usize, DVec3, f64)> {
        (0..self.count as usize).map(|i| {
            let [x, y, z, density] = self.hits[i].map(f64::from);
            (self.triangles[i] as usize, DVec3::new(x, y, z), density)
        })
    }
}

/// A body, and a point on it from which probes start.
struct Body {
    name: &'static str,
    scene: TestScene,
    origin: Origin,
}

/// Cells of a grid on a quad, as triangles.
fn grid(corner: DVec3, x: DVec3, y: DVec3, cells: usize) -> Vec<[[f32; 3]; 3]> {
    let at = |i: usize, j: usize| {
        (corner + x * (i as f64 / cells as f64) + y * (j as f64 / cells as f64)).as_vec3().to_array()
    };
    let quad = |(i, j): (usize, usize)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..cells * cells).map(|k| (k % cells, k / cells)).flat_map(quad).collect()
}

fn body(name: &'static str, mesh: Geometry, position: DVec3, normal: DVec3, d: DVec3) -> Body {
    let mut scene = TestScene::new(&[mesh], &[(0, identity(), 0, 0)]);
    scene.uniforms.radius = 30.0;
    let n = normal.as_vec3().as_dvec3();
    // The frame of the shader, as the oracle sees it.
    let s = if n.y > -0.9 { 1.0 } else { -1.0 };
    let a = -1.0 / (s + n.y);
    let b = n.z * n.x * a;
    let frame = [DVec3::new(s * b, -s * n.z, 1.0 + s * n.z * n.z * a), DVec3::new(s + n.x * n.x * a, -n.x, b), n];
    let origin = Origin { position: position.as_vec3().as_dvec3(), frame, d: d.as_vec3().as_dvec3() };
    Body { name, scene, origin }
}

fn bodies() -> Vec<Body> {
    let up = DVec3::Y;
    let plane =
        |size: f64, cells| grid(DVec3::new(-size, 0.0, size), DVec3::X * 2.0 * size, DVec3::NEG_Z * 2.0 * size, cells);
    let slab = |h: f64| {
        let mut positions = plane(4.0, 16);
        positions.extend(grid(DVec3::new(-4.0, -h, -4.0), DVec3::X * 8.0, DVec3::Z * 8.0, 16));
        soup(positions)
    };
    let tilted = DVec3::new(0.3, 0.8, -0.2).normalize();
    let on_ball = DVec3::new(0.45, 0.7, 0.5);
    let ball = || sphere(18, 26, 0.0, |p| p);
    vec![
        body("plane", soup(plane(6.0, 24)), DVec3::new(0.06, 0.0, 0.11), up, DVec3::new(0.3, 0.1, 0.03)),
        body(
            "plane under a tilted normal",
            soup(plane(6.0, 24)),
            DVec3::new(0.06, 0.0, 0.11),
            tilted,
            DVec3::splat(0.3),
        ),
        body("ball", ball(), on_ball, on_ball.normalize(), DVec3::new(0.5, 0.1, 0.02)),
        body("ball of two channels", ball(), -on_ball, -on_ball.normalize(), DVec3::new(0.05, 0.0, 0.02)),
        body("thin slab", slab(0.1), DVec3::new(0.06, 0.0, 0.11), up, DVec3::new(0.3, 0.1, 0.05)),
    ]
}

const PROBES: u32 = 1 << 16;

impl Body {
    fn triangle(&self, index: usize) -> ([DVec3; 3], DVec3) {
        let [a, b, c] = self.scene.corners(index).map(wide);
        ([a, b, c], (b - a).cross(c - a).normalize())
    }

    fn probe(&self, gpu: &Gpu, defs: &[Def], seed: u32) -> Vec<ProbeAnswer> {
        let kernel = gpu.kernel("probe", include_str!("../support/kernels/subsurface_probe.wgsl"), defs);
        let query = |index: u32| ProbeQuery {
            position: self.origin.position.as_vec3().to_array(),
            seed,
            normal: self.origin.frame[2].as_vec3().to_array(),
            index,
            radius: self.origin.d.as_vec3().to_array(),
            pad: 0,
        };
        let queries: Vec<ProbeQuery> = (0..PROBES).map(query).collect();
        self.scene.run(gpu, &kernel, &queries)
    }

    /// The p-value of the hits of one axis on one side against the density over triangles.  A probe hits a convex body at most once on
    /// each side, so that the counts are multinomial.
    fn test<'a>(&'a self, gpu: &'a Gpu, axis: usize, entering: bool) -> Statistical<'a> {
        let name = format!("{}, axis {axis}, {}", self.name, if entering { "entering" } else { "leaving" });
        let mut expected: Vec<f64> = (0..self.scene.triangles.len())
            .map(|i| {
                let (corners, normal) = self.triangle(i);
                let density = |p: DVec3| self.origin.density_of_side(axis, entering, p, normal);
                f64::from(PROBES) * over_triangle(&density, corners, 1e-7, 14)
            })
            .collect();
        let found: f64 = expected.iter().sum();
        expected.push(f64::from(PROBES) - found);
        let test = move |seed: u32| {
            let mut counts = vec![0.0; expected.len()];
            for answer in self.probe(gpu, &subsurface(), seed) {
                assert_eq!(answer.flags, 0, "{}: overflow", self.name);
                let side = |t: &u32| (self.triangle(*t as usize).1.dot(self.axis(axis)) > 0.0) == entering;
                let hit =
                    answer.triangles[..answer.count as usize].iter().find(|t| answer.axis == axis as u32 && side(t));
                counts[hit.map_or(self.scene.triangles.len(), |t| *t as usize)] += 1.0;
            }
            chi_squared(&counts, &expected)
        };
        (name, Box::new(test))
    }

    fn axis(&self, axis: usize) -> DVec3 {
        [self.origin.frame[2], self.origin.frame[0], self.origin.frame[1]][axis]
    }
}

#[test]
fn probes_find_points_with_their_density() {
    let Some(gpu) = gpu() else { return };
    let bodies = bodies();
    let tests = bodies.iter().flat_map(|b| (0..3).flat_map(move |axis| [true, false].map(|side| (b, axis, side))));
    assert_family(tests.map(|(b, axis, side)| b.test(gpu, axis, side)));
}

#[test]
fn a_probe_that_starts_elsewhere_is_found() {
    let Some(gpu) = gpu() else { return };
    let mut moved = bodies();
    moved.truncate(1);
    let expected = bodies();
    // Probes about a point beside the one that the density is computed for.
    moved[0].origin.position += DVec3::new(0.1, 0.0, 0.0);
    let test = |seed: u32| {
        let mut counts = vec![0.0; moved[0].scene.triangles.len()];
        for a in moved[0].probe(gpu, &subsurface(), seed) {
            a.triangles[..a.count as usize].iter().for_each(|t| counts[*t as usize] += 1.0);
        }
        let density = |i: usize| {
            let (corners, normal) = expected[0].triangle(i);
            let f = |p: DVec3| expected[0].origin.density(p, normal);
            f64::from(PROBES) * over_triangle(&f, corners, 1e-7, 14)
        };
        chi_squared(&counts, &(0..counts.len()).map(density).collect::<Vec<_>>())
    };
    let found = failures_of_family([("moved".to_string(), Box::new(test) as Box<dyn Fn(u32) -> f64>)]);
    assert_eq!(found.len(), 1);
}

#[test]
fn the_density_of_a_hit_equals_the_oracle_on_both_back_ends() {
    for (gpu, backend) in back_ends() {
        for b in bodies() {
            let mut compared = 0u32;
            for a in b.probe(gpu, &[subsurface(), backend.clone()].concat(), 3) {
                for (triangle, position, density) in a.found() {
                    let expected = b.origin.density(position, b.triangle(triangle).1);
                    // Next to the end of a channel's reach, rounding decides whether the channel counts.
                    let r = (position - b.origin.position).length();
                    if b.origin.d.to_array().into_iter().any(|d| (r - REACH * d).abs() < 1e-5) {
                        continue;
                    }
                    assert!(
                        (density - expected).abs() < 2e-3 * expected,
                        "{}: {density} for {expected}: {a:?}",
                        b.name
                    );
                    compared += 1;
                }
            }
            assert!(compared > PROBES / 4, "{}: {compared} hits", b.name);
        }
    }
}

/// A mask rejects all triangles or none, by its cutoff.  A blended body loses triangles at random, and probes find the others in their
/// order.
#[test]
fn probes_pass_the_triangles_that_their_alpha_tests_reject() {
    let triangles = |a: &ProbeAnswer| a.triangles[..a.count as usize].to_vec();
    for (gpu, backend) in back_ends() {
        let mut ball = bodies().into_iter().find(|b| b.name == "ball").expect("a body has this name");
        ball.scene.instances[0].flags |= INSTANCE_ALPHA;
        let defs = [subsurface(), vec![flag("ALPHA")], backend].concat();
        let mut found = |alpha: f32, flags: u32| -> Vec<Vec<u32>> {
            ball.scene.materials = vec![GpuMaterial { alpha, flags, ..Default::default() }];
            ball.probe(gpu, &defs, 3).iter().map(triangles).collect()
        };
        let opaque = found(0.0, 0);
        assert!(found(0.4, MATERIAL_ALPHA_MASK).iter().all(Vec::is_empty), "below the cutoff");
        assert_eq!(found(0.6, MATERIAL_ALPHA_MASK), opaque, "above the cutoff");
        let blended = found(0.5, MATERIAL_ALPHA_BLEND);
        let [all, there]: [BTreeSet<u32>; 2] =
            [&opaque, &blended].map(|found| found.iter().flatten().copied().collect());
        let share = there.len() as f64 / all.len() as f64;
        println!("{} of {} triangles are there", there.len(), all.len());
        assert!(all.len() > 100 && (0.3..0.7).contains(&share), "{share} of {}", all.len());
        for (opaque, blended) in opaque.into_iter().zip(blended) {
            assert_eq!(blended, opaque.into_iter().filter(|t| there.contains(t)).collect::<Vec<_>>());
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Inverse {
    found: [f32; 3],
    technique: u32,
    normal: [f32; 3],
    count: u32,
    again: [f32; 3],
    is_again: u32,
}

/// Inverted probes find their point again, and choose each technique with the probability that it had found the point.
#[test]
fn inverted_probes_find_their_point_with_the_techniques_of_the_density() {
    let Some(gpu) = gpu() else { return };
    let kernel = gpu.kernel("inverse", include_str!("../support/kernels/subsurface_inverse.wgsl"), &subsurface());
    for b in bodies() {
        let query = |index: u32| ProbeQuery {
            position: b.origin.position.as_vec3().to_array(),
            seed: 5,
            normal: b.origin.frame[2].as_vec3().to_array(),
            index,
            radius: b.origin.d.as_vec3().to_array(),
            pad: 0,
        };
        let queries: Vec<ProbeQuery> = (0..PROBES).map(query).collect();
        let answers: Vec<Inverse> = b.scene.run(gpu, &kernel, &queries);
        let (mut found, mut lost, mut far) = (0u32, 0u32, 0u32);
        let (mut counts, mut expected, mut variance) = ([0.0; 9], [0.0; 9], [0.0; 9]);
        for a in answers.iter().filter(|a| a.count > 0) {
            found += 1;
            lost += u32::from(a.is_again == 0);
            let (position, normal) = (wide(a.found), wide(a.normal));
            let r = (position - b.origin.position).length();
            far += u32::from(a.is_again == 1 && (wide(a.again) - position).length() > 1e-4 * (1.0 + r));
            counts[a.technique as usize] += 1.0;
            let all = b.origin.density(position, normal);
            for technique in 0..9 {
                let p = b.origin.density_of_technique(technique % 3, technique / 3, position, normal) / all;
                expected[technique] += p;
                variance[technique] += p * (1.0 - p);
            }
        }
        println!("{}: {found} hits, {lost} lost, {far} elsewhere", b.name);
        assert!(
            found > PROBES / 4 && lost * 1000 < found && far * 1000 < found,
            "{}: {lost} lost, {far} elsewhere",
            b.name
        );
        for technique in 0..9 {
            let (off, error): (f64, f64) = (counts[technique] - expected[technique], variance[technique]);
            assert!(
                off.abs() < 4.5 * error.sqrt() + 3.0,
                "{}, technique {technique}: {counts:?} for {expected:?}",
                b.name
            );
        }
    }
}

/// The mean of R/p over probes is the integral of the profile over the body: the marginal density is right, and a density without the
/// reach of each technique, or of one axis alone, is not.
#[test]
#[ignore = "second tier: ./run test --more"]
fn one_over_the_density_integrates_the_profile() {
    let Some(gpu) = gpu() else { return };
    let d = DVec3::new(0.05, 0.01, 0.005);
    let mut ball = body("ball", sphere(96, 192, 0.0, |p| p), DVec3::ZERO, DVec3::new(0.36, 0.8, 0.48), d);
    let nearest = |i: &usize| ball.triangle(*i).0[0].dot(ball.origin.frame[2]);
    let at =
        (0..ball.scene.triangles.len()).max_by(|a, b| nearest(a).total_cmp(&nearest(b))).expect("there are triangles");
    let [a, b, c] = ball.triangle(at).0;
    ball.origin.position = ((a + b + c) / 3.0).as_vec3().as_dvec3();
    let mean = |defs: &[&'static str]| {
        let defs: Vec<Def> = defs.iter().map(|def| flag(def)).collect();
        let (mut sum, mut squares, mut n) = (0.0, 0.0, 0.0);
        for seed in 0..16 {
            for a in ball.probe(gpu, &defs, seed) {
                let of_hit = |(_, position, density): (usize, DVec3, f64)| {
                    let r = (position - ball.origin.position).length();
                    let value = if r <= REACH * d.x { profile(r / d.x) / (d.x * d.x) } else { 0.0 };
                    value / density
                };
                let value: f64 = a.found().map(of_hit).sum();
                (sum, squares, n) = (sum + value, squares + value * value, n + 1.0);
            }
        }
        let mean: f64 = sum / n;
        (mean, ((squares / n - mean * mean) / n).sqrt())
    };
    let exact = cdf(REACH);
    let (right, error) = mean(&["SUBSURFACE"]);
    println!("marginal: {right:.5} +- {error:.5} for {exact:.5}");
    assert!(error < 1.5e-3 && (right - exact).abs() < 4.0 * error, "{right} +- {error}, not {exact}");
    for planted in ["PLANT_NO_REACH", "PLANT_ONE_AXIS"] {
        let (wrong, error) = mean(&["SUBSURFACE", planted]);
        println!("{planted}: {wrong:.5} +- {error:.5}");
        assert!((wrong - exact).abs() > 6.0 * error, "{planted}: {wrong} +- {error} passes for {exact}");
    }
}
