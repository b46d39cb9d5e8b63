//! Coats, anisotropy, diffuse transmission and thin walls, from `StandardMaterial` to the pixel: under a sun, each has the radiance of
//! the f64 oracle.

use crate::support::{agreement::assert_techniques_agree, app::*, oracle::bsdf::Material, stats::Random};
use bevy::prelude::*;
use bevy_restir::{Jitter, Restir, SceneFeatures, Technique};
use glam::DVec3;

const LUX: f32 = 10.0;

/// The oracle's parameters of a material on a plane with tangent, bitangent and normal along the axes of `turned`, seen along wo.
fn expected_material(m: &StandardMaterial, turned: Quat, wo: Vec3) -> Material {
    let wide = |v: Vec3| v.as_dvec3().normalize();
    let linear = |c: Color| Vec3::from(c.to_linear().to_f32_array_no_alpha()).as_dvec3();
    let (front, r) = (wo.dot(turned * Vec3::Z) > 0.0, f64::from(m.perceptual_roughness));
    let n = wide(if front { turned * Vec3::Z } else { turned * Vec3::NEG_Z });
    let (sin, cos) = m.anisotropy_rotation.sin_cos();
    let thin = m.thickness == 0.0;
    let ior = f64::from(m.ior);
    Material {
        n,
        n_geo: n,
        base: linear(m.base_color),
        f0_d: (linear(m.specular_tint) * f64::from(m.reflectance)).map(|x| 0.16 * x * x),
        metallic: m.metallic.into(),
        alpha: r * r,
        transmission: m.specular_transmission.into(),
        eta: if thin {
            1.0
        } else if front {
            ior
        } else {
            1.0 / ior
        },
        compensation: 0.0,
        thin,
        diffuse_transmission: m.diffuse_transmission.into(),
        // Counterclockwise from the tangent, seen from the front (`KHR_materials_anisotropy`).
        tangent: wide(turned * Vec3::new(cos, sin, 0.0)),
        alpha_along: r * r + (1.0 - r * r) * f64::from(m.anisotropy_strength).powi(2),
        coat: m.clearcoat.into(),
        coat_alpha: f64::from(m.clearcoat_perceptual_roughness).powi(2),
        coat_n: n,
        coat_compensation: 0.0,
        subsurface: DVec3::ZERO,
        entry_f0: DVec3::ZERO,
    }
}

fn materials() -> Vec<(&'static str, SceneFeatures, StandardMaterial)> {
    let base = StandardMaterial {
        base_color: Color::linear_rgb(0.8, 0.5, 0.3),
        perceptual_roughness: 0.6,
        double_sided: true,
        cull_mode: None,
        ..default()
    };
    let brushed = StandardMaterial { metallic: 1.0, anisotropy_strength: 0.7, ..base.clone() };
    let pane = StandardMaterial { specular_transmission: 1.0, reflectance: 0.8, ..base.clone() };
    const COAT: SceneFeatures = SceneFeatures::CLEARCOAT;
    const GRAIN: SceneFeatures = SceneFeatures::ANISOTROPY;
    const LEAF: SceneFeatures = SceneFeatures::DIFFUSE_TRANSMISSION;
    const THIN: SceneFeatures = SceneFeatures::THIN_WALL;
    const GLASS: SceneFeatures = SceneFeatures::TRANSMISSION;
    let all = StandardMaterial {
        clearcoat: 0.8,
        clearcoat_perceptual_roughness: 0.4,
        diffuse_transmission: 0.5,
        specular_transmission: 0.4,
        metallic: 0.2,
        anisotropy_rotation: -0.5,
        ..brushed.clone()
    };
    vec![
        ("plain", SceneFeatures::empty(), base.clone()),
        (
            "tint",
            SceneFeatures::empty(),
            StandardMaterial { specular_tint: Color::linear_rgb(1.0, 0.5, 0.0), ..base.clone() },
        ),
        ("coat", COAT, StandardMaterial { clearcoat: 0.9, clearcoat_perceptual_roughness: 0.5, ..base.clone() }),
        ("brushed", GRAIN, brushed.clone()),
        ("brushed in another direction", GRAIN, StandardMaterial { anisotropy_rotation: 0.6, ..brushed }),
        ("leaf", LEAF | THIN, StandardMaterial { diffuse_transmission: 0.7, ..base.clone() }),
        ("wax", LEAF, StandardMaterial { diffuse_transmission: 1.0, thickness: 0.1, ..base.clone() }),
        ("pane", GLASS | THIN, pane.clone()),
        ("glass", GLASS, StandardMaterial { thickness: 0.5, ior: 1.3, ..pane }),
        ("everything, thin", COAT | GRAIN | LEAF | GLASS | THIN, all.clone()),
        ("everything, thick", COAT | GRAIN | LEAF | GLASS, StandardMaterial { thickness: 0.2, ..all }),
    ]
}

#[test]
fn every_lobe_under_a_sun_equals_the_oracle() {
    let Some(mut rig) = Rig::new(4, 4) else { return };
    rig.insert(rig.camera, orthographic(0.2, 0.2));
    let sun = rig.spawn_bundle((DirectionalLight { illuminance: LUX, ..default() }, Transform::default()));
    let plane = rig.spawn(square(8.0), lambert(1.0), Transform::default());
    let wo = Vec3::Z;
    let mut r = Random(6);
    for (name, features, material) in materials() {
        let handle = rig.add::<StandardMaterial>(material.clone());
        rig.insert(plane, MeshMaterial3d(handle));
        let mut lit = 0;
        for i in 0..16 {
            // Seen from the front and from behind, lit from either side.
            let mut direction = || r.direction().as_vec3();
            let normal = (direction() + 1.5 * if i % 2 == 0 { Vec3::Z } else { Vec3::NEG_Z }).normalize();
            let turned = Quat::from_rotation_arc(Vec3::Z, normal) * Quat::from_rotation_z(f32::from(i as u8));
            let wi = direction();
            rig.insert(plane, Transform::from_rotation(turned));
            rig.insert(sun, Transform::default().looking_to(-wi, if wi.y.abs() > 0.9 { Vec3::X } else { Vec3::Y }));
            let seen = rig.picture(1).center().as_dvec3();
            let m = expected_material(&material, turned, wo);
            let expected = f64::from(LUX) * m.eval_all(wo.as_dvec3(), wi.as_dvec3().normalize());
            lit += u32::from(expected.max_element() > 1e-3);
            if [m.n.dot(DVec3::Z), m.n.dot(wi.as_dvec3())].iter().all(|c| c.abs() > 0.05) {
                let near = (seen - expected).abs().max_element() <= 5e-3 * expected.max_element() + 1e-5;
                assert!(near, "{name}, {i}: {seen}, not {expected}");
            }
        }
        let features = features | SceneFeatures::LIGHT_DIRECTIONAL;
        assert!(rig.until_ready().features.contains(features), "{name}");
        assert!(lit >= 3, "{name} is lit only {lit} times");
    }
    rig.assert_sound();
}

fn clear(tint: [f32; 3]) -> StandardMaterial {
    StandardMaterial {
        specular_transmission: 1.0,
        reflectance: 0.0,
        perceptual_roughness: 0.0,
        ..Color::linear_rgb(tint[0], tint[1], tint[2]).into()
    }
}

/// A lamp seen through a tilted pane.  The pane has an absorption distance, which must have no effect, since a thin wall has no inside.
#[test]
fn a_clear_pane_only_tints_the_surfaces_behind_it() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(0.9), lamp(5.0, 5.0, 5.0), Transform::from_xyz(0.2, 0.1, -1.0));
    let without = rig.picture(1);
    let pane =
        StandardMaterial { attenuation_color: Color::BLACK, attenuation_distance: 0.1, ..clear([0.9, 0.5, 0.25]) };
    rig.spawn(square(8.0), pane, Transform::from_rotation(Quat::from_rotation_y(0.7)));
    let with = rig.picture(1);
    for ((at, a), (_, b)) in without.iter().zip(with.iter()) {
        assert!((a * Vec3::new(0.9, 0.5, 0.25) - b).abs().max_element() < 1e-4, "{at}: {a} and {b}");
    }
    assert!(without.mean() > 0.1);
}

/// Behind a clear body, the way to the inside of an absorbing one is absorbed.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_clear_body_inside_of_an_absorbing_one_does_not_end_it() {
    let Some(mut rig) = Rig::new(4, 4) else { return };
    rig.insert(rig.camera, orthographic(0.4, 0.4));
    rig.spawn(square(6.0), lamp(4.0, 4.0, 4.0), Transform::from_xyz(0.0, 0.0, -2.0));
    let inner = StandardMaterial { thickness: 1.0, ior: 1.0, ..clear([1.0; 3]) };
    let outer = StandardMaterial {
        thickness: 2.0,
        attenuation_color: Color::linear_rgb(0.8, 0.5, 0.3),
        attenuation_distance: 1.0,
        ..inner.clone()
    };
    rig.spawn(Cuboid::from_length(2.0), outer, Transform::default());
    rig.spawn(Cuboid::from_length(1.0), inner, Transform::default());
    // Half a meter before the inner body, and half a meter behind it.
    let expected = 4.0 * Vec3::new(0.8, 0.5, 0.3);
    for technique in [Technique::Reference, Technique::Pt] {
        rig.set(|r| *r = Restir { technique, bounces: 8, accumulate: true, ..plain() });
        let picture = rig.picture(256);
        let seen = picture.iter().map(|(_, c)| c).sum::<Vec3>() / picture.iter().count() as f32;
        assert!((seen - expected).abs().max_element() < 0.1, "{technique:?}: {seen}, not {expected}");
    }
    rig.assert_sound();
}

/// A thin wall inside an absorbing body does not end the body.
#[test]
fn a_thin_wall_does_not_change_the_medium() {
    let Some(mut rig) = Rig::new(4, 4) else { return };
    rig.insert(rig.camera, orthographic(0.5, 0.5));
    rig.set(|r| r.bounces = 4);
    rig.spawn(square(6.0), lamp(4.0, 4.0, 4.0), Transform::from_xyz(0.0, 0.0, -2.0));
    let body = StandardMaterial {
        thickness: 2.0,
        ior: 1.0,
        attenuation_color: Color::linear_rgb(0.8, 0.5, 0.3),
        attenuation_distance: 1.0,
        ..clear([1.0; 3])
    };
    rig.spawn(Cuboid::from_length(2.0), body, Transform::default());
    let expected = 4.0 * Vec3::new(0.64, 0.25, 0.09);
    let seen = rig.picture(1).center();
    assert!((seen - expected).abs().max_element() < 1e-3, "{seen}, not {expected}");
    // With the pane there is a third event.  Roulette lets a path survive it with the probability of its greatest throughput, 0.64, and
    // divides its light by that.
    let (survival, survivor) = (0.64, expected / 0.64);
    for turned in [0.0, core::f32::consts::PI] {
        let pane =
            rig.spawn(square(1.5), clear([1.0; 3]), Transform::from_rotation(Quat::from_rotation_y(turned + 0.3)));
        let mut survived = 0.0;
        rig.until_ready();
        for seed in 1..=64 {
            // A change of the seed restarts the mean, so that each picture is one frame.
            rig.set(|r| r.seed = seed);
            for (_, seen) in rig.next().iter() {
                assert!(seen == Vec3::ZERO || (seen - survivor).abs().max_element() < 2e-3, "{seen}, not {survivor}");
                survived += f64::from(u8::from(seen != Vec3::ZERO)) / 1024.0;
            }
        }
        // The share of 1024 paths has a standard deviation of 0.015.
        assert!((survived - survival).abs() < 0.06, "{survived} survive");
        rig.app.world_mut().despawn(pane);
    }
}

/// In a uniform environment, objects that absorb nothing are invisible: a smooth coat over white, a white pane, a white leaf.
#[test]
fn white_lobes_are_invisible_in_a_white_environment() {
    let Some(mut rig) = Rig::new(12, 12) else { return };
    rig.set(|restir| (restir.bounces, restir.jitter) = (40, Jitter::Always));
    rig.insert(rig.camera, sky(1.0));
    let smooth = 0.0;
    let things = [
        ("coat", StandardMaterial { clearcoat: 1.0, clearcoat_perceptual_roughness: smooth, ..lambert(1.0) }),
        ("pane", StandardMaterial { reflectance: 0.5, ..clear([1.0; 3]) }),
        ("leaf", StandardMaterial { diffuse_transmission: 0.5, ..lambert(1.0) }),
    ];
    let ball = rig.spawn(Sphere::new(1.6).mesh().uv(32, 18), lambert(1.0), Transform::default());
    for (name, material) in things {
        let handle = rig.add::<StandardMaterial>(material);
        rig.insert(ball, MeshMaterial3d(handle));
        let mean = rig.picture(96).mean();
        assert!((mean - 1.0).abs() < 0.01, "{name}: {mean}");
    }
    rig.assert_sound();
}

/// Every parameter at its extremes in one scene: no technique raises a guard, and all agree.
#[test]
#[ignore = "second tier: ./run test --more"]
fn techniques_agree_on_lobes_with_extreme_parameters() {
    let Some(mut rig) = Rig::new(48, 48) else { return };
    rig.insert(rig.camera, sky(0.5));
    rig.insert(rig.camera, orthographic(8.0, 8.0));
    rig.spawn(square(3.0), lamp(1e4, 1e4, 1e4), Transform::from_xyz(2.0, 3.0, 3.0).looking_to(Vec3::ONE, Vec3::Y));
    let ball = rig.add::<Mesh>(Sphere::new(0.45).mesh().uv(20, 12));
    let mut r = Random(2);
    for i in 0..64 {
        let material = StandardMaterial {
            base_color: r.pick(&[Color::BLACK, Color::WHITE, Color::linear_rgb(1.0, 0.0, 0.5)]),
            metallic: r.pick(&[0.0, 0.0, 1.0]),
            perceptual_roughness: r.pick(&[0.0, 0.01, 0.0316, 0.033, 0.3, 1.0]),
            reflectance: r.pick(&[0.0, 0.5, 1.0]),
            clearcoat: r.pick(&[0.0, 1e-6, 1.0]),
            clearcoat_perceptual_roughness: r.pick(&[0.0, 0.0316, 0.033, 1.0]),
            anisotropy_strength: r.pick(&[0.0, 1e-3, 1.0]),
            anisotropy_rotation: r.pick(&[0.0, 1.0, 1e8]),
            diffuse_transmission: r.pick(&[0.0, 0.5, 1.0]),
            specular_transmission: r.pick(&[0.0, 0.5, 1.0]),
            thickness: r.pick(&[0.0, 0.0, 1e-30, 1.0]),
            ior: r.pick(&[1.0, 1.0001, 1.5, 10.0]),
            ..default()
        };
        let material = rig.add::<StandardMaterial>(material);
        let at = Vec3::new((i % 8) as f32 - 3.5, (i / 8) as f32 - 3.5, 0.0);
        // Some of them are mirrored and flattened.
        let scale = r.pick(&[Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0), Vec3::new(1.0, 1e-3, 1.0)]);
        let place = Transform::from_translation(at).with_scale(scale);
        rig.spawn_bundle((Mesh3d(ball.clone()), MeshMaterial3d(material), place));
    }
    rig.set(|r| (r.bounces, r.jitter, r.energy_compensation) = (6, Jitter::Always, true));
    assert_techniques_agree(&mut rig, "extreme lobes", 0.05);
    rig.assert_sound();
}

/// Every blending alpha mode makes a surface present with probability alpha.
#[test]
#[ignore = "second tier: ./run test --more"]
fn surfaces_of_every_blend_mode_are_present_with_probability_alpha() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    rig.spawn(square(2.0), lamp(2.0, 2.0, 2.0), Transform::from_xyz(0.0, 0.0, -1.0));
    let pane = rig.spawn(square(2.0), lambert(0.0), Transform::default());
    for alpha_mode in [AlphaMode::Blend, AlphaMode::Premultiplied, AlphaMode::Add] {
        let dark = StandardMaterial { alpha_mode, base_color: Color::linear_rgba(0.0, 0.0, 0.0, 0.3), ..lambert(0.0) };
        let dark = rig.add::<StandardMaterial>(dark);
        rig.insert(pane, MeshMaterial3d(dark));
        let mean = rig.picture(256).mean();
        assert!((mean - 1.4).abs() < 0.04, "{alpha_mode:?}: {mean}");
    }
}
