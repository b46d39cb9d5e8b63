//! Sphere, rectangle and sun lights: samples follow their densities, rays hit the lights where they are, and the irradiance is right.

use crate::support::{
    compose::{Def, flag},
    gpu::{Bound, Gpu, gpu, wide},
    light_scene::LightScene,
    stats::{Random, Statistical, assert_family, chi_squared, failures_of_family, z_test},
};
use bevy_restir::{
    testing::gpu_layout::*,
    testing::{accel::blas::bake, accel::tlas::build_tlas},
};
use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::{PI, TAU};

const SAMPLES: usize = 1 << 15;
const FAR: f32 = 3.0e38;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Query {
    point: [f32; 3],
    light: u32,
    direction: [f32; 3],
    reach: f32,
    seed: u32,
    mode: u32,
    pad: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Sample {
    wi: [f32; 3],
    distance: f32,
    radiance: [f32; 3],
    pdf: f32,
    position: [f32; 3],
    met: u32,
    normal: [f32; 3],
    met_pdf: f32,
    met_position: [f32; 3],
    met_distance: f32,
    met_radiance: [f32; 3],
    crossings: u32,
    mask: [u32; 4],
}

/// The modes of the kernel: the ways to obtain a sample.
const REFERENCE: u32 = 0;
const CANDIDATE: u32 = 1;
const MEASURE: u32 = 2;
const GIVEN: u32 = 3;

fn run(lit: &LightScene, queries: &[Query], count: usize) -> Vec<Sample> {
    let defs: Vec<Def> = ["LIGHT_SPHERES", "LIGHT_RECTS", "SUN_DISK", "LIGHT_SHAPES"].map(flag).into();
    let input = lit.gpu.storage(queries);
    let samples = lit.gpu.zeroed::<Sample>(count);
    let bound = [(2, 0, Bound::Buffer(&input)), (2, 1, Bound::Buffer(&samples))];
    lit.run("light_shape", include_str!("../support/kernels/light_shape.wgsl"), &defs, count as u32, &bound);
    lit.gpu.read(&samples)
}

fn sampled(lit: &LightScene, light: u32, point: DVec3, mode: u32, seed: u32) -> Vec<Sample> {
    let query = Query { point: point.as_vec3().to_array(), light, mode, seed, reach: FAR, ..Default::default() };
    run(lit, &[query], SAMPLES)
}

pub(super) const CENTER: DVec3 = DVec3::new(1.0, 2.0, -0.5);
pub(super) const RADIUS: f64 = 0.25;
pub(super) const HALF: DVec2 = DVec2::new(0.75, 0.5);
/// 1 - cosine of the angular radius of a sun that is five degrees across.
pub(super) fn rim() -> f64 {
    2.0 * (2.5f64.to_radians() / 2.0).sin().powi(2)
}

pub(super) fn turn() -> DQuat {
    DQuat::from_rotation_y(2.5) * DQuat::from_rotation_x(0.8)
}

/// The parameters of a rotation as `src/scene/light/analytic.rs` packs them.
fn parameters(q: DQuat) -> [f32; 3] {
    let q = if q.w < 0.0 { -q } else { q };
    (DVec3::new(q.x, q.y, q.z) / (1.0 + q.w)).as_vec3().to_array()
}

fn sun_direction() -> DVec3 {
    DVec3::new(0.3, -0.9, 0.2).normalize()
}

pub(super) fn sphere(center: DVec3, radius: f64) -> GpuLight {
    GpuLight {
        kind: LIGHT_SPHERE,
        position: center.as_vec3().to_array(),
        emission: [1.0, 2.0, 3.0],
        data: [(radius as f32).to_bits(), 0],
        ..Default::default()
    }
}

pub(super) fn rect(center: DVec3, rotation: DQuat, half: DVec2) -> GpuLight {
    GpuLight {
        kind: LIGHT_RECT,
        position: center.as_vec3().to_array(),
        emission: [1.0, 2.0, 3.0],
        direction: parameters(rotation),
        data: [(half.x as f32).to_bits(), (half.y as f32).to_bits()],
        ..Default::default()
    }
}

/// Indices of the lights: a sun, a sphere and a rectangle.
const SUN: u32 = 0;
const BALL: u32 = 1;
const RECT: u32 = 2;

pub(super) fn sun() -> GpuLight {
    GpuLight {
        kind: LIGHT_SUN,
        emission: [1.0, 2.0, 3.0],
        direction: sun_direction().as_vec3().to_array(),
        data: [(rim() as f32).to_bits(), 0],
        ..Default::default()
    }
}

fn lights(gpu: &Gpu) -> LightScene<'_> {
    let mut lit = LightScene::new(gpu);
    lit.lights = vec![sun(), sphere(CENTER, RADIUS), rect(CENTER, turn(), HALF)];
    lit.set_powers(&[1.0; 3]);
    lit.scene.sun_count = 1;
    lit
}

/// Points that see the sphere from close by, from far away, from its surface and from inside.
fn viewers() -> [(&'static str, DVec3); 5] {
    let side = DVec3::new(0.6, -0.48, 0.64);
    [
        ("near", CENTER + 3.0 * RADIUS * side),
        ("afar", CENTER - 4000.0 * RADIUS * side),
        ("close", CENTER + 1.001 * RADIUS * side),
        ("within", CENTER + 0.7 * RADIUS * side),
        ("at the center", CENTER),
    ]
}

/// Cells of equal probability in a cone around an axis: bands of 1 - cosine, cut into sectors.
fn cone_cell(wi: DVec3, axis: DVec3, rim: f64) -> usize {
    let (u, v) = axis.any_orthonormal_pair();
    let out = if rim < 0.5 { 0.5 * (wi - axis).length_squared() } else { 1.0 - wi.dot(axis) } / rim;
    let turn = (wi.dot(v).atan2(wi.dot(u)) / TAU).rem_euclid(1.0);
    ((out * 16.0) as usize).min(15) * 16 + ((turn * 16.0) as usize).min(15)
}

fn chi_squared_of_cells(cells: impl Iterator<Item = usize>) -> f64 {
    let mut counts = vec![0.0; 256];
    cells.for_each(|cell| counts[cell] += 1.0);
    chi_squared(&counts, &[SAMPLES as f64 / 256.0; 256])
}

/// The cone that the sphere fills as seen from a point: its axis and 1 - cosine of its half angle.
fn cone(point: DVec3) -> (DVec3, f64) {
    let d = CENTER - point;
    let sine = RADIUS / d.length();
    if sine >= 1.0 {
        return (DVec3::Z, 2.0);
    }
    (d.normalize(), sine * sine / (1.0 + (1.0 - sine * sine).sqrt()))
}

#[test]
fn spheres_are_sampled_uniformly_in_their_cone_and_over_all_directions_from_inside() {
    let Some(gpu) = gpu() else { return };
    let lit = lights(gpu);
    let lit = &lit;
    let tests = viewers().into_iter().flat_map(|(name, point)| {
        [REFERENCE, CANDIDATE].map(|mode| {
            let test = move |seed: u32| {
                // The f32 point that the shader sees.
                let point = wide(point.as_vec3().to_array());
                let (axis, rim) = cone(point);
                let pdf = 1.0 / (TAU * rim);
                let samples = sampled(lit, BALL, point, mode, seed);
                // Stored points have 16 bits per coordinate; samples at the silhouette may not survive that.
                let lost = samples.iter().filter(|s| s.radiance[1] == 0.0).count();
                let allowed = if mode == CANDIDATE && name == "close" { SAMPLES / 100 } else { SAMPLES / 1000 };
                assert!(lost <= allowed, "{name}: {lost} samples are invalid");
                for s in samples.iter().filter(|s| s.radiance[1] > 0.0) {
                    let on_surface = (wide(s.position) - CENTER).length() / RADIUS - 1.0;
                    assert!(on_surface.abs() < 1e-5, "{name}: {s:?}");
                    assert!((f64::from(s.pdf) / pdf - 1.0).abs() < 2e-3, "{name}: {s:?}, not {pdf}");
                    let d = wide(s.position) - point;
                    assert!((wide(s.wi) - d.normalize()).length() < 1e-5 && s.radiance == [1.0, 2.0, 3.0]);
                    assert!(
                        (wide(s.normal) - (wide(s.position) - CENTER) / RADIUS).length() < 1e-5 * (1.0 + d.length())
                    );
                }
                // The position is rounded at large distances.
                let axis_of = |s: &Sample| cone_cell(wide(s.wi), axis, rim);
                chi_squared_of_cells(samples.iter().map(axis_of))
            };
            (format!("{name}, mode {mode}"), Box::new(test) as Box<dyn Fn(u32) -> f64>)
        })
    });
    // Close to the sphere, stored points are not precise enough for exact cells.
    assert_family(tests.filter(|(name, _)| !(name.starts_with("close") && name.ends_with('1'))));
}

#[test]
fn sphere_and_rectangle_samples_are_uniform_in_area_and_sun_samples_in_solid_angle() {
    let Some(gpu) = gpu() else { return };
    let lit = lights(gpu);
    let lit = &lit;
    let uv = |s: &Sample| {
        let local = turn().inverse() * (wide(s.position) - CENTER);
        assert!(local.z.abs() < 1e-5 && (wide(s.normal) - turn() * DVec3::NEG_Z).length() < 1e-5, "{s:?}");
        0.5 + 0.5 * local.truncate() / HALF
    };
    let rect_cell = move |s: &Sample| {
        let at = (uv(s) * 16.0).as_ivec2().clamp(glam::IVec2::ZERO, glam::IVec2::splat(15));
        (at.y * 16 + at.x) as usize
    };
    let point = DVec3::new(0.3, -0.5, 1.0);
    let ball = move |seed: u32| {
        let s = sampled(lit, BALL, point, MEASURE, seed);
        chi_squared_of_cells(s.iter().map(|s| cone_cell((wide(s.position) - CENTER) / RADIUS, DVec3::Z, 2.0)))
    };
    let mut tests: Vec<Statistical> = vec![("ball".into(), Box::new(ball))];
    for mode in [REFERENCE, CANDIDATE, MEASURE] {
        let rectangle =
            move |seed: u32| chi_squared_of_cells(sampled(lit, RECT, point, mode, seed).iter().map(rect_cell));
        tests.push((format!("rectangle, mode {mode}"), Box::new(rectangle)));
        let sun = move |seed: u32| {
            let samples = sampled(lit, SUN, point, mode, seed);
            for s in &samples {
                assert!((f64::from(s.pdf) * TAU * rim() - 1.0).abs() < 1e-4 && s.distance > 1e38, "{s:?}");
            }
            chi_squared_of_cells(samples.iter().map(|s| cone_cell(wide(s.wi), -sun_direction(), rim())))
        };
        tests.push((format!("sun, mode {mode}"), Box::new(sun)));
    }
    assert_family(tests);
}

/// Irradiance divided by radiance, for a polygon that lies entirely above the plane of the receiver (Lambert 1760).
fn form_factor(corners: &[DVec3], point: DVec3, normal: DVec3) -> f64 {
    let d: Vec<DVec3> = corners.iter().map(|c| (c - point).normalize()).collect();
    let edge = |i: usize| {
        let (a, b) = (d[i], d[(i + 1) % d.len()]);
        a.angle_between(b) * a.cross(b).normalize().dot(normal)
    };
    ((0..d.len()).map(edge).sum::<f64>() / 2.0).abs()
}

/// Receivers of light with radiance 2: (name, light, point, normal, irradiance).
fn receivers() -> Vec<(String, u32, DVec3, DVec3, f64)> {
    let mut all = Vec::new();
    for (name, point) in viewers() {
        let d = CENTER - point;
        if d.length() > RADIUS {
            let tilted = (d.normalize() + 0.2 * d.any_orthogonal_vector().normalize()).normalize();
            // The sphere lies entirely above the horizon, but receivers close to it must face its center.
            let normal = if name == "close" { d.normalize() } else { tilted };
            let exact = 2.0 * PI * (RADIUS / d.length()).powi(2) * normal.dot(d.normalize());
            all.push((format!("ball, {name}"), BALL, point, normal, exact));
        } else {
            all.push((format!("ball, {name}"), BALL, point, DVec3::Y, 2.0 * PI));
        }
    }
    let shines = turn() * DVec3::NEG_Z;
    let corner = |x: f64, y: f64| CENTER + turn() * DVec3::new(x * HALF.x, y * HALF.y, 0.0);
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    for (name, point, front) in [
        ("front", CENTER + 1.5 * shines, true),
        ("aside", CENTER + 0.7 * shines + 1.2 * (turn() * DVec3::X), true),
        ("afar", CENTER + 300.0 * shines, true),
        ("behind", CENTER - shines, false),
    ] {
        let normal = (CENTER - point).normalize();
        let exact = if front { 2.0 * form_factor(&corners, point, normal) } else { 0.0 };
        all.push((format!("rectangle, {name}"), RECT, point, normal, exact));
    }
    let normal = (-sun_direction() + 0.5 * DVec3::X).normalize();
    let solid = 2.0 * PI * (1.0 - (1.0 - rim()).powi(2));
    all.push(("sun".into(), SUN, DVec3::ZERO, normal, solid * normal.dot(-sun_direction())));
    all
}

fn irradiance_tests<'a>(lit: &'a LightScene, scale: f64) -> Vec<Statistical<'a>> {
    receivers()
        .into_iter()
        .flat_map(|(name, light, point, normal, exact)| {
            [REFERENCE, CANDIDATE, MEASURE].map(|mode| {
                let test = move |seed: u32| {
                    let (mut sum, mut squares) = (0.0, 0.0);
                    for s in sampled(lit, light, point, mode, seed) {
                        // A light seen edge-on has no density and gives no light.
                        let e = if s.pdf > 0.0 {
                            f64::from(s.radiance[1]) * wide(s.wi).dot(normal).max(0.0) / f64::from(s.pdf)
                        } else {
                            0.0
                        };
                        sum += scale * e;
                        squares += scale * scale * e * e;
                    }
                    // Tolerance for the rounding of far positions and of stored points close by.
                    z_test(sum, squares + SAMPLES as f64 * (0.03 * exact).powi(2), SAMPLES as f64, exact)
                };
                (format!("{name}, mode {mode}"), Box::new(test) as Box<dyn Fn(u32) -> f64>)
            })
        })
        .collect()
}

#[test]
fn samples_of_area_lights_average_to_their_irradiance() {
    let Some(gpu) = gpu() else { return };
    let lit = lights(gpu);
    // From close by, only a cap of the sphere is visible, which samples of its whole surface rarely hit.
    assert_family(irradiance_tests(&lit, 1.0).into_iter().filter(|(name, _)| name != "ball, close, mode 2"));
}

#[test]
fn an_area_light_density_that_is_wrong_by_three_percent_is_found() {
    let Some(gpu) = gpu() else { return };
    let lit = lights(gpu);
    let tests: Vec<_> = irradiance_tests(&lit, 1.03).into_iter().filter(|(name, _)| name.ends_with("mode 0")).collect();
    let count = tests.len();
    // All but the receiver behind the rectangle, which gets no light.
    assert_eq!(failures_of_family(tests).len(), count - 1);
}

#[test]
fn a_ray_toward_a_sample_hits_the_light_with_the_density_of_the_sample() {
    let Some(gpu) = gpu() else { return };
    let lit = lights(gpu);
    for (name, light, point, ..) in receivers() {
        if name.ends_with("behind") {
            continue;
        }
        let samples = sampled(&lit, light, point, REFERENCE, 5);
        let mut missed = 0;
        for s in samples {
            if s.met != light {
                // Rays may miss at the edge only.
                missed += 1;
                continue;
            }
            let close = name.ends_with("close");
            let near = (f64::from(s.met_pdf) / f64::from(s.pdf) - 1.0).abs();
            assert!(near < if light == RECT { 5e-3 } else { 1e-4 } || close, "{name}: {s:?}");
            // At the silhouette of the sphere the hit distance is the root of a rounding error.
            let scale = (wide(s.position) - point).length();
            let off = (wide(s.met_position) - wide(s.position)).length();
            assert!(light == SUN || close || off < 2e-3 * scale.max(RADIUS), "{name}: {s:?} is off by {off}");
        }
        assert!(missed < SAMPLES / 200, "{name}: {missed} rays miss");
    }
}

/// Where a ray hits a light, and a tolerance within which it might miss.
fn oracle(light: &GpuLight, origin: DVec3, d: DVec3) -> (Option<f64>, f64) {
    let center = wide(light.position);
    let of = |i: usize| f64::from(f32::from_bits(light.data[i]));
    match light.kind {
        LIGHT_SPHERE => {
            let to = center - origin;
            let along = to.dot(d);
            let half = of(0).powi(2) - (to - along * d).length_squared();
            let within = to.length() <= of(0);
            let t = along + if within { 1.0 } else { -1.0 } * half.max(0.0).sqrt();
            let margin = half.abs().min((to.length() - of(0)).abs() * of(0)) / of(0).powi(2);
            ((half > 0.0 && t >= 0.0).then_some(t), margin)
        }
        LIGHT_RECT => {
            let m = wide(light.direction);
            let q = DQuat::from_xyzw(2.0 * m.x, 2.0 * m.y, 2.0 * m.z, 1.0 - m.length_squared()).normalize();
            let (o, d) = (q.inverse() * (origin - center), q.inverse() * d);
            // The light emits along -z, so that rays along +z hit its front.
            let t = -o.z / d.z;
            let at = (o + t * d).truncate() / DVec2::new(of(0), of(1));
            let edge = at.abs().max_element() - 1.0;
            ((d.z > 0.0 && t > 0.0 && edge < 0.0).then_some(t), edge.abs().min(d.z.abs()).min((o.z / of(0)).abs()))
        }
        _ => {
            let away = 0.5 * (d + wide(light.direction)).length_squared();
            ((away < of(0)).then_some(1e39), (away / of(0) - 1.0).abs())
        }
    }
}

/// Twenty suns, and a hundred overlapping spheres and rectangles.
fn many(gpu: &Gpu) -> LightScene<'_> {
    let mut random = Random(8);
    let mut lit = LightScene::new(gpu);
    let mut boxes = Vec::new();
    for i in 0..20 {
        lit.lights.push(GpuLight {
            kind: LIGHT_SUN,
            emission: [1.0; 3],
            direction: random.direction().as_vec3().to_array(),
            data: [(0.02f32 * (i as f32 + 1.0)).to_bits(), 0],
            ..Default::default()
        });
    }
    for i in 0..100u32 {
        let center = DVec3::new(random.unit(), random.unit(), random.unit()) * 4.0 - 2.0;
        let size = 10f64.powf(1.5 * random.unit() - 1.5);
        let light = if i % 2 == 0 {
            sphere(center, size)
        } else {
            let q = DQuat::from_rotation_arc(DVec3::Z, random.direction()) * DQuat::from_rotation_z(random.unit());
            rect(center, q, DVec2::new(size, 2.0 * size * random.unit()))
        };
        lit.lights.push(light);
        let reach = DVec3::splat(3.0 * size);
        boxes.push((20 + i, ((center - reach).as_vec3().to_array(), (center + reach).as_vec3().to_array())));
    }
    lit.set_powers(&[1.0; 120]);
    let mut tlas = build_tlas(&boxes);
    bake(&mut tlas.nodes, 0, 0);
    lit.scene.sun_count = 20;
    lit.scene.shapes_root = 0;
    lit.scene.shapes_indices = tlas.nodes.len() as u32;
    lit.nodes = tlas.nodes.into_iter().chain(tlas.indices).collect();
    lit
}

#[test]
fn rays_find_all_lights_on_their_way_and_no_other() {
    let Some(gpu) = gpu() else { return };
    let lit = many(gpu);
    let mut random = Random(4);
    let queries: Vec<Query> = (0..1 << 13)
        .map(|i| {
            let origin = DVec3::new(random.unit(), random.unit(), random.unit()) * 6.0 - 3.0;
            // The ray ends at a surface or is unbounded.
            let reach = if i % 2 == 0 { FAR } else { (3.0 * random.unit()) as f32 };
            let (point, direction) = (origin.as_vec3().to_array(), random.direction().as_vec3().normalize().to_array());
            Query { point, direction, reach, light: 20 + i % 100, mode: GIVEN, ..Default::default() }
        })
        .collect();
    let (mut met, mut unsure) = (0, 0);
    for (q, s) in queries.iter().zip(run(&lit, &queries, queries.len())) {
        for (id, light) in lit.lights.iter().enumerate() {
            let (t, margin) = oracle(light, wide(q.point), wide(q.direction));
            let stopped = t.is_some_and(|t| t > f64::from(q.reach));
            let near_end = t.is_some_and(|t| (t / f64::from(q.reach) - 1.0).abs() < 1e-4);
            if margin < 1e-4 || near_end {
                unsure += 1;
                continue;
            }
            let expected = t.is_some() && (!stopped || (light.kind == LIGHT_SUN && q.reach >= FAR));
            let is_met = s.mask[id / 32] >> (id % 32) & 1 == 1;
            assert_eq!(is_met, expected, "light {id} of kind {} by {q:?}", light.kind);
            met += u32::from(is_met);
            if id as u32 == q.light {
                assert_eq!(s.met == q.light, expected, "{q:?}: {s:?}");
                let reached = wide(q.point) + t.unwrap_or(0.0) * wide(q.direction);
                assert!(!expected || (wide(s.met_position) - reached).length() < 3e-3, "{q:?}: {s:?}, not {reached}");
            }
        }
    }
    eprintln!("{met} hits, {unsure} too close to an edge to tell");
    assert!(met > 10_000 && unsure < 20_000);
}

#[test]
fn area_lights_of_all_sizes_give_finite_samples() {
    let Some(gpu) = gpu() else { return };
    let mut lit = lights(gpu);
    let all_finite = |s: &Sample| {
        [s.pdf, s.distance, s.met_pdf].iter().chain(&s.radiance).chain(&s.wi).chain(&s.position).all(|x| x.is_finite())
    };
    for size in [1e-8, 1e-4, 1.0, 1e5] {
        lit.lights[1] = sphere(CENTER, size);
        lit.lights[2] = rect(CENTER, turn(), DVec2::new(size, size * 1e-3));
        // Sixteen samples per light.
        let mut queries = Vec::new();
        for at in [DVec3::ZERO, 0.5 * DVec3::X, DVec3::X, 1.0001 * DVec3::X, 30.0 * DVec3::Y, 1e6 * DVec3::Z] {
            let point = (CENTER + size * at).as_vec3().to_array();
            for i in 0..3 * 3 * 16 {
                let (light, mode) = (i / 48, i / 16 % 3);
                queries.push(Query { point, light, mode, seed: 3, reach: FAR, ..Default::default() });
            }
        }
        for (query, s) in queries.iter().zip(run(&lit, &queries, queries.len())) {
            assert!(all_finite(&s) && s.pdf >= 0.0, "size {size}: {query:?}: {s:?}");
        }
    }
}
