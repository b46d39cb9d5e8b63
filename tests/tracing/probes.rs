//! Rays that collect all hits on one instance: both back ends find the hits of brute force, in order, and report a ray with too many hits.

use crate::support::{
    brute_force::{BruteForce, cross, dot, sub},
    compose::{Def, flag},
    gpu::{Gpu, back_ends},
    scenes::*,
};
use bevy_restir::testing::gpu_layout::*;
use bytemuck::{Pod, Zeroable};

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
struct Hits {
    count: u32,
    flags: u32,
    rays: u32,
    pad: u32,
    distances: [f32; 8],
    triangles: [u32; 8],
}

fn collect(gpu: &Gpu, defs: &[Def], scene: &TestScene, rays: &[Ray]) -> Vec<Hits> {
    let defs = [&[flag("SUBSURFACE")], defs].concat();
    let kernel = gpu.kernel("collect", include_str!("../support/kernels/trace_instance.wgsl"), &defs);
    scene.run(gpu, &kernel, rays)
}

/// Distances of all hits on the triangles of instance 0, sorted; `None` if the ray passes an edge within rounding.
fn expected(scene: &TestScene, ray: &Ray) -> Option<Vec<f64>> {
    let (o, d) = (ray.origin.map(f64::from), ray.direction.map(f64::from));
    let mut hits = Vec::new();
    let all = BruteForce::new(scene);
    for [v0, v1, v2] in all.triangles().iter().take(scene.instances[0].triangle_count as usize) {
        let (e1, e2) = (sub(*v1, *v0), sub(*v2, *v0));
        let p = cross(d, e2);
        let determinant = dot(e1, p);
        let s = sub(o, *v0);
        let q = cross(s, e1);
        let (u, v, t) = (dot(s, p) / determinant, dot(d, q) / determinant, dot(e2, q) / determinant);
        let inside = u.min(v).min(1.0 - u - v);
        let ends = (t - f64::from(ray.t_min)).abs().min((t - f64::from(ray.t_max)).abs());
        if inside.abs() < 1e-3 || (inside > 0.0 && ends < 1e-3) || determinant.abs() < 1e-9 {
            return None;
        }
        if inside > 0.0 && t > f64::from(ray.t_min) && t < f64::from(ray.t_max) {
            hits.push(t);
        }
    }
    hits.sort_by(f64::total_cmp);
    Some(hits)
}

fn rays(random: &mut Random, count: usize, size: f32) -> Vec<Ray> {
    let one = |random: &mut Random| {
        let t_min = if random.below(3) == 0 { random.range(0.0, size) } else { 0.0 };
        let t_max = t_min + random.range(0.0, 4.0 * size);
        Ray { origin: random.point(size), t_min, direction: random.direction(), t_max }
    };
    (0..count).map(|_| one(random)).collect()
}

#[test]
fn all_hits_on_an_instance_are_found_in_order() {
    for (gpu, backend) in back_ends() {
        let mut random = Random::new(5);
        let meshes = [random_soup(&mut random, 24, 1.0, 0.6), sphere(10, 14, 0.2, |p| p)];
        for mesh in 0..2 {
            for _ in 0..4 {
                // Another instance lies in the way.
                let others = [(0, random_rows(&mut random, 1.0, 0.5), 0, 0), (1, identity(), 0, 0)];
                let own = (mesh, random_rows(&mut random, 1.0, 0.5), 0, 0);
                let scene = TestScene::new(&meshes, &[&[own], &others[..]].concat());
                let rays = rays(&mut random, 2000, 1.5);
                let (mut compared, mut total, mut most) = (0, 0, 0);
                for (ray, hits) in rays.iter().zip(collect(gpu, &backend, &scene, &rays)) {
                    let Some(expected) = expected(&scene, ray).filter(|e| e.len() <= 8) else { continue };
                    assert_eq!(
                        (hits.count as usize, hits.flags, hits.rays),
                        (expected.len(), 0, 1),
                        "{ray:?}: {hits:?} {expected:?}"
                    );
                    for (t, e) in hits.distances.iter().zip(&expected) {
                        assert!((f64::from(*t) - e).abs() < 1e-4 * (1.0 + e.abs()), "{ray:?}: {hits:?} {expected:?}");
                    }
                    (compared, total, most) = (compared + 1, total + expected.len(), most.max(expected.len()));
                }
                assert!(
                    compared > 1000 && total > 100 && most >= 2,
                    "{compared} rays with {total} hits, at most {most}"
                );
            }
        }
    }
}

#[test]
fn both_back_ends_find_the_same_hits_of_probes() {
    let both = back_ends();
    let [(_, software), (gpu, hardware)] = &both[..] else { return };
    let mut random = Random::new(6);
    for previous in [false, true] {
        let mut scene = TestScene::new(&[sphere(24, 36, 0.2, |p| p)], &[(0, random_rows(&mut random, 1.0, 0.2), 0, 0)]);
        scene.move_to(|| random_rows(&mut Random::new(9), 1.0, 0.2));
        let rays = rays(&mut Random::new(8), 20_000, 1.0);
        let previous = if previous { vec![flag("PREVIOUS")] } else { vec![] };
        let [a, b] = [software, hardware]
            .map(|backend| collect(gpu, &[backend.clone(), previous.clone()].concat(), &scene, &rays));
        let different = a.iter().zip(&b).filter(|(a, b)| (a.count, a.triangles) != (b.count, b.triangles)).count();
        let found: u32 = a.iter().map(|a| a.count).sum();
        println!("{different} of {} probes differ, {found} hits", rays.len());
        // The number of hits depends on the random transform; beside it, 20 differences must be few.
        assert!(different <= 20 && found > 3000, "{different} of {} probes differ", rays.len());
    }
}

#[test]
fn a_probe_with_more_than_eight_hits_returns_none_and_reports_an_overflow() {
    for (gpu, backend) in back_ends() {
        for layers in [8, 9, 200] {
            let layer = |i: i32| [[-1.0, -1.0, i as f32], [3.0, -1.0, i as f32], [-1.0, 3.0, i as f32]];
            let scene = TestScene::of(soup((0..layers).map(layer).collect()));
            let hits = collect(gpu, &backend, &scene, &[ray([0.1, 0.2, -1.0], [0.0, 0.0, 1.0])])[0];
            let expected = if layers == 8 { (8, 0) } else { (0, OVERFLOW_PROBE) };
            assert_eq!((hits.count, hits.flags), expected, "{layers} layers: {hits:?}");
        }
    }
}
