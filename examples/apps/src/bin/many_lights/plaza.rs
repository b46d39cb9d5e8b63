//! The plaza: a floor of stone and polished metal, a ring of columns, and metal balls.

use bevy::prelude::*;
use std::f32::consts::TAU;

pub fn spawn(
    mut commands: Commands,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let mut surface = |color: Color, metallic: f32, perceptual_roughness: f32| {
        materials.add(StandardMaterial { base_color: color, metallic, perceptual_roughness, ..default() })
    };
    let stone = surface(Color::srgb(0.72, 0.69, 0.64), 0.0, 0.9);
    let slate = surface(Color::srgb(0.40, 0.42, 0.46), 0.0, 0.6);
    let ground = surface(Color::srgb(0.22, 0.21, 0.20), 0.0, 1.0);
    let steel = surface(Color::srgb(0.80, 0.82, 0.85), 1.0, 0.22);
    let copper = surface(Color::srgb(0.95, 0.64, 0.54), 1.0, 0.3);
    let gold = surface(Color::srgb(1.0, 0.84, 0.50), 1.0, 0.12);
    let lacquer = surface(Color::srgb(0.55, 0.06, 0.05), 0.0, 0.2);

    let mut put = |mesh: &Handle<Mesh>, material: &Handle<StandardMaterial>, transform: Transform| {
        commands.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()), transform));
    };
    let plane = meshes.add(Plane3d::default().mesh().size(160.0, 160.0));
    put(&plane, &ground, Transform::from_xyz(0.0, -0.03, 0.0));
    let tile = meshes.add(Plane3d::default().mesh().size(1.94, 1.94));
    for (x, z) in (-10i32..10).flat_map(|x| (-10..10).map(move |z| (x, z))) {
        let material = match (x + z).rem_euclid(2) {
            0 => &stone,
            _ if (x % 4 == 0) ^ (z % 4 == 0) => &steel,
            _ => &slate,
        };
        put(&tile, material, Transform::from_xyz(2.0 * x as f32 + 1.0, 0.0, 2.0 * z as f32 + 1.0));
    }

    // Columns, connected in pairs by beams.
    let shaft = meshes.add(Cylinder::new(0.42, 4.0).mesh().resolution(24).build());
    let block = meshes.add(Cuboid::from_length(1.0));
    for i in 0..16 {
        let turn = Quat::from_rotation_y(TAU * i as f32 / 16.0);
        let at = |y: f32| turn * Vec3::new(0.0, y, -11.0);
        put(&shaft, if i % 4 == 0 { &copper } else { &stone }, Transform::from_translation(at(2.3)));
        for y in [0.15, 4.4] {
            let place = Transform::from_translation(at(y)).with_rotation(turn);
            put(&block, &stone, place.with_scale(Vec3::new(1.2, 0.3, 1.2)));
        }
        if i % 2 == 0 {
            let half = Quat::from_rotation_y(TAU * (i as f32 + 0.5) / 16.0);
            let place = Transform::from_translation(half * Vec3::new(0.0, 4.8, -10.8)).with_rotation(half);
            put(&block, &stone, place.with_scale(Vec3::new(5.7, 0.5, 1.0)));
        }
    }

    // Steps with a ball and a ring in the middle, and small balls on blocks around them.
    for (i, radius) in [2.6f32, 2.0, 1.4].into_iter().enumerate() {
        let step = meshes.add(Cylinder::new(radius, 0.3).mesh().resolution(48).build());
        put(&step, if i == 1 { &slate } else { &stone }, Transform::from_xyz(0.0, 0.15 + 0.3 * i as f32, 0.0));
    }
    let ball = meshes.add(Sphere::new(1.0).mesh().uv(48, 24));
    let ring = meshes.add(Torus::new(1.45, 1.65).mesh().minor_resolution(16).major_resolution(64).build());
    put(&ball, &gold, Transform::from_xyz(0.0, 2.0, 0.0).with_scale(Vec3::splat(1.1)));
    put(&ring, &steel, Transform::from_xyz(0.0, 2.0, 0.0).with_rotation(Quat::from_rotation_z(0.5)));
    for i in 0..6 {
        let turn = Quat::from_rotation_y(TAU * (i as f32 + 0.25) / 6.0);
        let at = |y: f32| Transform::from_translation(turn * Vec3::new(0.0, y, -5.6)).with_rotation(turn);
        put(&block, if i % 2 == 0 { &slate } else { &stone }, at(0.45).with_scale(Vec3::new(1.1, 0.9, 1.1)));
        let material = [&lacquer, &copper, &steel][i % 3];
        put(&ball, material, at(1.4).with_scale(Vec3::splat(0.5)));
    }
}
