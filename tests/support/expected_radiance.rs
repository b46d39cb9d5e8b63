//! Renders a list of small scenes in one app and compares the radiance in the middle with a known value, for the reference tracer and
//! ReSTIR PT.  The camera looks down -Z through a window of 0.1 m.

use super::app::*;
use bevy::{camera::visibility::RenderLayers, prelude::*};
use bevy_restir::{Restir, RestirEnvironment, Technique};
use core::f32::consts::{PI, SQRT_2};

/// Spawns a scene into the empty app.
type Build = fn(&mut Rig);

/// (name, scene, mean radiance of the window, relative tolerance).
pub type Row = (&'static str, Build, f64, f64);

/// Tolerance of scenes without random choices: rounding only.
pub const EXACT: f64 = 2e-3;
/// Tolerance of scenes with random choices in every pixel of every frame: four standard errors of the noisiest row.  Random numbers depend
/// on the ids of objects, which may differ from run to run.
pub const NOISY: f64 = 0.05;

/// Few frames of many pixels: a frame costs as much as thousands of pixels.
const FRAMES: u32 = 12;
const SIZE: u32 = 48;

/// Renders all rows with the reference tracer.
pub fn check(rows: &[Row]) {
    check_with(Technique::Reference, &[rows]);
}

/// Renders all rows in one app, so that remains of one scene would show in the next.
pub fn check_with(technique: Technique, tables: &[&[Row]]) {
    let Some(mut rig) = Rig::new(SIZE, SIZE) else { return };
    let camera = rig.camera;
    rig.insert(camera, orthographic(0.1, 0.1));
    rig.set(|restir| *restir = Restir { technique, bounces: 2, accumulate: true, ..plain() });
    for (what, build, expected, tolerance) in tables.iter().copied().flatten() {
        build(&mut rig);
        let frames = if *tolerance == EXACT { 2 } else { FRAMES };
        let mean = rig.picture(frames).mean();
        let error = (mean - expected).abs();
        println!("{technique:?}, {what}: {mean:.5} for {expected:.5}");
        assert!(error <= tolerance * expected.max(0.01), "{technique:?}, {what}: {mean} instead of {expected}");
        clear(&mut rig);
    }
    rig.assert_sound();
}

/// Removes everything but the camera.
fn clear(rig: &mut Rig) {
    let world = rig.app.world_mut();
    let mut spawned = world.query_filtered::<Entity, (With<Transform>, Without<Restir>)>();
    for entity in spawned.iter(world).collect::<Vec<_>>() {
        // Children despawn with their parents.
        let _ = world.try_despawn(entity);
    }
    world.insert_resource(ClearColor(Color::BLACK));
    world.entity_mut(rig.camera).remove::<(RestirEnvironment, RenderLayers)>();
    rig.get_mut::<Camera>(rig.camera).clear_color = ClearColorConfig::Default;
}

pub fn at(x: f32, y: f32, z: f32) -> Transform {
    Transform::from_xyz(x, y, z)
}

/// Turned around, so that the camera sees the back.
pub fn turned(transform: Transform) -> Transform {
    transform.with_rotation(Quat::from_rotation_y(PI))
}

/// Turned around +Y.
pub fn turned_by(degrees: f32) -> Transform {
    Transform::from_rotation(Quat::from_rotation_y(degrees.to_radians()))
}

/// A square like [`square`] with normals that are turned around +Y.
pub fn leaning(side: f32, degrees: f32) -> Mesh {
    let normal = turned_by(degrees) * Vec3::Z;
    square(side).with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, vec![normal; 4])
}

/// Visible from both sides.
pub fn open(material: StandardMaterial) -> StandardMaterial {
    StandardMaterial { cull_mode: None, ..material }
}

/// A sun along -Z: a plane that faces the camera has radiance albedo · 2.
pub fn sun(rig: &mut Rig) -> Entity {
    rig.spawn_bundle((DirectionalLight { illuminance: 2.0 * PI, ..default() }, Transform::default()))
}

/// A sun from (1, 0, 1): the same plane also has radiance albedo · 2.
pub fn slanting_sun(rig: &mut Rig) -> Entity {
    rig.spawn_bundle((DirectionalLight { illuminance: 2.0 * SQRT_2 * PI, ..default() }, blind()))
}

/// A place in the path of the slanting sun: an object there shadows the middle of the plane and is invisible to the camera.
pub fn blind() -> Transform {
    at(1.0, 0.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y)
}

pub fn floor(rig: &mut Rig, albedo: f32) -> Entity {
    rig.spawn(square(4.0), lambert(albedo), Transform::default())
}

/// A lamp that emits on both sides.
pub fn both_sides(r: f32) -> StandardMaterial {
    StandardMaterial { double_sided: true, cull_mode: None, ..lamp(r, r, r) }
}

pub fn alpha(mode: AlphaMode, alpha: f32, material: StandardMaterial) -> StandardMaterial {
    StandardMaterial { alpha_mode: mode, base_color: material.base_color.with_alpha(alpha), ..material }
}

pub fn glass(ior: f32) -> StandardMaterial {
    StandardMaterial {
        specular_transmission: 1.0,
        thickness: 1.0,
        ior,
        perceptual_roughness: 0.0,
        reflectance: 0.5,
        ..Color::WHITE.into()
    }
}
