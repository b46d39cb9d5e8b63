//! A generated scene with any number of lights: a floor with blocks below a panel of fixed area and power that is divided into
//! emissive triangles.

use bevy::{
    asset::RenderAssetUsages,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};

/// Size of the panel and its height above the floor, m.
pub const PANEL: Vec2 = Vec2::new(6.0, 6.0);
pub const HEIGHT: f32 = 6.0;
/// Radiance of the panel.
const RADIANCE: f32 = 5.0;

/// The panel.
#[derive(Component)]
pub struct Panel;

/// Spawns the floor and the blocks. Returns the transform and the projection of the camera.
pub fn spawn_room(world: &mut World) -> (Transform, Projection) {
    let mut solid = |mesh: Mesh, color: Color, at: Vec3| {
        let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
        let material = StandardMaterial { base_color: color, perceptual_roughness: 0.9, ..Default::default() };
        let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
        world.spawn((Mesh3d(mesh), MeshMaterial3d(material), Transform::from_translation(at)));
    };
    solid(Plane3d::default().mesh().size(60.0, 60.0).build(), Color::srgb(0.7, 0.7, 0.7), Vec3::ZERO);
    for i in 0..25 {
        let (column, row) = (i % 5, i / 5);
        let height = 0.5 + 0.4 * ((i * 7) % 5) as f32;
        let color = Color::srgb(0.3 + 0.15 * column as f32, 0.5, 0.3 + 0.15 * row as f32);
        let at = Vec3::new(1.6 * (column as f32 - 2.0), 0.5 * height, 1.6 * (row as f32 - 2.0));
        solid(Cuboid::new(0.8, height, 0.8).mesh().build(), color, at);
    }
    let projection = PerspectiveProjection { near: 0.1, far: 100.0, ..Default::default() };
    let eye = Transform::from_xyz(0.0, 5.0, 9.0).looking_at(Vec3::new(0.0, 0.3, 0.0), Vec3::Y);
    (eye, Projection::Perspective(projection))
}

/// Spawns a panel at a place and despawns the previous one.
pub fn hang(world: &mut World, panel: Mesh, at: Transform) {
    let old: Vec<Entity> = world.query_filtered::<Entity, With<Panel>>().iter(world).collect();
    for entity in old {
        world.despawn(entity);
    }
    let mesh = world.resource_mut::<Assets<Mesh>>().add(panel);
    let material = StandardMaterial {
        base_color: Color::BLACK,
        emissive: LinearRgba::rgb(RADIANCE, RADIANCE, RADIANCE),
        ..Default::default()
    };
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
    world.spawn((Panel, Mesh3d(mesh), MeshMaterial3d(material), at));
}

/// Columns and rows of a grid of cells with two triangles each, as close to a square grid as the number allows.
fn cells(triangles: u32) -> UVec2 {
    let cells = (triangles / 2).max(1);
    let columns = (1..=cells.isqrt()).rev().find(|columns| cells.is_multiple_of(*columns)).unwrap_or(1);
    UVec2::new(columns, cells / columns)
}

/// A panel of an even number of triangles that faces down. Inner corners are displaced so that the triangles differ in power; the
/// total area stays the same.
pub fn panel(triangles: u32) -> Mesh {
    let cells = cells(triangles);
    let corners = cells + 1;
    let cell = PANEL / cells.as_vec2();
    let mut positions = Vec::with_capacity((corners.x * corners.y) as usize);
    for y in 0..corners.y {
        for x in 0..corners.x {
            let inner = x > 0 && y > 0 && x < cells.x && y < cells.y;
            let moved = if inner { 0.25 * jitter(x + y * corners.x) } else { Vec2::ZERO };
            let at = cell * (UVec2::new(x, y).as_vec2() + moved) - 0.5 * PANEL;
            positions.push([at.x, 0.0, at.y]);
        }
    }
    let mut indices = Vec::with_capacity(6 * (cells.x * cells.y) as usize);
    for y in 0..cells.y {
        for x in 0..cells.x {
            let corner = x + y * corners.x;
            let (right, below) = (corner + 1, corner + corners.x);
            indices.extend([corner, right, below, right, below + 1, below]);
        }
    }
    let normals = vec![[0.0, -1.0, 0.0]; positions.len()];
    Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
        .with_inserted_indices(Indices::U32(indices))
}

/// A pseudo-random point of [-1, 1]² per corner, by an integer hash.
fn jitter(corner: u32) -> Vec2 {
    let mut hash = corner.wrapping_mul(0x9e37_79b9) ^ 0x85eb_ca6b;
    hash = (hash ^ (hash >> 16)).wrapping_mul(0x7feb_352d);
    hash = (hash ^ (hash >> 15)).wrapping_mul(0x846c_a68b);
    hash ^= hash >> 16;
    let coordinate = |bits: u32| bits as f32 / 32767.5 - 1.0;
    Vec2::new(coordinate(hash & 0xffff), coordinate(hash >> 16))
}
