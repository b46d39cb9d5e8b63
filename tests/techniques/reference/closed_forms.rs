//! The reference tracer in scenes with a closed-form solution.

use crate::support::{app::*, closed_form_plane::*};
use bevy::prelude::*;
use bevy_restir::Jitter;
use core::f64::consts::{FRAC_1_PI, PI};

/// A light that is sampled without a random choice has no noise: compares every pixel with the formula.
fn check_exact(rig: &mut Rig, name: &str, expected: impl Fn(Vec2) -> f64) {
    let picture = rig.picture(1);
    let (mut lit, mut greatest) = (0, 0.0f64);
    for (at, color) in picture.iter() {
        let wanted = expected(on_plane(picture.size, at));
        greatest = greatest.max(wanted);
        assert!(
            (f64::from(color.x) - wanted).abs() <= 2e-4 * wanted + 1e-6,
            "{name}: {} at {at}, not {wanted}",
            color.x
        );
        lit += (wanted > 0.0) as u32;
    }
    assert!(lit > 50 && greatest > 0.05, "{name}: {lit} pixels are lit, by at most {greatest}");
    rig.assert_sound();
}

#[test]
fn a_point_light_gives_i_cos_over_d_squared() {
    let Some(mut rig) = Rig::new(24, 20) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    let place = Vec3::new(0.5, -0.3, 1.5);
    // `range` is for rasterizers and must have no effect.
    let light = PointLight { intensity: 1000.0, range: 0.5, ..default() };
    let light = rig.spawn_bundle((light, Transform::from_translation(place)));
    let expected = |p: Vec2| {
        let d = (place - p.extend(0.0)).as_dvec3();
        1000.0 / (4.0 * PI) * d.z / d.length().powi(3) * 0.6 * FRAC_1_PI
    };
    check_exact(&mut rig, "point", expected);
    // The transform of a parent moves the light; its scale does not change it.
    let parent = rig.spawn_bundle((
        Transform::from_translation(place - Vec3::new(0.0, 0.0, 1.0)).with_scale(Vec3::new(1.0, 1.0, 0.5)),
        Visibility::default(),
    ));
    rig.app.world_mut().entity_mut(parent).add_child(light);
    rig.get_mut::<Transform>(light).translation = Vec3::new(0.0, 0.0, 2.0);
    check_exact(&mut rig, "point under a parent", expected);
    // Behind the plane, which shadows the light.
    rig.get_mut::<Transform>(parent).translation.z = -3.0;
    let dark = rig.picture(1);
    assert!(dark.iter().all(|(_, c)| c == Vec3::ZERO), "from behind");
}

#[test]
fn a_directional_light_gives_its_illuminance_times_the_cosine() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    let rotation = Quat::from_euler(EulerRot::YXZ, 0.7, -0.4, 0.0);
    rig.spawn_bundle((DirectionalLight { illuminance: 12.0, ..default() }, Transform::from_rotation(rotation)));
    let cosine = f64::from(-(rotation * Vec3::NEG_Z).z);
    check_exact(&mut rig, "sun", |_| 12.0 * cosine * 0.6 * FRAC_1_PI);
}

#[test]
fn a_spot_has_bevys_cone() {
    let Some(mut rig) = Rig::new(32, 24) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    let place = Transform::from_xyz(0.3, 0.2, 3.0).looking_at(Vec3::new(0.5, 0.0, 0.0), Vec3::Y);
    let (inner, outer) = (0.2f32, 0.45f32);
    rig.spawn_bundle((SpotLight { intensity: 1000.0, inner_angle: inner, outer_angle: outer, ..default() }, place));
    check_exact(&mut rig, "spot", |p| {
        let d = (place.translation - p.extend(0.0)).as_dvec3();
        let cosine = (-d.normalize()).dot(place.forward().as_vec3().as_dvec3());
        let (inner, outer) = (f64::from(inner).cos(), f64::from(outer).cos());
        let ramp = ((cosine - outer) / (inner - outer)).clamp(0.0, 1.0);
        1000.0 / (4.0 * PI) * ramp * ramp * d.z / d.length().powi(3) * 0.6 * FRAC_1_PI
    });
}

#[test]
fn an_emissive_rectangle_gives_its_form_factor_from_its_front_alone() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    // The lamp is behind the camera and faces the plane.
    let down = Transform::from_xyz(0.5, -0.5, 5.5).with_rotation(Quat::from_rotation_y(core::f32::consts::PI));
    let lamp_entity = rig.spawn(square(3.0), lamp(10.0, 10.0, 10.0), down);
    let expected = |p: Vec2| {
        let p = p.as_dvec2();
        0.5 * 10.0 * form_factor([-1.0 - p.x, -2.0 - p.y], [2.0 - p.x, 1.0 - p.y], 5.5)
    };
    check_mean(&mut rig, 64, "one-sided", expected);
    // Turned around it lights nothing; double-sided it does.
    rig.get_mut::<Transform>(lamp_entity).rotation = Quat::IDENTITY;
    let dark = rig.picture(4);
    assert!(dark.iter().all(|(_, c)| c == Vec3::ZERO), "the back of a lamp");
    let material = rig.material_of(lamp_entity);
    rig.edit(&material, |m| m.double_sided = true);
    check_mean(&mut rig, 64, "double-sided", expected);
}

#[test]
fn a_lamp_shows_its_radiance_in_front_and_black_behind_unless_double_sided() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.set(|restir| restir.bounces = 0);
    // Nothing is culled: the back is visible and black.
    let material = StandardMaterial { cull_mode: None, ..lamp(2.0, 3.0, 4.0) };
    let lamp = rig.spawn(square(6.0), material, Transform::default());
    let wall = rig.spawn(square(9.0), lambert(1.0), Transform::from_xyz(0.0, 0.0, -1.0));
    rig.spawn_bundle((PointLight::default(), Transform::from_xyz(0.0, 0.0, 3.0)));
    assert_eq!(rig.picture(1).center(), Vec3::new(2.0, 3.0, 4.0));
    rig.get_mut::<Transform>(lamp).rotation = Quat::from_rotation_y(core::f32::consts::PI);
    assert_eq!(rig.picture(1).center(), Vec3::ZERO, "behind");
    let handle = rig.material_of(lamp);
    rig.edit(&handle, |m| m.double_sided = true);
    assert_eq!(rig.picture(1).center(), Vec3::new(2.0, 3.0, 4.0), "double-sided");
    // Without a bounce, surfaces that do not emit are black, however much light they receive.
    rig.app.world_mut().despawn(lamp);
    assert_eq!(rig.picture(1).center(), Vec3::ZERO, "a lit wall without a bounce");
    rig.set(|restir| restir.bounces = 1);
    assert!(rig.picture(1).center().x > 0.0, "a lit wall with a bounce");
    rig.app.world_mut().despawn(wall);
    assert_eq!(rig.picture(1).center(), Vec3::ZERO, "nothing");
}

#[test]
fn unlit_materials_are_visible_to_the_camera_alone() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.set(|restir| restir.bounces = 4);
    let unlit = StandardMaterial { unlit: true, base_color: Color::linear_rgb(0.5, 0.25, 0.75), ..default() };
    let picture_of = rig.spawn(square(8.0), unlit, Transform::default());
    let seen = rig.picture(1).center();
    assert!((seen - Vec3::new(0.5, 0.25, 0.75)).length() < 1e-5, "{seen}");
    // The unlit square is behind the camera, in front of a mirror and a white wall; neither receives light from it.
    rig.insert(
        picture_of,
        Transform::from_xyz(0.0, 0.0, 8.0).with_rotation(Quat::from_rotation_y(core::f32::consts::PI)),
    );
    let mirror = StandardMaterial { metallic: 1.0, perceptual_roughness: 0.0, ..Color::WHITE.into() };
    rig.spawn(square(1.0), mirror, Transform::from_xyz(0.0, 0.0, 0.1));
    rig.spawn(square(8.0), lambert(1.0), Transform::default());
    assert!(rig.picture(4).iter().all(|(_, c)| c == Vec3::ZERO));
}

#[test]
fn an_environment_gives_albedo_times_radiance_to_a_plane() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(40.0), lambert(0.6), Transform::default());
    rig.insert(rig.camera, sky(2.0));
    check_mean(&mut rig, 64, "uniform", |_| 1.2);
    // The same with an image of one color and half the intensity.
    let image = rig.add::<Image>(texture(8, 4, |_, _| [255; 4]));
    rig.insert(rig.camera, bevy_restir::RestirEnvironment { image: Some(image), intensity: 0.5, ..sky(4.0) });
    check_mean(&mut rig, 64, "map", |_| 1.2);
}

#[test]
fn a_closed_furnace_gives_emission_over_one_minus_albedo() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.set(|restir| (restir.bounces, restir.jitter) = (64, Jitter::Always));
    let walls = |albedo: f32| StandardMaterial {
        emissive: LinearRgba::rgb(0.25, 0.25, 0.25),
        double_sided: true,
        cull_mode: None,
        ..lambert(albedo)
    };
    let box_of_walls = rig.spawn(Cuboid::from_length(4.0), walls(0.5), Transform::from_xyz(0.3, 0.2, 4.6));
    check_mean(&mut rig, 64, "box of 0.5", |_| 0.5);
    let bright = rig.add::<StandardMaterial>(walls(0.8));
    rig.insert(box_of_walls, MeshMaterial3d(bright.clone()));
    // The bounce limit drops 0.8^65 of the light: 5e-7.
    check_mean(&mut rig, 128, "box of 0.8", |_| 1.25);
    let ball = rig.add::<Mesh>(Sphere::new(2.0).mesh().uv(24, 16));
    rig.insert(box_of_walls, Mesh3d(ball));
    rig.edit(&bright, |m| *m = walls(0.5));
    check_mean(&mut rig, 64, "ball", |_| 0.5);
}

#[test]
fn white_objects_are_invisible_in_a_white_environment() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.set(|restir| (restir.bounces, restir.jitter) = (32, Jitter::Always));
    rig.insert(rig.camera, sky(1.0));
    let metal = |roughness| StandardMaterial { metallic: 1.0, perceptual_roughness: roughness, ..Color::WHITE.into() };
    let ball = rig.spawn(Sphere::new(1.6), metal(0.0), Transform::default());
    let mirror = rig.picture(2);
    assert!(mirror.iter().all(|(_, c)| (c - Vec3::ONE).abs().max_element() < 1e-4), "a mirror");
    let white = rig.add::<StandardMaterial>(lambert(1.0));
    rig.insert(ball, MeshMaterial3d(white));
    check_mean(&mut rig, 64, "diffuse", |_| 1.0);
    let glass = StandardMaterial {
        specular_transmission: 1.0,
        thickness: 1.0,
        perceptual_roughness: 0.0,
        ..Color::WHITE.into()
    };
    let glass = rig.add::<StandardMaterial>(glass);
    rig.insert(ball, MeshMaterial3d(glass));
    check_mean(&mut rig, 64, "glass", |_| 1.0);
    // Rough metal loses the light of multiple scattering; energy compensation restores it.
    let rough = rig.add::<StandardMaterial>(metal(0.9));
    rig.insert(ball, MeshMaterial3d(rough));
    let lossy = rig.picture(64).center().x;
    assert!(lossy < 0.95, "single scattering alone: {lossy}");
}

#[test]
fn a_lamp_in_glass_is_seen_with_its_radiance_over_n_squared() {
    let Some(mut rig) = Rig::new(12, 12) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    rig.set(|restir| restir.bounces = 1);
    let glass = StandardMaterial {
        specular_transmission: 1.0,
        thickness: 1.0,
        ior: 1.5,
        perceptual_roughness: 0.0,
        ..Color::WHITE.into()
    };
    rig.spawn(Cuboid::from_length(2.0), glass, Transform::default());
    rig.spawn(square(1.8), lamp(9.0, 9.0, 9.0), Transform::default());
    // At normal incidence through one interface: (1 - 0.04)/1.5² of the radiance.
    check_mean(&mut rig, 128, "lamp in glass", |_| 9.0 * 0.96 / 2.25);
}
