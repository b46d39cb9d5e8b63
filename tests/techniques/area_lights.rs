//! Sphere and rectangle lights and suns with a disk, in whole scenes: their irradiance has its closed form, every ray except the camera's
//! hits them, they block no ray, and resampling them is unbiased.

use crate::support::{
    app::*,
    closed_form_plane::*,
    log,
    proof::{Indirect, Proof},
    reuse_settings::{di, paths},
    small_scenes::*,
};
use bevy::{
    light::{RectLight, SunDisk},
    prelude::*,
};
use bevy_restir::Jitter;
use bevy_restir::testing::plant_shader_defs;
use core::f64::consts::{FRAC_1_PI, PI};

fn ball(intensity: f32, radius: f32) -> PointLight {
    PointLight { intensity, radius, ..default() }
}

/// The intensity in candela for a luminous flux in lumens.
fn candela(lumens: f64) -> f64 {
    lumens / (4.0 * PI)
}

#[test]
fn a_sphere_light_lights_a_plane_like_a_point_at_its_center() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    let place = Vec3::new(0.5, -0.3, 1.5);
    let at = |z: f32| Transform::from_xyz(place.x, place.y, z);
    let expected = |z: f32| {
        move |p: Vec2| {
            let d = (place.with_z(z) - p.extend(0.0)).as_dvec3();
            candela(1000.0) * d.z / d.length().powi(3) * 0.6 * FRAC_1_PI
        }
    };
    let light = rig.spawn_bundle((ball(1000.0, 0.9), at(1.5).with_scale(Vec3::splat(7.0))));
    check_mean(&mut rig, 64, "ball", expected(1.5));
    // First a sphere around the camera, whose rays ignore it; then a tiny one.
    *rig.get_mut::<PointLight>(light) = ball(1000.0, 2.0);
    rig.insert(light, at(5.2));
    check_mean(&mut rig, 64, "around the camera", expected(5.2));
    *rig.get_mut::<PointLight>(light) = ball(1000.0, 1e-4);
    check_mean(&mut rig, 16, "tiny", expected(5.2));
    // Inside the sphere: π L / π.
    *rig.get_mut::<PointLight>(light) = ball(1000.0, 30.0);
    check_mean(&mut rig, 64, "within", |_| 0.6 * candela(1000.0) / (PI * 900.0));
    // Changed to radius 0: a point light again.
    *rig.get_mut::<PointLight>(light) = ball(1000.0, 0.0);
    check_mean(&mut rig, 1, "point", expected(5.2));
}

#[test]
fn a_rectangle_gives_its_form_factor_from_its_front_alone() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    // Luminous flux divided by π and area, with Bevy's scale; the light faces -Z without a rotation.
    let light = RectLight { intensity: 60.0 * PI as f32, width: 3.0, height: 1.0, ..default() };
    let place = Transform::from_xyz(0.5, -0.5, 5.5).with_scale(Vec3::new(1.0, 2.0, 5.0));
    let lamp = rig.spawn_bundle((light, place));
    let expected = |p: Vec2| {
        let p = p.as_dvec2();
        0.5 * 10.0 * form_factor([-1.0 - p.x, -1.5 - p.y], [2.0 - p.x, 0.5 - p.y], 5.5)
    };
    check_mean(&mut rig, 64, "rectangle", expected);
    // Mirrored it stays the same; rotated by half a turn it lights nothing.
    rig.get_mut::<Transform>(lamp).scale.x = -1.0;
    check_mean(&mut rig, 64, "mirrored", expected);
    rig.get_mut::<Transform>(lamp).rotation = Quat::from_rotation_x(core::f32::consts::PI);
    let dark = rig.picture(4);
    assert!(dark.iter().all(|(_, c)| c == Vec3::ZERO), "the back of a rectangle");
}

#[test]
fn the_disk_of_a_sun_gives_its_illuminance_and_a_disabled_disk_none() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    let rotation = Quat::from_euler(EulerRot::YXZ, 0.5, -0.4, 0.0);
    let cosine = f64::from(-(rotation * Vec3::NEG_Z).z);
    let light = DirectionalLight { illuminance: 12.0, ..default() };
    let sun = rig.spawn_bundle((light, SunDisk::EARTH, Transform::from_rotation(rotation)));
    let expected = |_: Vec2| 12.0 * cosine * 0.6 * FRAC_1_PI;
    check_mean(&mut rig, 16, "as seen from Earth", expected);
    rig.insert(sun, SunDisk { angular_size: 1.0, intensity: 3.0 });
    check_mean(&mut rig, 64, "a radian", expected);
    rig.insert(sun, SunDisk::OFF);
    check_mean(&mut rig, 1, "no disk", expected);
}

/// The radiance in the middle of a mirror behind the plane z = 0.
fn mirror(rig: &mut Rig) {
    let mirror = StandardMaterial { metallic: 1.0, perceptual_roughness: 0.0, ..Color::WHITE.into() };
    rig.spawn(square(1.0), mirror, Transform::default());
}

#[test]
fn every_ray_but_the_cameras_hits_all_area_lights_and_passes_through() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.insert(rig.camera, orthographic(0.4, 0.4));
    rig.insert(rig.camera, sky(0.5));
    let at = |z: f32| Transform::from_xyz(0.0, 0.0, z);
    // The lights stand in front of the camera, which does not see them, and in front of its mirror, which shows each of them once and the
    // backdrop.
    rig.spawn_bundle((ball(4.0 * PI as f32 * PI as f32, 1.0), at(3.0)));
    let seen = rig.picture(1).center().x;
    assert!((seen - 0.5).abs() < 1e-4, "the camera sees through a sphere: {seen}");
    mirror(&mut rig);
    let seen = rig.picture(1).center().x;
    assert!((seen - 1.5).abs() < 1e-3, "sphere and sky: {seen}");
    let rect = RectLight { intensity: 2.0 * PI as f32, width: 1.0, height: 1.0, ..default() };
    let rect = rig.spawn_bundle((rect, at(7.0)));
    let seen = rig.picture(1).center().x;
    assert!((seen - 3.5).abs() < 1e-3, "with a rectangle: {seen}");
    rig.spawn_bundle((ball(16.0 * PI as f32 * PI as f32, 2.0), at(4.0)));
    let seen = rig.picture(1).center().x;
    assert!((seen - 4.5).abs() < 1e-3, "with a sphere around the first: {seen}");
    let light = DirectionalLight { illuminance: (PI * 0.1f64.sin().powi(2)) as f32 * 8.0, ..default() };
    rig.spawn_bundle((light, SunDisk { angular_size: 0.2, intensity: 1.0 }, Transform::default()));
    let seen = rig.picture(1).center().x;
    assert!((seen - 12.5).abs() < 1e-2, "with a sun: {seen}");
    // From behind, a rectangle is invisible; behind a wall, everything is.
    rig.insert(rect, at(7.0).with_rotation(Quat::from_rotation_y(core::f32::consts::PI)));
    let seen = rig.picture(1).center().x;
    assert!((seen - 10.5).abs() < 1e-2, "with the rectangle turned away: {seen}");
    rig.spawn(square(4.0), lambert(0.0), at(6.5).with_rotation(Quat::from_rotation_y(core::f32::consts::PI)));
    let seen = rig.picture(1).center().x;
    assert!((seen - 2.0).abs() < 1e-2, "in front of a wall: {seen}");
    rig.set(|r| (r.technique, r.accumulate) = (bevy_restir::Technique::Di, true));
    let seen = rig.picture(2).center().x;
    assert!((seen - 2.0).abs() < 1e-2, "by ReSTIR DI: {seen}");
}

#[test]
fn area_lights_cast_no_shadow() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    rig.spawn_bundle((ball(1000.0, 0.0), Transform::from_xyz(0.0, 0.0, 4.0)));
    let alone = rig.picture(1);
    // The area lights are black, so that the point light is the only source.
    let black = Color::BLACK;
    rig.spawn_bundle((PointLight { color: black, ..ball(1.0, 0.5) }, Transform::from_xyz(0.0, 0.0, 2.0)));
    let rect = RectLight { color: black, width: 4.0, height: 4.0, ..default() };
    rig.spawn_bundle((rect, Transform::from_xyz(0.0, 0.0, 1.0)));
    assert_eq!(rig.picture(1).pixels, alone.pixels);
    let faint = |c: f32| Color::linear_rgb(c, c, c);
    let rect = RectLight { color: faint(1e-6), width: 4.0, height: 4.0, intensity: 1.0, ..default() };
    rig.spawn_bundle((rect, Transform::from_xyz(0.0, 0.0, 1.0)));
    rig.spawn_bundle((PointLight { color: faint(1e-6), ..ball(1.0, 0.5) }, Transform::from_xyz(0.0, 0.0, 2.0)));
    check_mean(&mut rig, 16, "behind a rectangle and a sphere", |p| {
        let d = (Vec3::new(0.0, 0.0, 4.0) - p.extend(0.0)).as_dvec3();
        candela(1000.0) * d.z / d.length().powi(3) * 0.6 * FRAC_1_PI
    });
}

#[test]
fn a_rectangle_light_in_the_plane_of_a_ceiling_shines() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.set(|r| r.bounces = 1);
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    // Tilted, so that the two planes round differently.
    let tilt = Quat::from_euler(EulerRot::XYZ, 0.3, -0.2, 0.1);
    let place = Transform::from_xyz(0.4, -0.3, 7.0).with_rotation(tilt);
    let ceiling = place.with_rotation(tilt * Quat::from_rotation_y(core::f32::consts::PI));
    let rect = RectLight { intensity: 100.0, width: 3.0, height: 3.0, ..default() };
    rig.spawn_bundle((rect, place));
    let free = rig.picture(64).mean();
    rig.spawn(square(9.0), lambert(0.0), ceiling);
    let covered = rig.picture(64).mean();
    assert!((covered / free - 1.0).abs() < 0.01, "{covered} in a ceiling, {free} without one");
}

#[test]
fn white_objects_inside_a_sphere_light_are_invisible() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.set(|r| (r.bounces, r.jitter) = (32, Jitter::Always));
    // Radiance 1 from all directions.
    rig.spawn_bundle((ball((4.0 * PI * PI) as f32 * 400.0, 20.0), Transform::default()));
    let thing = rig.spawn(Cuboid::from_length(9.0), lambert(1.0), Transform::from_xyz(0.0, 0.0, -4.0));
    check_mean(&mut rig, 64, "diffuse", |_| 1.0);
    let glossy = StandardMaterial { metallic: 1.0, perceptual_roughness: 0.0, ..Color::WHITE.into() };
    let glossy = rig.add::<StandardMaterial>(glossy);
    rig.insert(thing, MeshMaterial3d(glossy));
    check_mean(&mut rig, 8, "mirror", |_| 1.0);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_sampling_alone_and_bsdf_sampling_alone_give_the_same_mean_as_mis() {
    let Some(mut rig) = scene(24, |rig| {
        shapes(rig);
        // The lights are so large that BSDF samples hit them often.
        let (ball, rect, sun) = (rig.named("ball"), rig.named("rectangle"), rig.named("sun"));
        rig.get_mut::<PointLight>(ball).radius = 0.5;
        *rig.get_mut::<RectLight>(rect) = RectLight { intensity: 40.0, width: 1.6, height: 1.2, ..default() };
        rig.insert(sun, SunDisk { angular_size: 1.0, intensity: 1.0 });
    }) else {
        return;
    };
    // A mirror finds lights by BSDF samples in either case.
    let mut means = |def: &[&'static str]| {
        plant_shader_defs(&mut rig.app, def);
        let means: Vec<f64> = (0..8)
            .map(|seed| {
                rig.set(|r| (r.seed, r.bounces) = (seed, 1));
                rig.picture(48).mean()
            })
            .collect();
        mean_and_error(means)
    };
    let (both, error) = means(&[]);
    for def in ["TEST_LIGHTS_ALONE", "TEST_BSDF_ALONE"] {
        let (alone, error_alone) = means(&[def]);
        let (off, error) = (alone / both - 1.0, error.hypot(error_alone) / both);
        eprintln!("{def}: {off:.4} off, standard error {error:.4}");
        assert!(error < 0.008 && off.abs() < 4.0 * error + 1e-3, "{def}: {off} off, standard error {error}");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn resampled_direct_light_of_area_lights_equals_the_reference() {
    let Some(mut rig) = scene(64, shapes) else { return };
    Proof::of((12, 8), (12, 24)).check("shapes, direct", &mut rig, &[("both", di::all_reuse())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn resampled_paths_past_area_lights_equal_the_reference() {
    let Some(mut rig) = scene(64, shapes) else { return };
    let proof = Proof { bounces: 3, margin: 0.015, ..Proof::of((12, 8), (12, 24)) };
    proof.check("shapes, paths", &mut rig, &[("both", paths::all_reuse())]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_resampled_light_of_area_lights_equals_the_reference() {
    let Some(mut rig) = scene(64, shapes) else { return };
    let candidates = di::candidates_only();
    let proof = Proof { margin: 0.005, ..Proof::of((64, 16), (64, 64)) };
    proof.check("shapes, direct", &mut rig, &[("candidates", candidates), ("both", di::all_reuse())]);
    let candidates = paths::candidates_only();
    let proof = Proof { bounces: 3, margin: 0.007, ..Proof::of((64, 16), (64, 64)) };
    proof.check("shapes, paths", &mut rig, &[("candidates", candidates), ("both", paths::all_reuse())]);
    proof.check("shapes, indirect", &mut rig, &[("both", Indirect(di::all_reuse(), paths::all_reuse()))]);
    let proof = Proof { bounces: 2, pose: Some(&pose), ..Proof::of((160, 1), (40, 32)) };
    proof.check("moving shapes, paths", &mut rig, &[("both", paths::all_reuse())]);
}

/// The poses of all three lights at a step.
fn pose(rig: &mut Rig, step: u32) {
    let step = step as f32;
    let mut place = |name: &str, place: Transform| {
        let entity = rig.named(name);
        *rig.get_mut::<Transform>(entity) = place;
    };
    place("ball", Transform::from_xyz(0.2 + 0.2 * step, 0.5, 0.6 - 0.1 * step));
    let turned =
        Transform::from_xyz(1.1 - 0.2 * step, 0.9, 0.8).looking_at(Vec3::new(0.2 * step - 0.4, -0.6, -0.4), Vec3::Y);
    place("rectangle", turned);
    place("sun", Transform::from_rotation(Quat::from_euler(EulerRot::YXZ, 0.6 - 0.1 * step, -0.9 + 0.05 * step, 0.0)));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn moving_area_lights_light_from_their_current_position() {
    let Some(mut rig) = scene(64, shapes) else { return };
    let proof = Proof { margin: 0.015, pose: Some(&pose), ..Proof::of((96, 1), (24, 32)) };
    proof.check("moving shapes, direct", &mut rig, &[("both", di::all_reuse())]);
}

#[test]
fn edits_of_area_lights_end_in_the_picture_of_a_fresh_load() {
    let spawn = |rig: &mut Rig, x: f32, radius: f32| {
        rig.spawn(square(8.0), lambert(0.6), Transform::default());
        let a = rig.spawn_bundle((ball(100.0, radius), Transform::from_xyz(x, 0.4, 1.0)));
        let rect = RectLight { intensity: 100.0, width: radius, height: 1.0, ..default() };
        let b = rig.spawn_bundle((rect, Transform::from_xyz(-x, 0.4, 1.5)));
        (a, b)
    };
    let Some(mut fresh) = Rig::new(16, 16) else { return };
    spawn(&mut fresh, 0.7, 0.5);
    let wanted = fresh.picture(4);
    let Some(mut rig) = Rig::new(16, 16) else { return };
    let (a, b) = spawn(&mut rig, -0.3, 0.2);
    rig.picture(1);
    // One more light appears and disappears, and all three are moved and changed.
    let light = DirectionalLight { illuminance: 3.0, ..default() };
    let sun = rig.spawn_bundle((light, SunDisk { angular_size: 0.1, intensity: 1.0 }, Transform::default()));
    rig.frames(2);
    rig.insert(a, (ball(100.0, 0.5), Transform::from_xyz(0.7, 0.4, 1.0)));
    rig.frames(1);
    let rect = RectLight { intensity: 100.0, width: 0.5, height: 1.0, ..default() };
    rig.insert(b, (rect, Transform::from_xyz(-0.7, 0.4, 1.5)));
    rig.frames(1);
    rig.app.world_mut().despawn(sun);
    rig.frames(1);
    // Now they only move: the light table stays, and the tree that rays traverse is rebuilt.
    for x in [-1.5, 0.2, 0.7] {
        rig.get_mut::<Transform>(a).translation.x = x;
        rig.get_mut::<Transform>(b).translation.x = -x;
        rig.frames(1);
    }
    assert_eq!(rig.picture(4).pixels, wanted.pixels);
    // All of them are removed.
    rig.app.world_mut().despawn(a);
    rig.app.world_mut().despawn(b);
    assert!(rig.picture(1).iter().all(|(_, c)| c == Vec3::ZERO));
    // A still scene uploads nothing.
    let report = rig.until_ready();
    assert_eq!(report.uploaded_bytes, 0);
}

#[test]
fn area_lights_without_extent_give_a_warning_and_the_other_lights_stay() {
    log::listen();
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(20.0), lambert(0.6), Transform::default());
    rig.spawn_bundle((ball(1000.0, 0.0), Transform::from_xyz(0.0, 0.0, 4.0)));
    let alone = rig.picture(1);
    let (nan, infinite) = (f32::NAN, f32::INFINITY);
    for (width, height) in [(0.0, 1.0), (-1.0, 1.0), (1.0, nan), (infinite, 1.0)] {
        let rect = RectLight { width, height, intensity: 1e4, ..default() };
        let entity = rig.spawn_bundle((rect, Transform::from_xyz(0.0, 0.0, 2.0)));
        assert_eq!(rig.picture(1).pixels, alone.pixels, "a rectangle of {width} x {height}");
        rig.frames(3);
        let warnings = log::warnings(&format!("light {entity} has the size"));
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        rig.app.world_mut().despawn(entity);
    }
    for radius in [nan, -1.0, infinite] {
        let entity = rig.spawn_bundle((ball(1000.0, radius), Transform::from_xyz(0.0, 0.0, 4.0)));
        let doubled = rig.picture(8);
        assert!((doubled.mean() / alone.mean() - 2.0).abs() < 0.02, "a point light of radius {radius}");
        let warnings = log::warnings(&format!("light {entity} has the radius"));
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        rig.app.world_mut().despawn(entity);
    }
    let sun = DirectionalLight { illuminance: 10.0, ..default() };
    let light = rig.spawn_bundle((sun, Transform::default()));
    let lit = rig.picture(8).mean();
    for angular_size in [nan, -0.1, infinite] {
        rig.insert(light, SunDisk { angular_size, intensity: 1.0 });
        let picture = rig.picture(8);
        assert!((picture.mean() / lit - 1.0).abs() < 0.05 && picture.is_finite(), "a disk of {angular_size}");
    }
    assert_eq!(log::warnings(&format!("light {light} has a disk")).len(), 1);
    rig.assert_sound();
}
