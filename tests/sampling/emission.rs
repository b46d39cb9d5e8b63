//! Rays that lights emit: points and directions follow their densities, their power is that of the closed forms, and a surface that a ray
//! meets knows the density of the ray.

use super::{
    analytic_area_lights::{CENTER, HALF, RADIUS, rect, rim, sphere, sun, turn},
    lights::{MIRRORED, corners, with_triangle},
};
use crate::support::{
    compose::{Def, flag},
    gpu::{Bound, Gpu, gpu, wide},
    light_scene::{IDENTITY, LightScene},
    oracle::environment::Map,
    stats::{Statistical, assert_family, chi_squared, z_test},
};
use bevy_restir::testing::gpu_layout::*;
use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

const SAMPLES: usize = 1 << 16;
/// The distance of the point that sees the light.
const DISTANCE: f32 = 1.7;
const SCENE_RADIUS: f32 = 3.0;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Ray {
    origin: [f32; 3],
    light: u32,
    direction: [f32; 3],
    delta: u32,
    power: [f32; 3],
    pdf_point: f32,
    normal: [f32; 3],
    pdf_direction: f32,
    density: f32,
    scale: f32,
    infinite: u32,
    start: f32,
}

/// A scene of one light.
struct Case<'g> {
    name: &'static str,
    lit: LightScene<'g>,
    defs: Vec<Def>,
    power: DVec3,
    /// Maps a ray to numbers that are uniform in [0, 1).
    uniform: Box<dyn Fn(&Ray) -> Vec<f64> + 'g>,
}

impl Case<'_> {
    /// The radius of a sphere, or half the width of a rectangle.
    fn extent(&self) -> f32 {
        f32::from_bits(self.lit.lights[0].data[0])
    }
}

fn emit(lit: &LightScene, defs: &[Def], seed: u32) -> Vec<Ray> {
    emit_to(lit, defs, seed, DISTANCE)
}

/// Rays, with the densities that a point at this distance knows.
fn emit_to(lit: &LightScene, defs: &[Def], seed: u32, distance: f32) -> Vec<Ray> {
    let query = lit.gpu.storage(&[seed, distance.to_bits()]);
    let rays = lit.gpu.zeroed::<Ray>(SAMPLES);
    let bound = [(2, 0, Bound::Buffer(&query)), (2, 1, Bound::Buffer(&rays))];
    lit.run("emission", include_str!("../support/kernels/emission.wgsl"), defs, SAMPLES as u32, &bound);
    lit.gpu.read(&rays)
}

/// The azimuth around an axis, over 2π.
fn turn_around(axis: DVec3, d: DVec3) -> f64 {
    let x = axis.any_orthonormal_vector();
    (d.dot(axis.cross(x)).atan2(d.dot(x)) / TAU).rem_euclid(1.0)
}

/// The two uniform numbers of a cosine-distributed direction: its squared cosine and its azimuth.
fn by_cosine(ray: &Ray) -> [f64; 2] {
    let (n, d) = (wide(ray.normal), wide(ray.direction));
    [n.dot(d).powi(2), turn_around(n, d)]
}

/// The point of the disk of a light at infinity.
fn on_disk(ray: &Ray) -> [f64; 2] {
    let d = wide(ray.direction);
    let across = (wide(ray.origin) - scene_center()).reject_from_normalized(d);
    [across.length_squared() / f64::from(SCENE_RADIUS).powi(2), turn_around(d, across.normalize())]
}

fn scene_center() -> DVec3 {
    DVec3::new(0.5, -1.0, 2.0)
}

fn with_light(gpu: &Gpu, light: GpuLight) -> LightScene<'_> {
    let mut lit = LightScene::new(gpu);
    lit.lights = vec![light];
    lit.set_powers(&[1.0]);
    lit
}

/// A point of a triangle: the share of its area nearer to the first corner, and the place across.
fn in_triangle(c: &[DVec3; 3], p: DVec3) -> [f64; 2] {
    let n = (c[1] - c[0]).cross(c[2] - c[0]);
    let u = (p - c[0]).cross(c[2] - c[0]).dot(n) / n.length_squared();
    let v = (c[1] - c[0]).cross(p - c[0]).dot(n) / n.length_squared();
    [(u + v).powi(2), v / (u + v)]
}

fn triangle<'g>(gpu: &'g Gpu, name: &'static str, lit: LightScene<'g>, sides: f64) -> Case<'g> {
    let _ = gpu;
    let c = corners(&lit).0;
    let area = (c[1] - c[0]).cross(c[2] - c[0]).length() / 2.0;
    let front = corners(&lit).1;
    let uniform = move |ray: &Ray| {
        let mut u = [in_triangle(&c, wide(ray.origin)), by_cosine(ray)].concat();
        if sides > 1.0 {
            u.push(if wide(ray.normal).dot(front) > 0.0 { 0.25 } else { 0.75 });
        }
        u
    };
    let power = sides * PI * area * DVec3::new(1.0, 2.0, 3.0);
    Case { name, lit, defs: vec![flag("LIGHT_TRIANGLES")], power, uniform: Box::new(uniform) }
}

/// The cumulative share of a spot's power up to a cosine, and its power for the intensity 1.
fn spot_share(inner: f64, outer: f64, cosine: f64) -> (f64, f64) {
    let ramp = |c: f64| ((c - outer) / (inner - outer)).clamp(0.0, 1.0).powi(3) * (inner - outer) / 3.0;
    let up_to = |c: f64| ramp(c) + (c - inner).max(0.0);
    (up_to(cosine) / up_to(1.0), TAU * up_to(1.0))
}

fn points(gpu: &Gpu) -> [Case<'_>; 2] {
    let intensity = DVec3::new(1.0, 2.0, 3.0);
    let point =
        GpuLight { kind: LIGHT_POINT, emission: [1.0, 2.0, 3.0], position: [1.0, 2.0, 3.0], ..Default::default() };
    let axis = DVec3::new(0.3, -0.9, 0.2).normalize();
    let (inner, outer) = (0.95f32, 0.7f32);
    let spot = GpuLight {
        kind: LIGHT_SPOT,
        direction: axis.as_vec3().to_array(),
        data: [inner.to_bits(), outer.to_bits()],
        ..point
    };
    let share = move |cosine| spot_share(inner.into(), outer.into(), cosine);
    [
        Case {
            name: "point",
            lit: with_light(gpu, point),
            defs: vec![flag("LIGHT_POINTS")],
            power: 4.0 * PI * intensity,
            uniform: Box::new(|ray| {
                let d = wide(ray.direction);
                vec![0.5 + 0.5 * d.z, turn_around(DVec3::Z, d)]
            }),
        },
        Case {
            name: "spot",
            lit: with_light(gpu, spot),
            defs: vec![flag("LIGHT_POINTS")],
            power: share(1.0).1 * intensity,
            uniform: Box::new(move |ray| {
                let d = wide(ray.direction);
                vec![share(d.dot(axis)).0, turn_around(axis, d)]
            }),
        },
    ]
}

fn area_lights(gpu: &Gpu) -> [Case<'_>; 2] {
    let radiance = DVec3::new(1.0, 2.0, 3.0);
    let shapes = || ["LIGHT_SPHERES", "LIGHT_RECTS", "SUN_DISK", "LIGHT_SHAPES"].map(flag).to_vec();
    [
        Case {
            name: "sphere",
            lit: with_light(gpu, sphere(CENTER, RADIUS)),
            defs: shapes(),
            power: PI * 4.0 * PI * RADIUS * RADIUS * radiance,
            uniform: Box::new(|ray| {
                let n = wide(ray.normal);
                assert!((wide(ray.origin) - CENTER - RADIUS * n).length() < 1e-5);
                [vec![0.5 + 0.5 * n.z, turn_around(DVec3::Z, n)], by_cosine(ray).to_vec()].concat()
            }),
        },
        Case {
            name: "rectangle",
            lit: with_light(gpu, rect(CENTER, turn(), HALF)),
            defs: shapes(),
            power: PI * 4.0 * HALF.x * HALF.y * radiance,
            uniform: Box::new(|ray| {
                let p = turn().inverse() * (wide(ray.origin) - CENTER);
                let at = 0.5 + 0.5 * DVec2::new(p.x, p.y) / HALF;
                assert!((wide(ray.normal) - turn() * DVec3::NEG_Z).length() < 1e-5 && p.z.abs() < 1e-5);
                [at.to_array().to_vec(), by_cosine(ray).to_vec()].concat()
            }),
        },
    ]
}

fn at_infinity(gpu: &Gpu) -> Vec<Case<'_>> {
    let disk = PI * f64::from(SCENE_RADIUS).powi(2);
    let radiance = DVec3::new(1.0, 2.0, 3.0);
    let axis = wide(sun().direction);
    let directional = GpuLight { kind: LIGHT_DIRECTIONAL, data: [0; 2], ..sun() };
    let mut sky = LightScene::new(gpu);
    sky.view.environment_color = [1.0, 2.0, 3.0];
    let mut with_map = LightScene::new(gpu);
    let map = Map::new(8, 4, |x, y| DVec3::new(1.0 + x as f64, 2.0, if (x, y) == (5, 1) { 40.0 } else { 0.5 }));
    with_map.set_map(&map, 16, 8);
    let flux = map_flux(&map);
    let mut all = vec![
        Case {
            name: "sun",
            lit: with_light(gpu, sun()),
            defs: vec![flag("SUN_DISK"), flag("LIGHT_SHAPES")],
            power: TAU * rim() * disk * radiance,
            uniform: Box::new(move |ray| {
                let d = wide(ray.direction);
                let share = 0.5 * (d - axis).length_squared() / rim();
                [vec![share, turn_around(axis, d)], on_disk(ray).to_vec()].concat()
            }),
        },
        Case {
            name: "directional",
            lit: with_light(gpu, directional),
            defs: vec![flag("LIGHT_DIRECTIONAL")],
            power: disk * radiance,
            uniform: Box::new(move |ray| {
                assert!((wide(ray.direction) - axis).length() < 1e-5);
                on_disk(ray).to_vec()
            }),
        },
        Case {
            name: "uniform environment",
            lit: sky,
            defs: vec![flag("ENVIRONMENT")],
            power: 4.0 * PI * disk * radiance,
            uniform: Box::new(|ray| {
                let d = wide(ray.direction);
                [vec![0.5 + 0.5 * d.z, turn_around(DVec3::Z, d)], on_disk(ray).to_vec()].concat()
            }),
        },
        Case {
            name: "environment map",
            lit: with_map,
            defs: vec![flag("ENVIRONMENT"), flag("ENVIRONMENT_MAP")],
            power: disk * flux,
            uniform: Box::new(|ray| on_disk(ray).to_vec()),
        },
    ];
    for case in &mut all {
        (case.lit.scene.radius, case.lit.scene.center) = (SCENE_RADIUS, scene_center().as_vec3().to_array());
    }
    all
}

/// Light paths begin a little outside of spheres and rectangles, so that surfaces that are nearer must not expect them.
#[test]
fn rays_of_area_lights_start_near_the_light_and_nearer_surfaces_expect_none() {
    let Some(gpu) = gpu() else { return };
    for mut case in area_lights(gpu) {
        for (scene_radius, expected) in [(SCENE_RADIUS, SCENE_RADIUS / 65536.0), (1e6, case.extent() / 256.0)] {
            case.lit.scene.radius = scene_radius;
            let near = &emit_to(&case.lit, &case.defs, 1, 0.9 * expected)[0];
            let far = &emit_to(&case.lit, &case.defs, 1, 1.1 * expected)[0];
            assert!((near.start / expected - 1.0).abs() < 1e-5, "{}: {near:?}", case.name);
            assert!(near.density == 0.0 && far.density > 0.0, "{}: {near:?} {far:?}", case.name);
        }
    }
}

/// The integral of radiance over all directions, by the midpoint rule.
fn map_flux(map: &Map) -> DVec3 {
    const N: usize = 512;
    let mut sum = DVec3::ZERO;
    for y in 0..N {
        let v = (y as f64 + 0.5) / N as f64;
        let area = 2.0 * PI * PI / (N * N) as f64 * (PI * v).sin();
        sum += (0..N).map(|x| map.at((x as f64 + 0.5) / N as f64, v)).sum::<DVec3>() * area;
    }
    sum
}

fn cases(gpu: &Gpu) -> Vec<Case<'_>> {
    let single = triangle(gpu, "triangle", with_triangle(gpu, IDENTITY, 0), 1.0);
    let double = triangle(gpu, "double-sided triangle", with_triangle(gpu, MIRRORED, MATERIAL_DOUBLE_SIDED), 2.0);
    [single, double].into_iter().chain(points(gpu)).chain(area_lights(gpu)).chain(at_infinity(gpu)).collect()
}

#[test]
fn emitted_rays_follow_their_densities() {
    let Some(gpu) = gpu() else { return };
    let cases = cases(gpu);
    assert_family(cases.iter().map(|case| -> Statistical {
        let test = |seed| {
            let rays = emit(&case.lit, &case.defs, seed);
            let dimensions = (case.uniform)(&rays[0]).len();
            // At most 4096 cells.
            let cells = [0, 64, 32, 12, 8, 4][dimensions];
            let mut counts = vec![0.0; usize::pow(cells, dimensions as u32)];
            for ray in &rays {
                let index = (case.uniform)(ray).into_iter().fold(0, |index, u| {
                    assert!((-1e-4..1.0001).contains(&u), "{}: {u} of {ray:?}", case.name);
                    index * cells + ((u * cells as f64) as usize).min(cells - 1)
                });
                counts[index] += 1.0;
            }
            if dimensions == 5 {
                // The last number is one of two.
                counts = counts.chunks(cells).flat_map(|side| [side[1], side[3]]).collect();
            }
            let expected = vec![SAMPLES as f64 / counts.len() as f64; counts.len()];
            chi_squared(&counts, &expected)
        };
        (case.name.into(), Box::new(test))
    }));
}

#[test]
fn emitted_rays_carry_the_power_of_their_lights() {
    let Some(gpu) = gpu() else { return };
    let cases = cases(gpu);
    assert_family(cases.iter().flat_map(|case| {
        (0..3).map(move |channel| -> Statistical {
            let test = move |seed| {
                let (mut sum, mut squares) = (0.0, 0.0);
                for ray in emit(&case.lit, &case.defs, seed) {
                    sum += f64::from(ray.power[channel]);
                    squares += f64::from(ray.power[channel]).powi(2);
                }
                z_test(sum, squares, SAMPLES as f64, case.power[channel])
            };
            (format!("{}, channel {channel}", case.name), Box::new(test))
        })
    }));
}

#[test]
fn surfaces_know_the_densities_of_the_rays_that_meet_them() {
    let Some(gpu) = gpu() else { return };
    for mut case in cases(gpu) {
        // A second light like the first one: the probability of a light must not count as a density of its points.
        if let Some(&light) = case.lit.lights.first() {
            case.lit.lights.push(light);
            case.lit.set_powers(&[1.0, 3.0]);
        }
        let d2 = f64::from(DISTANCE).powi(2);
        for ray in emit(&case.lit, &case.defs, 1).iter().take(4096) {
            let arriving = if ray.infinite != 0 { f64::from(ray.density) } else { f64::from(ray.density) * d2 };
            let emitted = f64::from(ray.pdf_direction);
            assert!((arriving / emitted - 1.0).abs() < 1e-3, "{}: {arriving} and not {emitted}: {ray:?}", case.name);
            // The solid angle of a sphere against its area as seen from the same point.
            let mut scale = 1.0;
            if case.name == "sphere" {
                let at = wide(ray.origin) + f64::from(DISTANCE) * wide(ray.direction);
                let sine2 = RADIUS * RADIUS / (at - CENTER).length_squared();
                let cone = TAU * (1.0 - (1.0 - sine2).sqrt());
                let cosine = wide(ray.normal).dot(wide(ray.direction));
                scale = 4.0 * PI * RADIUS * RADIUS * cosine / (d2 * cone);
            }
            assert!((f64::from(ray.scale) / scale - 1.0).abs() < 2e-3, "{}: {} and not {scale}", case.name, ray.scale);
            assert!(f64::from(ray.pdf_point).is_finite() && ray.light != NONE);
        }
    }
}

/// Several lights and a sky: each ray has the probability of its light.
#[test]
fn emitted_rays_of_many_lights_carry_the_power_of_all() {
    let Some(gpu) = gpu() else { return };
    let mut lit = with_light(gpu, sphere(CENTER, RADIUS));
    lit.lights.push(rect(CENTER, turn(), HALF));
    lit.lights.push(GpuLight { kind: LIGHT_POINT, emission: [1.0, 2.0, 3.0], ..Default::default() });
    let areas = [4.0 * PI * RADIUS * RADIUS, 4.0 * HALF.x * HALF.y];
    let powers = [PI * areas[0], PI * areas[1], 4.0 * PI];
    lit.set_powers(&powers);
    let sky = 4.0 * PI * PI;
    let defs = ["LIGHT_SPHERES", "LIGHT_RECTS", "LIGHT_SHAPES", "LIGHT_POINTS", "ENVIRONMENT"].map(flag);
    let expected = powers.iter().sum::<f64>() + sky;
    assert_family([("many".to_string(), {
        let test = |seed| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for ray in emit(&lit, &defs, seed) {
                sum += f64::from(ray.power[0]);
                squares += f64::from(ray.power[0]).powi(2);
            }
            z_test(sum, squares, SAMPLES as f64, expected)
        };
        Box::new(test) as Box<dyn Fn(u32) -> f64>
    })]);
}

#[test]
fn a_texture_scales_the_power_of_a_triangle() {
    let Some(gpu) = gpu() else { return };
    // 2x2 texels, nearest filter: red, black, blue, green.  The triangle's corners have the texture coordinates (0, 0), (1, 0), (0, 1).
    let mut lit = with_triangle(gpu, IDENTITY, 0);
    lit.table = vec![[0x10_0000 | 0x5_0000, 0, 2 | 2 << 16, 0]; 2];
    lit.atlas[0] = [255, 0, 0, 255];
    lit.atlas[1] = [0, 0, 0, 255];
    lit.atlas[4] = [0, 0, 255, 255];
    lit.atlas[5] = [0, 255, 0, 255];
    lit.materials[0].textures = SLOT_EMISSIVE;
    let c = corners(&lit).0;
    let area = (c[1] - c[0]).cross(c[2] - c[0]).length() / 2.0;
    let defs = [flag("LIGHT_TRIANGLES"), flag("TEXTURES")];
    // Half of the area is next to the first corner, a quarter at each of the other two.
    let shares = [0.5, 0.0, 0.25];
    assert_family((0..3).map(|channel| -> Statistical {
        let (lit, defs) = (&lit, &defs);
        let test = move |seed| {
            let (mut sum, mut squares) = (0.0, 0.0);
            for ray in emit(lit, defs, seed).iter().filter(|ray| ray.light != NONE) {
                sum += f64::from(ray.power[channel]);
                squares += f64::from(ray.power[channel]).powi(2);
            }
            z_test(sum, squares, SAMPLES as f64, PI * area * shares[channel] * [1.0, 2.0, 3.0][channel])
        };
        (format!("channel {channel}"), Box::new(test))
    }));
}
