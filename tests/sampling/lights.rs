//! Samples of every kind of light follow their densities and average to the irradiance.

use crate::support::{
    compose::{CAPABILITIES, Def, compose, composer, flag},
    gpu::{Bound, Gpu, gpu, wide},
    light_scene::{IDENTITY, LightScene},
    stats::{Statistical, assert_family, chi_squared, failures_of_family, z_test},
};
use bevy_restir::testing::gpu_layout::{
    GpuInstance, GpuLight, GpuMaterial, LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT, LIGHT_TRIANGLE,
    MATERIAL_ALPHA_BLEND, MATERIAL_ALPHA_MASK, MATERIAL_DOUBLE_SIDED, NONE, Rows, SLOT_BASE_COLOR, SLOT_EMISSIVE,
};
use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

const SAMPLES: usize = 1 << 16;

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
    hit_pdf: f32,
    pad: f32,
}

fn sample(lit: &LightScene, light: u32, point: DVec3, seed: u32, count: usize, defs: &[Def]) -> Vec<Sample> {
    let all = ["LIGHT_TRIANGLES", "LIGHT_POINTS", "LIGHT_DIRECTIONAL", "ENVIRONMENT"].map(flag);
    let defs: Vec<_> = all.into_iter().chain(defs.iter().copied()).collect();
    let p = point.as_vec3();
    let query = lit.gpu.storage(&[p.x.to_bits(), p.y.to_bits(), p.z.to_bits(), light, seed, 0, 0, 0]);
    let samples = lit.gpu.zeroed::<Sample>(count);
    let bound = [(2, 0, Bound::Buffer(&query)), (2, 1, Bound::Buffer(&samples))];
    lit.run("light_sample", include_str!("../support/kernels/light_sample.wgsl"), &defs, count as u32, &bound);
    lit.gpu.read(&samples)
}

pub(super) const MIRRORED: Rows = [[-2.0, 0.3, 0.0, 0.5], [0.0, 1.5, 0.2, 3.0], [0.1, 0.0, 0.7, -1.0]];

/// A scene of one emissive triangle with radiance (1, 2, 3).
pub(super) fn with_triangle(gpu: &Gpu, rows: Rows, flags: u32) -> LightScene<'_> {
    let mut lit = LightScene::new(gpu);
    lit.set_triangle([[0.0, 1.0, 0.0], [1.0, 1.2, 0.1], [0.2, 0.9, 1.3]]);
    lit.instances = vec![GpuInstance {
        world_from_object: rows,
        first_light: 0,
        triangle_count: 1,
        flags: u32::from(rows != IDENTITY),
        ..Default::default()
    }];
    lit.materials = vec![GpuMaterial { emissive: [1.0, 2.0, 3.0], flags, ..Default::default() }];
    lit.lights = vec![GpuLight { kind: LIGHT_TRIANGLE, emission: [1.0, 2.0, 3.0], ..Default::default() }];
    lit.set_powers(&[1.0]);
    lit
}

/// The corners and the front-facing normal in world space.
pub(super) fn corners(lit: &LightScene) -> ([DVec3; 3], DVec3) {
    let m = lit.instances[0].world_from_object.map(|r| r.map(f64::from));
    let linear = DMat3::from_cols_array_2d(&[
        [m[0][0], m[0][1], m[0][2]],
        [m[1][0], m[1][1], m[1][2]],
        [m[2][0], m[2][1], m[2][2]],
    ])
    .transpose();
    let offset = DVec3::new(m[0][3], m[1][3], m[2][3]);
    let [a, b, c] = [0, 1, 2].map(|i| wide(lit.vertices[i].position));
    let normal = linear.inverse().transpose() * (b - a).cross(c - a);
    ([a, b, c].map(|p| linear * p + offset), normal.normalize())
}

/// Irradiance divided by radiance, for a triangle that lies entirely above the plane of the receiver (Lambert 1760).
fn form_factor(corners: [DVec3; 3], point: DVec3, normal: DVec3) -> f64 {
    let d = corners.map(|c| (c - point).normalize());
    let edge = |i: usize| {
        let (a, b) = (d[i], d[(i + 1) % 3]);
        a.angle_between(b) * a.cross(b).normalize().dot(normal)
    };
    ((edge(0) + edge(1) + edge(2)) / 2.0).abs()
}

/// A point and a normal from which one side of the light is entirely visible, and whether that is the front.
fn receivers(lit: &LightScene) -> [(DVec3, DVec3, bool); 3] {
    let (c, n) = corners(lit);
    let center = (c[0] + c[1] + c[2]) / 3.0;
    let side = (c[1] - c[0]).normalize();
    let of = |p: DVec3, front: bool| (p, (center - p).normalize(), front);
    [of(center + 2.0 * n, true), of(center + 0.4 * n + 1.5 * side, true), of(center - 1.5 * n, false)]
}

#[test]
fn triangle_samples_are_points_of_the_triangle() {
    let Some(gpu) = gpu() else { return };
    for rows in [IDENTITY, MIRRORED] {
        let lit = with_triangle(gpu, rows, 0);
        let (c, n) = corners(&lit);
        let area = (c[1] - c[0]).cross(c[2] - c[0]).length() / 2.0;
        for (point, _, front) in receivers(&lit) {
            for s in sample(&lit, 0, point, 1, 1 << 10, &[]) {
                let [u, v] = s.barycentrics.map(f64::from);
                let p = c[0] + u * (c[1] - c[0]) + v * (c[2] - c[0]);
                let d = p - point;
                let pdf = d.length_squared() / ((d.normalize().dot(n)).abs() * area);
                assert!((wide(s.position) - p).length() < 1e-5 && (wide(s.wi) - d.normalize()).length() < 1e-5);
                assert!((f64::from(s.distance) - d.length()).abs() < 1e-5 && (wide(s.normal) - n).length() < 1e-5);
                assert!((f64::from(s.pdf) / pdf - 1.0).abs() < 1e-4, "{s:?}, not {pdf}");
                assert_eq!(
                    s.pdf.to_bits(),
                    s.hit_pdf.to_bits(),
                    "a hit and a sample of the same point have different densities"
                );
                assert_eq!(s.radiance, if front { [1.0, 2.0, 3.0] } else { [0.0; 3] });
                assert!(s.delta == 0 && s.light == 0);
            }
        }
    }
}

#[test]
fn triangle_samples_are_uniform_in_area() {
    let Some(gpu) = gpu() else { return };
    const CUTS: usize = 8;
    let lit = with_triangle(gpu, MIRRORED, 0);
    let lit = &lit;
    assert_family([("uniform".to_string(), {
        let test = move |seed: u32| {
            // CUTS² congruent triangles.
            let mut counts = vec![0.0; CUTS * CUTS * 2];
            for s in sample(lit, 0, DVec3::ZERO, seed, SAMPLES, &[]) {
                let [u, v] = s.barycentrics.map(|b| b * CUTS as f32);
                let upper = usize::from(u.fract() + v.fract() > 1.0);
                counts[((u as usize).min(CUTS - 1) * CUTS + (v as usize).min(CUTS - 1)) * 2 + upper] += 1.0;
            }
            let inside = |i: usize| i / 2 / CUTS + i / 2 % CUTS + i % 2 < CUTS;
            assert!(counts.iter().enumerate().all(|(i, c)| inside(i) || *c < 3.0), "outside of the triangle");
            let counts: Vec<_> = (0..counts.len()).filter(|i| inside(*i)).map(|i| counts[i]).collect();
            chi_squared(&counts, &vec![SAMPLES as f64 / (CUTS * CUTS) as f64; CUTS * CUTS])
        };
        Box::new(test) as Box<dyn Fn(u32) -> f64>
    })]);
}

fn irradiance_tests<'a>(lit: &'a LightScene, defs: &'a [Def]) -> Vec<Statistical<'a>> {
    let two_sided = lit.materials[0].flags & MATERIAL_DOUBLE_SIDED != 0;
    receivers(lit)
        .into_iter()
        .map(|(point, normal, front)| {
            let exact = if front || two_sided { 2.0 * form_factor(corners(lit).0, point, normal) } else { 0.0 };
            let test = move |seed: u32| {
                let (mut sum, mut squares) = (0.0, 0.0);
                for s in sample(lit, 0, point, seed, SAMPLES, defs) {
                    let e = f64::from(s.radiance[1]) * wide(s.wi).dot(normal).max(0.0) / f64::from(s.pdf);
                    sum += e;
                    squares += e * e;
                }
                z_test(sum, squares, SAMPLES as f64, exact)
            };
            (format!("irradiance at {point}"), Box::new(test) as Box<dyn Fn(u32) -> f64>)
        })
        .collect()
}

#[test]
fn triangle_samples_average_to_the_form_factor() {
    let Some(gpu) = gpu() else { return };
    let lit = [
        with_triangle(gpu, IDENTITY, 0),
        with_triangle(gpu, MIRRORED, 0),
        with_triangle(gpu, MIRRORED, MATERIAL_DOUBLE_SIDED),
    ];
    assert_family(lit.iter().flat_map(|lit| irradiance_tests(lit, &[])));
}

#[test]
fn a_density_wrong_by_three_percent_is_found() {
    let Some(gpu) = gpu() else { return };
    let lit = with_triangle(gpu, IDENTITY, MATERIAL_DOUBLE_SIDED);
    let defs = [flag("PLANTED")];
    assert_eq!(failures_of_family(irradiance_tests(&lit, &defs)).len(), 3);
}

/// The texture scales emission, and alpha removes it.
#[test]
fn texture_and_alpha_scale_emission() {
    let Some(gpu) = gpu() else { return };
    // 2x2 texels, nearest filter: red, fully transparent, blue with low alpha, green.
    let slot = [0x10_0000 | 0x5_0000, 0, 2 | 2 << 16, 0];
    let mut lit = with_triangle(gpu, IDENTITY, 0);
    lit.table = vec![slot; 2];
    lit.atlas[0] = [255, 0, 0, 255];
    lit.atlas[1] = [0, 0, 0, 255];
    lit.atlas[4] = [0, 0, 255, 51];
    lit.atlas[5] = [0, 255, 0, 255];
    let (point, ..) = receivers(&lit)[0];
    for (flags, low, color) in [(0, 1.0, 1.0), (MATERIAL_ALPHA_MASK, 0.0, 0.5), (MATERIAL_ALPHA_BLEND, 0.1, 0.5)] {
        lit.materials[0] = GpuMaterial {
            emissive: [1.0, 2.0, 3.0],
            textures: SLOT_EMISSIVE | if flags == 0 { 0 } else { SLOT_BASE_COLOR },
            alpha: if flags == 0 { 0.1 } else { 0.5 },
            alpha_cutoff: 0.4,
            flags,
            ..Default::default()
        };
        for s in sample(&lit, 0, point, 1, 1 << 10, &[flag("TEXTURES"), flag("ALPHA")]) {
            let presence = match flags {
                0 => 1.0,
                MATERIAL_ALPHA_MASK => 1.0,
                _ => color,
            };
            let expected = match s.barycentrics.map(|b| b > 0.5) {
                [false, false] => [presence, 0.0, 0.0],
                [false, true] => [0.0, 0.0, 3.0 * low],
                [true, false] => [0.0; 3],
                [true, true] => [0.0, 2.0 * presence, 0.0],
            };
            let near = (wide(s.radiance) - wide(expected)).length() < 1e-5;
            assert!(near || s.barycentrics.iter().any(|b| (b - 0.5).abs() < 1e-5), "{flags}: {s:?}, not {expected:?}");
        }
    }
}

#[test]
fn points_spots_and_suns_follow_their_closed_forms() {
    let Some(gpu) = gpu() else { return };
    let mut lit = LightScene::new(gpu);
    let light = |kind| GpuLight { position: [1.0, 2.0, 3.0], emission: [10.0, 20.0, 30.0], kind, ..Default::default() };
    let spot = |inner: f32, outer: f32| GpuLight {
        direction: [0.0, -1.0, 0.0],
        data: [inner.cos().to_bits(), outer.cos().to_bits()],
        ..light(LIGHT_SPOT)
    };
    lit.lights = vec![
        light(LIGHT_POINT),
        spot(0.2, 0.6),
        spot(0.5, 0.5),
        GpuLight { direction: [0.6, -0.8, 0.0], ..light(LIGHT_DIRECTIONAL) },
    ];
    lit.set_powers(&[1.0; 4]);
    for point in [DVec3::ZERO, DVec3::new(1.0, -1.0, 3.0), DVec3::new(2.0, -1.0, 3.5), DVec3::new(1.0, 5.0, 3.0)] {
        let d = DVec3::new(1.0, 2.0, 3.0) - point;
        let one = |light: u32| sample(&lit, light, point, 0, 64, &[])[7];
        for (light, inner, outer) in [(0, 7.0, 8.0), (1, 0.2f64, 0.6f64), (2, 0.5, 0.5)] {
            let s = one(light);
            // Bevy: saturate((cos - cos outer) / max(cos inner - cos outer, 1e-4))².
            let ramp = (d.normalize().y - outer.cos()) / (inner.cos() - outer.cos()).max(1e-4);
            let cone = if light == 0 { 1.0 } else { ramp.clamp(0.0, 1.0).powi(2) };
            let expected = 20.0 * cone / d.length_squared();
            assert!(
                (f64::from(s.radiance[1]) - expected).abs() < 1e-4 * expected + 1e-7,
                "{light}: {s:?}, not {expected}"
            );
            assert!(s.pdf == 1.0 && s.delta == 1 && (wide(s.wi) - d.normalize()).length() < 1e-6);
            assert!((f64::from(s.distance) - d.length()).abs() < 1e-5 && s.normal == [0.0; 3] && s.light == light);
        }
        let s = one(3);
        assert!(s.radiance == [10.0, 20.0, 30.0] && s.wi == [-0.6, 0.8, 0.0] && s.distance > 1e38 && s.delta == 1);
    }
}

#[test]
fn impossible_samples_are_zero() {
    let Some(gpu) = gpu() else { return };
    let mut lit = with_triangle(gpu, IDENTITY, MATERIAL_DOUBLE_SIDED);
    lit.lights.push(GpuLight { kind: LIGHT_POINT, emission: [1.0; 3], ..Default::default() });
    lit.set_powers(&[1.0, 1.0]);
    let all_finite = |s: &Sample| {
        [s.pdf, s.distance].iter().chain(&s.radiance).chain(&s.wi).chain(&s.position).all(|x| x.is_finite())
    };
    // Receivers in the plane of the light, on a corner of it, at the point light; and lights that do not exist.
    lit.set_triangle([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
    for (light, point) in [(0, DVec3::new(5.0, 0.0, 0.0)), (1, DVec3::ZERO), (2, DVec3::ONE), (NONE, DVec3::ONE)] {
        let samples = sample(&lit, light, point, 1, 256, &[]);
        assert!(
            samples.iter().all(|s| all_finite(s) && s.pdf == 0.0 && s.radiance == [0.0; 3]),
            "{light} from {point}"
        );
    }
    assert!(sample(&lit, 0, DVec3::ZERO, 1, 256, &[]).iter().all(all_finite));
    // A triangle without area, and tiny and huge ones.
    for scale in [0.0, 1e-6, 1e6f32] {
        lit.set_triangle([[0.0; 3], [scale, 0.0, 0.0], [0.0, 0.0, scale]]);
        for s in sample(&lit, 0, DVec3::new(0.0, f64::from(scale) + 1e-3, 0.0), 1, 256, &[]) {
            assert!(all_finite(&s) && (s.pdf > 0.0) == (scale > 0.0), "{scale}: {s:?}");
        }
    }
}

#[test]
fn lights_and_lobes_compose_with_every_set_of_features() {
    const NAMES: [&str; 7] =
        ["LIGHT_TRIANGLES", "LIGHT_POINTS", "LIGHT_DIRECTIONAL", "ENVIRONMENT", "ENVIRONMENT_MAP", "TEXTURES", "ALPHA"];
    let mut composer = composer();
    let mut check = |name: &str, source: &str, defs: &[Def]| {
        let module = compose(&mut composer, name, source, defs);
        let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::all(), CAPABILITIES);
        let info = validator.validate(&module).unwrap_or_else(|e| panic!("{name} {defs:?}: {e:?}"));
        naga::back::spv::write_vec(&module, &info, &Default::default(), None).expect("SPIR-V");
        naga::back::msl::write_string(&module, &info, &Default::default(), &Default::default()).expect("MSL");
    };
    for set in 0..1u32 << NAMES.len() {
        let defs: Vec<Def> =
            NAMES.iter().enumerate().filter(|(i, _)| set >> i & 1 == 1).map(|(_, n)| flag(n)).collect();
        check("light_sample", include_str!("../support/kernels/light_sample.wgsl"), &defs);
        if set < 32 {
            check("light_select", include_str!("../support/kernels/light_select.wgsl"), &defs);
        }
    }
    for defs in [&[][..], &[flag("TRANSMISSION")]] {
        check("bsdf_sample", include_str!("../support/kernels/bsdf_sample.wgsl"), defs);
    }
}
