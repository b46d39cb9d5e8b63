//! ReSTIR PT in a room that is lit through a door ajar, so that most light arrives after several bounces. It shows glossy, mirroring
//! and glass objects. Space swings the door.
//!
//! `cargo run -p bevy_restir_apps --bin path_tracing`

use bevy::{camera::Exposure, prelude::*};
use bevy_restir::prelude::*;
use bevy_restir_apps::{look::look, window};
use std::f32::consts::{FRAC_PI_2, PI};

fn main() -> AppExit {
    window::app("path tracing", UVec2::new(1280, 720), "Space (held): swing the door", RayBackend::Auto)
        .add_systems(Startup, setup)
        .add_systems(Update, swing)
        .run()
}

/// Hinged at its left edge.
#[derive(Component)]
struct Door;

fn setup(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
    let mut plaster =
        |color: Color| materials.add(StandardMaterial { base_color: color, reflectance: 0.2, ..default() });
    let (white, wood, teal) = (
        plaster(Color::srgb(0.85, 0.83, 0.8)),
        plaster(Color::srgb(0.55, 0.35, 0.2)),
        plaster(Color::srgb(0.2, 0.5, 0.5)),
    );
    let metal = |color, perceptual_roughness| StandardMaterial {
        base_color: color,
        metallic: 1.0,
        perceptual_roughness,
        ..default()
    };
    let mirror = materials.add(metal(Color::srgb(0.95, 0.95, 0.95), 0.0));
    let copper = materials.add(metal(Color::srgb(0.95, 0.64, 0.54), 0.25));
    let glass = materials.add(StandardMaterial {
        specular_transmission: 1.0,
        ior: 1.5,
        perceptual_roughness: 0.0,
        thickness: 1.0,
        ..default()
    });
    let lamp = materials.add(StandardMaterial { emissive: LinearRgba::rgb(2000.0, 1750.0, 1350.0), ..default() });

    // The room of 4 x 3 x 5 m has the door in its far wall. The lamp hangs 1.3 m behind the door.
    let mut block = |size: Vec3, place: Vec3, material: &Handle<StandardMaterial>| {
        let mesh = Mesh3d(meshes.add(Cuboid::from_size(size)));
        commands.spawn((mesh, MeshMaterial3d(material.clone()), Transform::from_translation(place))).id()
    };
    block(Vec3::new(8.0, 0.1, 9.0), Vec3::new(0.0, -0.05, -1.0), &white);
    block(Vec3::new(8.0, 0.1, 9.0), Vec3::new(0.0, 3.05, -1.0), &white);
    block(Vec3::new(0.1, 3.0, 9.0), Vec3::new(-2.05, 1.5, -1.0), &teal);
    block(Vec3::new(0.1, 3.0, 9.0), Vec3::new(2.05, 1.5, -1.0), &white);
    block(Vec3::new(2.4, 3.0, 0.1), Vec3::new(-0.8, 1.5, -2.5), &white);
    block(Vec3::new(0.6, 3.0, 0.1), Vec3::new(1.7, 1.5, -2.5), &white);
    block(Vec3::new(1.0, 0.9, 0.1), Vec3::new(0.9, 2.55, -2.5), &white);
    block(Vec3::new(8.0, 3.0, 0.1), Vec3::new(0.0, 1.5, -5.0), &white);
    block(Vec3::new(1.0, 0.05, 1.0), Vec3::new(0.6, 2.9, -3.8), &lamp);
    // A table, a mirror on the wall, and two balls on the table.
    block(Vec3::new(1.6, 0.08, 0.9), Vec3::new(-0.8, 0.7, -1.2), &wood);
    for (x, z) in [(-1.5, -1.55), (-0.1, -1.55), (-1.5, -0.85), (-0.1, -0.85)] {
        block(Vec3::new(0.08, 0.7, 0.08), Vec3::new(x, 0.35, z), &wood);
    }
    block(Vec3::new(0.04, 1.2, 1.4), Vec3::new(-1.97, 1.6, -0.9), &mirror);
    let ball = Mesh3d(meshes.add(Sphere::new(0.22).mesh().ico(6).expect("few enough triangles")));
    for (x, material) in [(-1.2, &copper), (-0.5, &glass)] {
        let place = Transform::from_xyz(x, 0.96, -1.2);
        commands.spawn((ball.clone(), MeshMaterial3d(material.clone()), place));
    }
    let panel =
        (Mesh3d(meshes.add(Cuboid::new(1.0, 2.1, 0.05))), MeshMaterial3d(wood), Transform::from_xyz(0.5, 1.05, 0.0));
    commands
        .spawn((Door, Visibility::default(), Transform::from_xyz(0.4, 0.0, -2.5).with_rotation(ajar(0.0))))
        .with_child(panel);

    let eye = Transform::from_xyz(0.9, 1.5, 2.6).looking_at(Vec3::new(-0.2, 1.0, -1.6), Vec3::Y);
    // ReSTIR PT is the default.
    commands.spawn((Camera3d::default(), eye, Restir::default(), look(Some(Exposure::default().ev100))));
}

/// The rotation of the door, from 23° to 86°.
fn ajar(phase: f32) -> Quat {
    Quat::from_rotation_y(FRAC_PI_2 * (0.6 - 0.35 * phase.cos()))
}

fn swing(
    time: Res<Time>,
    keys: Res<ButtonInput<KeyCode>>,
    mut phase: Local<f32>,
    mut doors: Query<&mut Transform, With<Door>>,
) {
    if !keys.pressed(KeyCode::Space) {
        return;
    }
    *phase = (*phase + time.delta_secs()) % (2.0 * PI);
    for mut door in &mut doors {
        door.rotation = ajar(*phase);
    }
}
