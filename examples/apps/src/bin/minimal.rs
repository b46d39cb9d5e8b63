//! An ordinary Bevy app that bevy_restir lights: it adds the plugin, and `Restir` and a sky to the camera. Space (held) turns the cube.
//!
//! `cargo run -p bevy_restir_apps --bin minimal`

use bevy::prelude::*;
use bevy_restir::prelude::*;

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, RestirPlugin::default()))
        .add_systems(Startup, setup)
        .add_systems(Update, turn)
        .run();
}

#[derive(Component)]
struct Turning;

fn setup(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
    let ground = materials.add(Color::srgb(0.8, 0.8, 0.8));
    let gold = materials.add(StandardMaterial {
        base_color: Color::srgb(1.0, 0.77, 0.34),
        metallic: 1.0,
        perceptual_roughness: 0.25,
        ..default()
    });
    let lamp = materials.add(StandardMaterial { emissive: LinearRgba::rgb(160.0, 128.0, 80.0), ..default() });
    let clay = materials.add(Color::srgb(0.7, 0.25, 0.2));

    commands.spawn((Mesh3d(meshes.add(Plane3d::default().mesh().size(12.0, 12.0))), MeshMaterial3d(ground)));
    commands.spawn((Mesh3d(meshes.add(Sphere::new(0.7))), MeshMaterial3d(gold), Transform::from_xyz(-0.9, 0.7, 0.0)));
    let cube = meshes.add(Cuboid::from_length(1.1));
    commands.spawn((Mesh3d(cube), MeshMaterial3d(clay), Transform::from_xyz(0.9, 0.55, -0.2), Turning));
    commands.spawn((Mesh3d(meshes.add(Sphere::new(0.3))), MeshMaterial3d(lamp), Transform::from_xyz(0.6, 3.6, 1.4)));

    let eye = Transform::from_xyz(0.0, 2.0, 5.0).looking_at(Vec3::new(0.0, 0.7, 0.0), Vec3::Y);
    // Bevy's default exposure shows 1,000 cd/m² as white.
    let sky = RestirEnvironment::uniform(LinearRgba::rgb(200.0, 320.0, 560.0));
    commands.spawn((Camera3d::default(), eye, Restir::default(), sky));
}

/// Turns the cube while space is held.
fn turn(time: Res<Time>, keys: Res<ButtonInput<KeyCode>>, mut turning: Query<&mut Transform, With<Turning>>) {
    if keys.pressed(KeyCode::Space) {
        for mut transform in &mut turning {
            transform.rotate_y(time.delta_secs());
        }
    }
}
