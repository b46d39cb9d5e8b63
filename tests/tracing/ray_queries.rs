//! The hardware back end (ray queries) gives the same results as the software back end: the same hits for each ray, and the same pictures
//! for the same seeds, also while objects move, come, go and become transparent.  Where the adapter has no ray queries, these tests print
//! a message and pass.

use crate::support::{
    app::*,
    bodies::{bending, pose_bending, set_joints, spawn_skinned, swaying, tube},
    brute_force::BruteForce,
    cli::{Folder, asset},
    compose::{Def, flag},
    gpu::{Gpu, back_ends},
    scenes::*,
    small_scenes::*,
};
use bevy::{camera::visibility::RenderLayers, light::NotShadowCaster, prelude::*};
use bevy_restir::{DebugView, Jitter, Restir, Technique, testing::gpu_layout::*};

const TRACE: &str = include_str!("../support/kernels/trace.wgsl");

/// Rays in a million that may hit another triangle or miss, because they pass an edge within rounding.
const FLIPS: f64 = 1000.0;

fn rays(random: &mut Random, count: usize, size: f32) -> Vec<Ray> {
    let one = |random: &mut Random| {
        let t_min = if random.below(3) == 0 { random.range(0.0, 0.5 * size) } else { 0.0 };
        let t_max = if random.below(4) == 0 { t_min + random.range(0.0, 2.0 * size) } else { FAR };
        Ray { origin: random.point(size), t_min, direction: random.direction(), t_max }
    };
    (0..count).map(|_| one(random)).collect()
}

/// Answers of both back ends on one device.
fn both(defs: &[Def], scene: &TestScene, rays: &[Ray]) -> Option<[Vec<TraceResult>; 2]> {
    let (gpu, hardware) = back_ends().into_iter().nth(1)?;
    let answers = |gpu: &'static Gpu, backend: &[Def]| {
        let kernel = gpu.kernel("trace", TRACE, &[backend, defs].concat());
        let answers: Vec<TraceResult> = scene.run(gpu, &kernel, rays);
        for a in &answers {
            assert_eq!((a.flags, a.rays), (0, 2), "two rays without overflow: {a:?}");
        }
        answers
    };
    Some([answers(gpu, &[]), answers(gpu, &hardware)])
}

/// Rays with different answers.  All others are equal except for the last bits.
fn different(name: &str, rays: &[Ray], [software, hardware]: &[Vec<TraceResult>; 2]) -> Vec<usize> {
    let (mut different, mut any, mut inexact, mut hits) = (Vec::new(), 0, 0, 0);
    for (i, (a, b)) in software.iter().zip(hardware).enumerate() {
        any += usize::from(a.any != b.any);
        hits += usize::from(a.instance != NONE);
        if (a.instance, a.triangle) != (b.instance, b.triangle) {
            different.push(i);
            continue;
        }
        inexact += usize::from((a.t, a.barycentrics) != (b.t, b.barycentrics));
        assert!((a.t - b.t).abs() <= 1e-4 * a.t.abs().min(1e30) + 1e-6, "{name}: {:?}: {a:?}, {b:?}", rays[i]);
    }
    eprintln!(
        "{name}: {} rays, {hits} hits: {} on other triangles, {any} blocked in one back end only, {inexact} equal except for the last bits",
        rays.len(),
        different.len()
    );
    let bound = (rays.len() as f64 * FLIPS / 1e6).ceil() as usize;
    assert!(different.len() <= bound && any <= bound, "{name}");
    assert!(hits * 50 > rays.len(), "{name}: enough rays hit");
    different
}

/// Asserts that rays with different answers pass between slightly shrunk and slightly grown triangles.
fn assert_near_edges(name: &str, scene: &TestScene, rays: &[Ray], answers: &[Vec<TraceResult>; 2], size: f64) {
    let oracle = BruteForce::new(scene);
    for i in different(name, rays, answers) {
        let expected = oracle.closest(&rays[i], 1e-3);
        for a in [&answers[0][i], &answers[1][i]] {
            let t = f64::from(a.t);
            let tolerance = 1e-4 * (size + t.min(1e20));
            assert!(
                t >= expected.grown - tolerance && t <= expected.shrunk + tolerance,
                "{name}: {:?}: {a:?}, expected {expected:?}",
                rays[i]
            );
        }
    }
}

#[test]
fn ray_queries_and_software_traversal_find_the_same_hits() {
    let mut random = Random::new(41);
    let shapes = |random: &mut Random| {
        vec![random_soup(random, 300, 1.0, 0.3), sphere(10, 14, 0.2, |p| p), random_soup(random, 1, 0.1, 1.0)]
    };
    for (name, count, scale, spread) in
        [("one mesh", 1, 1.0, 0.0), ("instances (some mirrored)", 60, 0.5, 3.0), ("many instances", 600, 0.15, 3.0)]
    {
        let instances: Vec<_> = (0..count).map(|i| (i % 3, random_rows(&mut random, scale, spread), 0, 0)).collect();
        let scene = TestScene::new(&shapes(&mut random), &instances);
        let rays = rays(&mut random, 20_000, 3.0);
        let Some(answers) = both(&[], &scene, &rays) else { return };
        assert_near_edges(name, &scene, &rays, &answers, 3.0);
    }
    for scale in [1e-4, 1e4] {
        let scene = TestScene::of(random_soup(&mut random, 300, scale, 0.3 * scale));
        let rays = rays(&mut random, 10_000, scale);
        let Some(answers) = both(&[], &scene, &rays) else { return };
        assert_near_edges(&format!("scale {scale:e}"), &scene, &rays, &answers, f64::from(scale));
    }
    // Copies of one triangle, and a flat box.
    let one = random_soup(&mut random, 1, 0.1, 1.0).corners()[0];
    let mut flat = random_soup(&mut random, 300, 1.0, 0.5);
    flat.vertices.iter_mut().for_each(|v| v.position[1] = 0.25);
    for (name, mesh) in [("the same triangle 600 times", soup(vec![one; 600])), ("a flat mesh", flat)] {
        let scene = TestScene::of(mesh);
        let rays = rays(&mut random, 10_000, 1.0);
        let Some([software, hardware]) = both(&[], &scene, &rays) else { return };
        let met = |a: &&TraceResult| a.instance != NONE;
        let (a, b) = (software.iter().filter(met).count(), hardware.iter().filter(met).count());
        eprintln!("{name}: {a} and {b} of {} rays are stopped", rays.len());
        assert!(a > 100 && a.abs_diff(b) <= 10, "rays are blocked whichever of the coincident triangles they hit");
    }
}

#[test]
fn ray_queries_and_software_traversal_pass_the_same_transparent_surfaces() {
    let mut random = Random::new(42);
    let meshes = [random_soup(&mut random, 300, 1.0, 0.4), sphere(8, 10, 0.1, |p| p)];
    let instances: Vec<_> = (0..80)
        .map(|i| {
            (i % 2, random_rows(&mut random, 0.5, 2.0), (i % 4) as u32, if i % 4 > 0 { INSTANCE_ALPHA } else { 0 })
        })
        .collect();
    let mut scene = TestScene::new(&meshes, &instances);
    let material = |alpha, flags| GpuMaterial { alpha, flags, ..Default::default() };
    scene.materials = vec![
        material(1.0, 0),
        material(0.4, MATERIAL_ALPHA_MASK),
        material(0.3, MATERIAL_ALPHA_BLEND),
        material(0.8, MATERIAL_ALPHA_BLEND),
    ];
    let rays = rays(&mut random, 20_000, 2.0);
    let Some(answers) = both(&[flag("ALPHA")], &scene, &rays) else { return };
    different("alpha", &rays, &answers);
    let kinds: Vec<_> =
        (0..4).map(|m| answers[1].iter().filter(|a| a.instance != NONE && a.instance % 4 == m).count()).collect();
    assert!(kinds[0] > 500 && kinds[1] == 0 && kinds[2] > 500 && kinds[3] > kinds[2], "{kinds:?}");
}

#[test]
fn ray_queries_of_the_last_frame_hit_instances_where_they_were() {
    let mut random = Random::new(43);
    let meshes = [random_soup(&mut random, 200, 1.0, 0.3), sphere(8, 10, 0.2, |p| p)];
    let instances: Vec<_> = (0..50).map(|i| (i % 2, random_rows(&mut random, 0.5, 3.0), 0, 0)).collect();
    let mut scene = TestScene::new(&meshes, &instances);
    let rays = rays(&mut random, 20_000, 3.0);
    let Some(before) = both(&[], &scene, &rays) else { return };
    scene.move_to(|| random_rows(&mut random, 0.5, 3.0));
    let past = [flag("PREVIOUS")];
    let (Some(after), Some(then)) = (both(&[], &scene, &rays), both(&past, &scene, &rays)) else { return };
    different("after the move", &rays, &after);
    different("before the move", &rays, &then);
    different(
        "the last frame after the move, and the current frame before it",
        &rays,
        &[before[1].clone(), then[1].clone()],
    );
    let moved = (0..rays.len()).filter(|&i| after[1][i].instance != then[1][i].instance).count();
    assert!(moved * 4 > rays.len(), "the test cannot fail: {moved} rays change");
}

/// Two apps with the same scene, one for each back end.
struct Twins([Rig; 2]);

impl Twins {
    fn new(size: u32) -> Option<Self> {
        let hardware = Rig::tracing_by_ray_queries(size, size)?;
        let twins = Self([Rig::new(size, size)?, hardware]);
        Some(twins)
    }

    fn both<T: PartialEq + std::fmt::Debug>(&mut self, mut tell: impl FnMut(&mut Rig) -> T) -> T {
        let [a, b] = self.0.each_mut().map(&mut tell);
        assert_eq!(a, b);
        a
    }

    /// The number of pixels that differ by more than a thousandth of the brightest channel of both pictures, the largest relative
    /// difference of the means, and the mean.
    fn differences(&mut self, mut picture: impl FnMut(&mut Rig) -> Picture) -> (usize, f64, f64) {
        let [a, b] = self.0.each_mut().map(|rig| {
            let picture = picture(rig);
            rig.assert_sound();
            picture
        });
        let close = |(p, q): (&[f32; 3], &[f32; 3])| {
            let size = p.iter().chain(q).fold(1e-6f32, |m, c| m.max(*c));
            p.iter().zip(q).all(|(p, q)| (p - q).abs() <= 1e-3 * size)
        };
        let far = a.pixels.iter().zip(&b.pixels).filter(|pair| !close(*pair)).count();
        (far, (a.mean() - b.mean()).abs() / a.mean().max(1e-9), a.mean())
    }
}

fn camera(rig: &mut Rig) {
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
}

/// A frame with a history of two frames.
fn third_frame(rig: &mut Rig) -> Picture {
    rig.until_ready();
    rig.set(|restir| restir.reset = true);
    rig.frames(2);
    rig.set(|restir| restir.accumulate = false);
    rig.next()
}

/// A sphere, a rectangle and a sun with a disk.  On another layer than the camera: a pane between them and the surfaces that they light,
/// and a lamp.
fn layered(rig: &mut Rig) {
    shapes(rig);
    let pane = rig.spawn(square(3.0), lambert(0.5), Transform::from_xyz(0.0, 0.2, 0.9));
    let unseen = rig.spawn(square(1.0), lamp(20.0, 2.0, 2.0), Transform::from_xyz(0.0, 0.4, -1.0));
    for entity in [pane, unseen] {
        rig.insert(entity, RenderLayers::layer(1));
    }
}

type Scene = (&'static str, fn(&mut Rig));
const BLENDED: Scene = ("blended", blended);
const OTHERS: [Scene; 3] = [("glossy", glossy), ("punctual", punctual), ("shapes and layers", layered)];

/// CPU drivers take minutes to compile the path passes, so that the techniques are tests of their own, side by side.
#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_by_a_blended_sheet_is_the_same_by_ray_queries() {
    same_pictures(&[BLENDED], &[Technique::Gi]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn all_light_by_a_blended_sheet_is_the_same_by_ray_queries() {
    same_pictures(&[BLENDED], &[Technique::Pt]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_pictures_of_paths_are_the_same_by_ray_queries() {
    same_pictures(&OTHERS, &[Technique::Gi, Technique::Pt, Technique::Bdpt]);
    same_pictures(&[BLENDED], &[Technique::Bdpt]);
}

#[test]
fn pictures_of_one_seed_are_the_same_by_ray_queries() {
    same_pictures(&[&OTHERS[..], &[BLENDED]].concat(), &[Technique::Reference, Technique::Di]);
}

fn same_pictures(scenes: &[Scene], techniques: &[Technique]) {
    for &(name, make) in scenes {
        let Some(mut twins) = Twins::new(32) else { return };
        twins.both(make);
        twins.both(camera);
        assert_eq!(twins.0.each_mut().map(|rig| rig.until_ready().backend), ["software", "hardware"]);
        for &technique in techniques {
            let settings = Restir { technique, bounces: 3, jitter: Jitter::Always, ..plain() };
            twins.both(|rig| rig.set(|restir| *restir = settings.clone()));
            let (far, difference, mean) = twins.differences(third_frame);
            eprintln!("{name} {technique:?}: {far} of 1024 pixels differ, means by {difference:.2e}");
            assert!(mean > 1e-3, "the picture is not black");
            // A different hit at an edge changes one path of one sample; reuse spreads it to neighbors.
            assert!(far <= 20 && difference < 5e-3, "{name} {technique:?}");
        }
    }
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_moving_pictures_of_paths_of_one_seed_are_the_same_by_ray_queries() {
    same_moving_pictures(Technique::Pt, moving, pose_moving);
    same_moving_pictures(Technique::Pt, bending, pose_bending);
}

#[test]
fn moving_pictures_of_one_seed_are_the_same_by_ray_queries() {
    same_moving_pictures(Technique::Di, moving, pose_moving);
    same_moving_pictures(Technique::Di, bending, pose_bending);
}

fn same_moving_pictures(technique: Technique, make: fn(&mut Rig), pose: fn(&mut Rig, u32)) {
    let Some(mut twins) = Twins::new(32) else { return };
    twins.both(make);
    twins.both(camera);
    let settings = Restir { technique, bounces: 3, ..plain() };
    twins.both(|rig| rig.set(|restir| *restir = settings.clone()));
    let (far, difference, mean) = twins.differences(|rig| {
        pose(rig, 0);
        rig.until_ready();
        rig.set(|restir| restir.reset = true);
        for step in 0..STEPS {
            pose(rig, step);
            rig.frame();
        }
        pose(rig, STEPS);
        rig.next()
    });
    eprintln!("moving {technique:?}: {far} of 1024 pixels differ, means by {difference:.2e}");
    assert!(mean > 1e-3 && far <= 20 && difference < 5e-3, "{technique:?}");
}

#[test]
fn objects_may_come_go_and_change_under_ray_queries() {
    let Some(mut twins) = Twins::new(24) else { return };
    let reference = Restir { bounces: 2, ..plain() };
    twins.both(|rig| rig.set(|restir| *restir = reference.clone()));
    let check = |twins: &mut Twins, what: &str, is_lit: bool| {
        let (far, difference, mean) = twins.differences(|rig| rig.picture(2));
        eprintln!("{what}: {far} of 576 pixels differ, means by {difference:.2e}");
        assert!(far <= 6 && difference < 5e-3 && (mean > 1e-4) == is_lit, "{what}: {mean}");
    };
    check(&mut twins, "nothing", false);
    twins.both(glossy);
    check(&mut twins, "the scene", true);
    let pane = twins.both(|rig| rig.spawn(square(1.2), lambert(0.5), Transform::from_xyz(0.2, 0.0, 1.0)));
    check(&mut twins, "one object more", true);
    let edit = |rig: &mut Rig, change: &dyn Fn(&mut StandardMaterial)| {
        let material = rig.material_of(pane);
        rig.edit(&material, |material| change(material));
    };
    twins.both(|rig| {
        edit(rig, &|material| {
            material.alpha_mode = AlphaMode::Blend;
            material.base_color = Color::linear_rgba(0.5, 0.2, 0.2, 0.5);
        });
    });
    check(&mut twins, "half transparent", true);
    twins.both(|rig| edit(rig, &|material| material.alpha_mode = AlphaMode::Opaque));
    check(&mut twins, "opaque again", true);
    twins.both(|rig| {
        let mesh = rig.get_mut::<Mesh3d>(pane).0.clone();
        rig.edit(&mesh, |mesh: &mut Mesh| *mesh = Sphere::new(0.5).mesh().uv(12, 8));
    });
    check(&mut twins, "with another mesh", true);
    // A still scene uploads nothing.
    twins.both(|rig| rig.frames(3));
    assert_eq!(twins.both(|rig| rig.report().uploaded_bytes), 0);
    twins.both(|rig| rig.insert(pane, Visibility::Hidden));
    check(&mut twins, "hidden", true);
    twins.both(|rig| {
        rig.app.world_mut().despawn(pane);
        let meshes: Vec<Entity> =
            rig.app.world_mut().query_filtered::<Entity, With<Mesh3d>>().iter(rig.app.world()).collect();
        meshes.into_iter().for_each(|entity| {
            rig.app.world_mut().despawn(entity);
        });
    });
    check(&mut twins, "an empty scene", false);
}

/// A body has a tree for each opacity, and none of them is rebuilt while no ray can hit it.
#[test]
fn rays_find_a_body_that_has_bent_while_it_was_transparent_or_cast_no_shadows() {
    let Some(mut twins) = Twins::new(24) else { return };
    let body = twins.both(|rig| {
        rig.set(|restir| restir.debug_view = DebugView::TracedInstances);
        spawn_skinned(rig, "body", tube(), lambert(0.7))
    });
    let grow = |twins: &mut Twins, scales: [f32; 2]| {
        // Both versions of the body's geometry are posed.
        for scale in scales {
            let foot = Transform::from_xyz(0.0, -1.2, 0.0).with_scale(Vec3::splat(scale));
            twins.both(|rig| {
                set_joints(rig, body, &swaying(foot, 0.0, 0.2));
                rig.frame();
            });
        }
    };
    let fade = |twins: &mut Twins, alpha: f32, alpha_mode: AlphaMode| {
        twins.both(|rig| {
            let paint = rig.material_of(body);
            rig.edit(&paint, |m| (m.alpha_mode, m.base_color) = (alpha_mode, Color::linear_rgba(0.7, 0.7, 0.7, alpha)));
            rig.frames(2);
        });
    };
    let check = |twins: &mut Twins, what: &str| {
        let seen =
            twins.0.each_mut().map(|rig| rig.next().iter().filter(|(_, color)| color.max_element() > 0.0).count());
        eprintln!("{what}: {seen:?} pixels");
        assert!(seen[0] > 30 && seen[0].abs_diff(seen[1]) <= 4, "{what}: {seen:?} pixels");
    };
    twins.both(|rig| _ = rig.until_ready());
    grow(&mut twins, [0.5, 0.6]);
    fade(&mut twins, 0.9, AlphaMode::Blend);
    twins.both(|rig| _ = rig.until_ready());
    grow(&mut twins, [1.2, 1.3]);
    fade(&mut twins, 1.0, AlphaMode::Opaque);
    check(&mut twins, "it was transparent");
    grow(&mut twins, [0.5, 0.6]);
    twins.both(|rig| {
        rig.insert(body, NotShadowCaster);
        rig.frames(2);
    });
    grow(&mut twins, [1.2, 1.3]);
    twins.both(|rig| {
        rig.app.world_mut().entity_mut(body).remove::<NotShadowCaster>();
        rig.frames(2);
    });
    check(&mut twins, "it cast no shadows");
}

#[test]
fn missing_ray_query_hardware_gives_a_warning() {
    let Some(folder) = Folder::new("backend") else { return };
    let run = |backend: &str| {
        let arguments = [
            "--technique=reference",
            "--size=8x8",
            "--frames=1",
            "--out=out.exr",
            "--stats=stats.json",
            "--backend",
            backend,
        ];
        let run = folder.render(&asset("cornell.glb"), &arguments);
        run.succeeded();
        let text = std::fs::read_to_string(folder.path("stats.json")).expect("the file was written");
        let stats: serde_json::Value = serde_json::from_str(&text).expect("the file is JSON");
        (stats["backend"].as_str().expect("text").to_string(), run.stdout + &run.stderr)
    };
    assert_eq!(run("software").0, "software");
    let (used, output) = run("hardware");
    let warnings = output.lines().filter(|line| line.contains("the software back end traces the rays instead")).count();
    assert_eq!(
        (used.as_str(), warnings),
        if back_ends().len() > 1 { ("hardware", 0) } else { ("software", 1) },
        "{output}"
    );
}
