//! Both back ends agree with brute force in f64 through two levels of trees; they are watertight, their loops are bounded, and trees fit
//! the stack.

use crate::support::{
    brute_force::BruteForce,
    compose::{Def, flag},
    gpu::{Gpu, Kernel, back_ends, gpu},
    scenes::*,
};
use bevy_restir::{
    testing::gpu_layout::*,
    testing::{
        accel::blas::{MAX_BLAS_DEPTH, MAX_TLAS_DEPTH, STACK_SIZE, build_blas},
        geometry::triangulate::Geometry,
    },
};

const TRACE: &str = include_str!("../support/kernels/trace.wgsl");

/// Checks a claim for each back end that the adapter has.
fn on_each_back_end(defs: &[Def], claim: impl Fn(&Gpu, &Kernel)) {
    for (gpu, backend) in back_ends() {
        let kernel = gpu.kernel("trace", TRACE, &[&backend, defs].concat());
        claim(gpu, &kernel);
    }
}

fn trace(gpu: &Gpu, kernel: &Kernel, scene: &TestScene, rays: &[Ray]) -> Vec<TraceResult> {
    let answers: Vec<TraceResult> = scene.run(gpu, kernel, rays);
    for (ray, a) in rays.iter().zip(&answers) {
        assert_eq!(a.flags, 0, "stack or steps ran out for {ray:?}");
        assert_eq!(a.rays, 2, "the counter says two rays");
        assert_eq!(a.any == 1, a.instance != NONE, "any-hit and closest-hit disagree: {ray:?} {a:?}");
    }
    answers
}

/// Asserts that every answer lies between those of slightly shrunk and slightly grown triangles; `margin` is in barycentric units, and
/// `size` is the scale of distances.
fn agrees(scene: &TestScene, rays: &[Ray], answers: &[TraceResult], margin: f64, size: f64) {
    let oracle = BruteForce::new(scene);
    let mut hits = 0;
    for (ray, a) in rays.iter().zip(answers) {
        let expected = oracle.closest(ray, margin);
        let t = f64::from(a.t);
        let tolerance = size * 1e-5 + t.min(1e20) * 1e-5;
        assert!(
            t >= expected.grown - tolerance && t <= expected.shrunk + tolerance,
            "{ray:?}: {a:?}, expected {expected:?}"
        );
        hits += usize::from(a.instance != NONE);
    }
    assert!(hits * 100 > rays.len(), "only {hits} of {} rays hit", rays.len());
}

fn random_rays(random: &mut Random, count: usize, size: f32) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let mut direction = random.direction();
            // Each component is sometimes zero, with either sign.
            if i % 4 == 0 {
                direction[random.below(3)] = if i % 8 == 0 { 0.0 } else { -0.0 };
            }
            if i % 16 == 0 {
                direction = [0.0; 3];
                direction[random.below(3)] = if i % 32 == 0 { 1.0 } else { -1.0 };
            }
            let t_min = if i % 3 == 0 { random.range(0.0, size) } else { 0.0 };
            let t_max = if i % 5 == 0 { t_min + random.range(0.0, 2.0 * size) } else { FAR };
            Ray { origin: random.point(size), t_min, direction, t_max }
        })
        .collect()
}

#[test]
fn rays_agree_with_brute_force_in_a_mesh() {
    on_each_back_end(&[], |gpu, kernel| {
        let mut random = Random::new(1);
        for (count, size, triangle) in [(1, 0.3, 1.0), (2, 0.5, 1.0), (9, 1.0, 0.8), (3000, 1.0, 0.1), (500, 1.0, 3.0)]
        {
            let scene = TestScene::of(random_soup(&mut random, count, size, triangle));
            let rays = random_rays(&mut random, 2000, 1.0);
            agrees(&scene, &rays, &trace(gpu, kernel, &scene, &rays), 1e-4, 1.0);
        }
    });
}

#[test]
fn rays_agree_with_brute_force_among_transformed_instances() {
    on_each_back_end(&[], |gpu, kernel| {
        let mut random = Random::new(2);
        let meshes =
            [random_soup(&mut random, 20, 1.0, 0.5), sphere(6, 8, 0.2, |p| p), random_soup(&mut random, 1, 0.1, 1.0)];
        for (count, scale, spread) in [(1, 1.0, 0.0), (40, 0.5, 3.0), (400, 0.1, 2.0)] {
            let instances: Vec<_> =
                (0..count).map(|i| (i % 3, random_rows(&mut random, scale, spread), 0, 0)).collect();
            let scene = TestScene::new(&meshes, &instances);
            let rays = random_rays(&mut random, 1000, 2.0);
            agrees(&scene, &rays, &trace(gpu, kernel, &scene, &rays), 1e-3, 1.0);
        }
    });
}

/// Some instances rest, and their triangles are in one tree; others, which have no triangles or have been removed, are beside them.
#[test]
fn rays_agree_with_brute_force_in_a_tree_over_resting_instances() {
    on_each_back_end(&[], |gpu, kernel| {
        let mut random = Random::new(12);
        let meshes = [
            random_soup(&mut random, 20, 1.0, 0.5),
            sphere(6, 8, 0.2, |p| p),
            soup(Vec::new()),
            random_soup(&mut random, 1, 0.1, 1.0),
        ];
        for (count, scale, spread) in [(1, 1.0, 0.0), (40, 0.5, 3.0), (400, 0.1, 2.0)] {
            let instances: Vec<_> =
                (0..count).map(|i| (i % 4, random_rows(&mut random, scale, spread), 0, 0)).collect();
            for share in [1, 2, 7] {
                let scene = TestScene::new(&meshes, &instances).with_world_tree(|i| i % share == 0);
                let rays = random_rays(&mut random, 700, 2.0);
                agrees(&scene, &rays, &trace(gpu, kernel, &scene, &rays), 1e-3, 1.0);
            }
        }
    });
}

/// A removed instance may be in the trees of the last frame.
#[test]
fn a_removed_instance_is_not_hit_in_a_tree_over_resting_instances() {
    let Some(gpu) = gpu() else { return };
    let kernel = gpu.kernel("trace", TRACE, &[]);
    let wall = |z: f32| soup(vec![[[-9.0, -9.0, z], [9.0, -9.0, z], [0.0, 9.0, z]]]);
    let mut scene = TestScene::new(&[wall(-1.0), wall(-2.0)], &[(0, identity(), 0, 0), (1, identity(), 0, 0)]);
    scene = scene.with_world_tree(|_| true);
    let rays = [ray([0.0; 3], [0.0, 0.0, -1.0])];
    let seen = |scene: &TestScene| trace(gpu, &kernel, scene, &rays)[0];
    let (first, second) = (seen(&scene), scene.instances[1].first_triangle);
    assert_eq!((first.instance, first.triangle), (0, scene.instances[0].first_triangle));
    scene.instances[0].blas_root = NONE;
    let behind = seen(&scene);
    assert_eq!((behind.t, behind.instance, behind.triangle), (2.0, 1, second));
}

#[test]
fn rays_agree_with_brute_force_at_extreme_scales() {
    on_each_back_end(&[], |gpu, kernel| {
        let mut random = Random::new(3);
        for scale in [1e-4, 1e-2, 1e3, 1e5] {
            let scene = TestScene::of(random_soup(&mut random, 300, scale, 0.3 * scale));
            let mut rays = random_rays(&mut random, 500, scale);
            // Directions have any length; t is in units of it.
            for ray in &mut rays {
                ray.direction = ray.direction.map(|x| x * scale);
                ray.t_min /= scale;
                if ray.t_max < FAR {
                    ray.t_max /= scale;
                }
            }
            agrees(&scene, &rays, &trace(gpu, kernel, &scene, &rays), 1e-3, 1.0);
        }
        // 1e5 m from the origin, once in the mesh and once by the transform; rays start there too.
        let far = [1e5, -1e5, 1e5];
        let near = random_soup(&mut random, 300, 1.0, 0.3);
        let moved = soup(near.corners().iter().map(|t| t.map(|v| std::array::from_fn(|k| v[k] + far[k]))).collect());
        let mut rows = identity();
        (0..3).for_each(|k| rows[k][3] = far[k]);
        for scene in [TestScene::of(moved), TestScene::new(&[near], &[(0, rows, 0, 0)])] {
            let mut rays = random_rays(&mut random, 500, 1.0);
            rays.iter_mut().for_each(|r| (0..3).for_each(|k| r.origin[k] += far[k]));
            agrees(&scene, &rays, &trace(gpu, kernel, &scene, &rays), 1e-3, 1.0);
        }
    });
}

#[test]
fn degenerate_meshes_are_traced() {
    on_each_back_end(&[], |gpu, kernel| {
        let mut random = Random::new(4);
        let one = random_soup(&mut random, 1, 0.1, 1.0).corners()[0];
        let identical = soup(vec![one; 600]);
        let slivers = soup(
            (0..300)
                .map(|_| {
                    let (a, d, e) = (random.point(1.0), random.direction(), random.point(1e-3));
                    let b: [f32; 3] = std::array::from_fn(|k| a[k] + 2.0 * d[k]);
                    [a, b, std::array::from_fn(|k| b[k] + e[k])]
                })
                .collect(),
        );
        let flat = soup(
            random_soup(&mut random, 300, 1.0, 0.3).corners().iter().map(|t| t.map(|v| [v[0], 0.25, v[2]])).collect(),
        );
        for (mesh, aim) in [(identical, false), (slivers, true), (flat, false)] {
            let mut rays = random_rays(&mut random, 1000, 1.0);
            if aim {
                let triangles = mesh.corners();
                for ray in &mut rays {
                    let [a, b, c] = triangles[random.below(triangles.len())];
                    let w = random.unit();
                    let target: [f32; 3] = std::array::from_fn(|k| w * a[k] + (1.0 - w) * 0.5 * (b[k] + c[k]));
                    ray.direction = std::array::from_fn(|k| target[k] - ray.origin[k]);
                    (ray.t_min, ray.t_max) = (0.0, FAR);
                }
            }
            // Where a ray hits a sliver at a grazing angle, t loses digits.
            let scene = TestScene::of(mesh);
            agrees(&scene, &rays, &trace(gpu, kernel, &scene, &rays), 2e-3, 100.0);
        }
    });
}

#[test]
fn a_closed_mesh_is_watertight_at_its_edges_and_vertices() {
    on_each_back_end(&[], |gpu, kernel| {
        let mut random = Random::new(5);
        let cube: [[f32; 3]; 8] = std::array::from_fn(|i| [0, 1, 2].map(|k| if i >> k & 1 == 1 { 1.0 } else { -1.0 }));
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let cube = soup(
            faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).map(|t| t.map(|i| cube[i])).collect(),
        );
        let tilted = random_rows(&mut random, 3.0, 5.0);
        let far: Rows = [[1.0, 0.0, 0.0, 1e5], [0.0, 1.0, 0.0, 3e4], [0.0, 0.0, 1.0, -1e5]];
        let mut escapes = 0;
        for (mesh, rows) in [
            (sphere(24, 32, 0.1, |p| p), identity()),
            (sphere(24, 32, 0.1, |p| p), tilted),
            (sphere(24, 32, 0.1, |p| p.map(|x| x * 1e-3)), far),
            (sphere(8, 9, 0.0, |p| [p[0] * 1e4, p[1], p[2]]), identity()),
            (cube, identity()),
        ] {
            let triangles = mesh.corners();
            let size = triangles.iter().flatten().flatten().fold(0.0f32, |a, x| a.max(x.abs()));
            let rays: Vec<Ray> = (0..30_000)
                .map(|i| {
                    let [a, b, _] = triangles[random.below(triangles.len())];
                    // Rays from random points and from the exact center, through corners and edges.
                    let w = if i % 2 == 0 { 0.0 } else { random.unit() };
                    let target: [f32; 3] = std::array::from_fn(|k| a[k] + w * (b[k] - a[k]));
                    let start = if i % 3 == 0 { [0.0; 3] } else { random.point(0.3).map(|x| x * 1.0f32.min(size)) };
                    let go = |p: [f32; 3], w: f32| rows.map(|r| r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + w * r[3]);
                    ray(go(start, 1.0), go(std::array::from_fn(|k| target[k] - start[k]), 0.0))
                })
                .collect();
            let scene = TestScene::new(&[mesh], &[(0, rows, 0, 0)]);
            let answers = trace(gpu, kernel, &scene, &rays);
            let lost = answers.iter().filter(|a| a.instance == NONE).count();
            eprintln!("{} rays, {lost} escaped", rays.len());
            escapes += lost;
        }
        // A device's own traversal need not be watertight: Mesa's on a CPU loses 1 % of such rays.
        let most = if kernel.uses(3) { 5 * 30_000 * 3 / 100 } else { 0 };
        assert!(escapes <= most, "{escapes}");
    });
}

#[test]
fn an_empty_scene_stops_no_ray() {
    on_each_back_end(&[], |gpu, kernel| {
        let rays = random_rays(&mut Random::new(6), 64, 1.0);
        for scene in [TestScene::new(&[], &[]), TestScene::new(&[Geometry::default()], &[(0, identity(), 0, 0)])] {
            for (ray, a) in rays.iter().zip(trace(gpu, kernel, &scene, &rays)) {
                assert_eq!((a.instance, a.any, a.t), (NONE, 0, ray.t_max));
            }
        }
    });
}

#[test]
fn non_finite_rays_end_without_a_wrong_hit() {
    on_each_back_end(&[], |gpu, kernel| {
        let scene = TestScene::of(sphere(8, 8, 0.0, |p| p));
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        let rays = [
            ray([nan; 3], [0.0, 0.0, 1.0]),
            ray([0.0; 3], [nan, 0.0, 1.0]),
            ray([0.0; 3], [0.0; 3]),
            ray([inf, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ray([0.0; 3], [inf, 0.0, 0.0]),
            ray([1e38; 3], [-1.0, 0.0, 0.0]),
        ];
        for (ray, a) in rays.iter().zip(trace(gpu, kernel, &scene, &rays)) {
            assert!(a.instance == NONE || a.t.is_finite(), "{ray:?}: {a:?}");
        }
    });
}

#[test]
fn alpha_lets_rays_through_with_its_probability() {
    on_each_back_end(&[flag("ALPHA")], |gpu, kernel| {
        let sheet = soup(vec![[[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [0.0, 0.0, 9.0]]]);
        let at = |y: f32| [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, 0.0]];
        let meshes = vec![sheet];
        let mut instances = vec![(0, at(0.0), 0, 0), (0, at(1.0), 1, INSTANCE_ALPHA), (0, at(2.0), 2, INSTANCE_ALPHA)];
        // Stacked sheets of alpha 0.25: each stops a quarter of the rays.
        instances.extend((0..400).map(|i| (0, at(3.0 + i as f32), 3, INSTANCE_ALPHA)));
        let mut scene = TestScene::new(&meshes, &instances);
        let material = |alpha, flags| GpuMaterial { alpha, flags, ..Default::default() };
        scene.materials = vec![
            material(0.0, 0),
            material(0.4, MATERIAL_ALPHA_MASK),
            material(0.6, MATERIAL_ALPHA_MASK),
            material(0.25, MATERIAL_ALPHA_BLEND),
        ];
        let down = |y: f32, t_max| Ray { origin: [0.0, y, 0.0], t_min: 0.0, direction: [0.0, -1.0, 0.0], t_max };
        let mut rays = vec![down(1.5, FAR), down(2.5, FAR)];
        rays.extend((0..400).map(|i| down(3.5 + i as f32, 1.0)));
        let answers = trace(gpu, kernel, &scene, &rays);
        assert_eq!((answers[0].instance, answers[1].instance), (0, 2), "a mask below its cutoff is absent");
        let stopped = answers[2..].iter().filter(|a| a.any == 1).count();
        assert!((70..130).contains(&stopped), "{stopped} of 400 are stopped, not a quarter");
    });
}

#[test]
fn traversal_of_a_circular_tree_ends_and_is_reported() {
    let Some(gpu) = gpu() else { return };
    let kernel = gpu.kernel("trace", TRACE, &[]);
    // Eight nodes around the origin, each the parent of all eight.
    let exponent = 121u32 * 0x0001_0101;
    let low = (-1.0f32).to_bits();
    let node = [
        [low, low, low, exponent | 0xff00_0000],
        [0, 0, 0x3b3a_3938, 0x3f3e_3d3c],
        [0, 0, u32::MAX, u32::MAX],
        [0, 0, u32::MAX, u32::MAX],
        [0, 0, u32::MAX, u32::MAX],
    ];
    let scene = TestScene { nodes: [node; 8].concat(), ..Default::default() };
    let answers: Vec<TraceResult> = scene.run(gpu, &kernel, &[ray([0.0; 3], [0.6, 0.8, 0.0])]);
    assert_eq!(answers[0].flags, OVERFLOW_STACK | OVERFLOW_STEPS);
    assert_eq!((answers[0].instance, answers[0].any), (NONE, 0));
}

#[test]
fn trees_of_any_mesh_fit_the_stack() {
    assert_eq!(2 * MAX_BLAS_DEPTH + MAX_TLAS_DEPTH + 2, STACK_SIZE);
    let shader = bevy_restir::testing::shader_library::MODULES
        .iter()
        .find(|m| m.0 == "trace/software.wgsl")
        .expect("in the table")
        .1;
    assert!(shader.contains(&format!("const STACK_SIZE: u32 = {STACK_SIZE}u;")));
    // Triangles that share a corner, each a duplicate or slightly larger than the last, make the deepest trees for agglomerative
    // builders.
    for (count, growth) in [(110, 2.0f32), (1500, 1.01), (3000, 1.0), (100_000, 1.0)] {
        let mut size = 1e-20f32.max(growth.powi(-count / 2));
        let triangles = (0..count).map(|_| {
            size *= growth;
            if growth == 1.0 {
                size += 1e-3;
            }
            [[0.0; 3], [size, 0.0, 0.0], [0.0, size, 0.0]]
        });
        let started = std::time::Instant::now();
        let blas = build_blas(&soup(triangles.collect())).expect("not empty");
        eprintln!("{count} nested triangles: depth {}, {:?}", blas.depth(), started.elapsed());
        assert!(started.elapsed().as_secs() < 10 && blas.depth() <= MAX_BLAS_DEPTH);
        assert_eq!(blas.triangles.len(), count as usize);
    }
}
