//! ReSTIR GI with ReSTIR DI in a courtyard of colored walls: sunlit walls light the parts in the shade. Space moves the sun.
//!
//! `cargo run -p bevy_restir_apps --bin global_illumination`

use bevy::{camera::Exposure, prelude::*};
use bevy_restir::prelude::*;
use bevy_restir_apps::{look::look, window};

fn main() -> AppExit {
    window::app("global illumination", UVec2::new(1280, 720), "Space (held): move the sun", RayBackend::Auto)
        .add_systems(Startup, setup)
        .add_systems(Update, wander)
        .run()
}

fn setup(mut commands: Commands, mut meshes: ResMut<Assets<Mesh>>, mut materials: ResMut<Assets<StandardMaterial>>) {
    let mut paint = |color: Color| materials.add(StandardMaterial { base_color: color, reflectance: 0.2, ..default() });
    let (stone, red, green, cream) = (
        paint(Color::srgb(0.8, 0.78, 0.72)),
        paint(Color::srgb(0.8, 0.2, 0.12)),
        paint(Color::srgb(0.2, 0.6, 0.2)),
        paint(Color::srgb(0.9, 0.85, 0.7)),
    );
    let mut block = |size: Vec3, place: Vec3, material: &Handle<StandardMaterial>| {
        let mesh = Mesh3d(meshes.add(Cuboid::from_size(size)));
        commands.spawn((mesh, MeshMaterial3d(material.clone()), Transform::from_translation(place)));
    };
    block(Vec3::new(14.0, 0.2, 14.0), Vec3::new(0.0, -0.1, 0.0), &stone);
    block(Vec3::new(0.3, 4.0, 10.0), Vec3::new(-4.0, 2.0, 0.0), &red);
    block(Vec3::new(0.3, 4.0, 10.0), Vec3::new(4.0, 2.0, 0.0), &green);
    block(Vec3::new(8.0, 4.0, 0.3), Vec3::new(0.0, 2.0, -5.0), &cream);
    // An arcade along the far wall and a pillar in the middle.
    block(Vec3::new(8.0, 0.3, 2.0), Vec3::new(0.0, 2.6, -4.0), &cream);
    for x in [-3.0, -1.0, 1.0, 3.0] {
        block(Vec3::new(0.3, 2.5, 0.3), Vec3::new(x, 1.25, -3.2), &cream);
    }
    block(Vec3::new(0.8, 1.6, 0.8), Vec3::new(0.4, 0.8, 0.0), &stone);

    let sun = DirectionalLight { illuminance: 4000.0, ..default() };
    commands.spawn((sun, sun_at(0.0)));
    let eye = Transform::from_xyz(0.0, 2.4, 6.5).looking_at(Vec3::new(0.0, 1.3, -2.0), Vec3::Y);
    let sky = RestirEnvironment { color: LinearRgba::rgb(240.0, 390.0, 680.0), ..default() };
    let restir = Restir { technique: Technique::Gi, ..default() };
    commands.spawn((Camera3d::default(), eye, restir, sky, look(Some(Exposure::default().ev100))));
}

/// The direction of the sun.
fn sun_at(time: f32) -> Transform {
    Transform::from_rotation(Quat::from_euler(EulerRot::YXZ, 0.8 + 0.9 * time.sin(), -0.8 + 0.2 * time.cos(), 0.0))
}

fn wander(
    time: Res<Time>,
    keys: Res<ButtonInput<KeyCode>>,
    mut passed: Local<f32>,
    mut suns: Query<&mut Transform, With<DirectionalLight>>,
) {
    if keys.pressed(KeyCode::Space) {
        *passed += 0.5 * time.delta_secs();
        for mut sun in &mut suns {
            *sun = sun_at(*passed);
        }
    }
}
