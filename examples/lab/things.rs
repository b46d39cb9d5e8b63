//! Objects and lights as data, and how they are spawned.

use bevy::{
    asset::{RenderAssetUsages, uuid::Uuid},
    light::SunDisk,
    math::Vec3Swizzles,
    mesh::{
        PrimitiveTopology,
        morph::{MeshMorphWeights, MorphAttributes},
        skinning::SkinnedMesh,
    },
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_restir::Subsurface;
use bevy_restir_support::skinned;
use core::marker::PhantomData;

/// Something that is spawned.
#[derive(Clone, Debug)]
pub enum Thing {
    Object {
        shape: Shape,
        material: Box<StandardMaterial>,
        subsurface: Option<Subsurface>,
        at: Transform,
    },
    Point(PointLight, Transform),
    Spot(SpotLight, Transform),
    Rect(RectLight, Transform),
    /// With the angular size of its disk, if it has one.
    Sun(DirectionalLight, Option<f32>, Transform),
}

#[derive(Clone, Debug)]
pub enum Shape {
    Cube,
    Ball,
    Square,
    /// Triangles without any order, each corner on its own.
    Soup(Vec<[f32; 3]>),
    /// A tube with a skin, and the transforms of its joints.
    Tube(Vec<Transform>),
    /// A square with two morph targets, and their weights.
    Sheet([f32; 2]),
}

impl Shape {
    pub fn mesh(&self) -> Mesh {
        match self {
            Self::Cube => Cuboid::from_length(1.0).into(),
            Self::Ball => Sphere::new(0.5).mesh().uv(12, 8),
            Self::Square => Rectangle::from_length(1.0).into(),
            Self::Tube(_) => skinned::tube(6, 5),
            Self::Sheet(_) => {
                let mesh: Mesh = Rectangle::from_length(1.0).into();
                let target = |by: Vec3| vec![MorphAttributes::new(by, by.yzx(), Vec3::ZERO); mesh.count_vertices()];
                let mut bump = target(Vec3::Z);
                bump[0].position = Vec3::new(-1.0, 0.5, 0.0);
                let targets = bump.into_iter().chain(target(Vec3::new(0.3, 0.0, -0.5))).collect();
                let mut mesh = mesh;
                mesh.set_morph_targets(targets);
                mesh
            }
            Self::Soup(corners) => Mesh::new(PrimitiveTopology::TriangleList, default())
                .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners.clone()),
        }
    }
}

/// Pictures for textures and environments; the last one has texels at the edges of what an app may write.
pub const PICTURES: usize = 4;

/// The handle of a picture, which is data: it is the same in all apps.
pub fn picture(number: usize) -> Handle<Image> {
    Handle::Uuid(Uuid::from_u128(0x7e57_0000 + number as u128), PhantomData)
}

/// Inserts the pictures of all handles of [`picture`].
pub fn insert_pictures(world: &mut World) {
    let bytes = |count: u8| (0..count).map(|i| i.wrapping_mul(37).wrapping_add(90)).collect::<Vec<_>>();
    let edges = [[0.0f32, 1.0, 1e-40, 1.0], [3e38, 0.5, 1e6, 0.5], [f32::NAN, f32::INFINITY, -1.0, 1.0]];
    let pictures: [(u32, u32, TextureFormat, Vec<u8>); PICTURES] = [
        (1, 1, TextureFormat::Rgba8UnormSrgb, vec![255; 4]),
        (8, 4, TextureFormat::Rgba8UnormSrgb, bytes(128)),
        (7, 5, TextureFormat::Rgba8Unorm, bytes(140)),
        (3, 1, TextureFormat::Rgba32Float, bytemuck::cast_slice(&edges).to_vec()),
    ];
    let mut images = world.resource_mut::<Assets<Image>>();
    for (number, (width, height, format, data)) in pictures.into_iter().enumerate() {
        let size = Extent3d { width, height, ..default() };
        let image = Image::new(size, TextureDimension::D2, data, format, RenderAssetUsages::all());
        let inserted = images.insert(&picture(number), image);
        debug_assert!(inserted.is_ok(), "a handle without an index is always valid");
    }
}

/// Removes the pictures of [`insert_pictures`].
pub fn remove_pictures(world: &mut World) {
    let mut images = world.resource_mut::<Assets<Image>>();
    (0..PICTURES).for_each(|number| _ = images.remove(&picture(number)));
}

/// Spawns a thing with assets of its own.
pub fn spawn(world: &mut World, thing: &Thing) -> Entity {
    match thing {
        Thing::Object { shape, material, subsurface, at } => {
            let entity = spawn_object(world, shape, (**material).clone(), *at);
            if let Some(subsurface) = subsurface {
                world.entity_mut(entity).insert(*subsurface);
            }
            entity
        }
        Thing::Point(light, at) => world.spawn((*light, *at)).id(),
        Thing::Spot(light, at) => world.spawn((*light, *at)).id(),
        Thing::Rect(light, at) => world.spawn((*light, *at)).id(),
        Thing::Sun(light, disk, at) => {
            let mut sun = world.spawn((*light, *at));
            if let Some(angular_size) = *disk {
                sun.insert(SunDisk { angular_size, ..SunDisk::EARTH });
            }
            sun.id()
        }
    }
}

fn spawn_object(world: &mut World, shape: &Shape, material: StandardMaterial, at: Transform) -> Entity {
    let mesh = world.resource_mut::<Assets<Mesh>>().add(shape.mesh());
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
    let object = world.spawn((Mesh3d(mesh), MeshMaterial3d(material), at)).id();
    match shape {
        Shape::Tube(joints) => {
            let skin = skinned::skin(world);
            world.entity_mut(object).insert(skin);
            skinned::set_joints(world, object, joints);
        }
        Shape::Sheet(weights) => {
            world.entity_mut(object).insert(MeshMorphWeights::Value { weights: weights.to_vec() });
        }
        _ => {}
    }
    object
}

/// Despawns an object of [`spawn`] and the joints of its skin, if it still exists.
pub fn despawn(world: &mut World, thing: Entity) {
    let joints = world.get::<SkinnedMesh>(thing).map(|skin| skin.joints.clone());
    for entity in joints.into_iter().flatten().chain([thing]) {
        if let Ok(entity) = world.get_entity_mut(entity) {
            entity.despawn();
        }
    }
}

/// Small objects and faint lights with all features, far away.
pub fn spawn_everything(world: &mut World) {
    let texture = Image::new_fill(
        Extent3d { width: 2, height: 2, ..default() },
        TextureDimension::D2,
        &[128, 128, 255, 255],
        TextureFormat::Rgba8Unorm,
        RenderAssetUsages::all(),
    );
    let texture = world.resource_mut::<Assets<Image>>().add(texture);
    let tinted = StandardMaterial {
        base_color_texture: Some(texture.clone()),
        normal_map_texture: Some(texture),
        alpha_mode: AlphaMode::Mask(0.5),
        specular_transmission: 0.5,
        diffuse_transmission: 0.2,
        attenuation_color: Color::linear_rgb(0.5, 0.9, 0.5),
        attenuation_distance: 1.0,
        clearcoat: 0.5,
        anisotropy_strength: 0.5,
        ..default()
    };
    let materials = [
        tinted.clone(),
        StandardMaterial { thickness: 0.1, ..tinted },
        StandardMaterial { unlit: true, ..default() },
        StandardMaterial { emissive: LinearRgba::rgb(0.01, 0.01, 0.01), ..default() },
    ];
    let place = |i: usize| Transform::from_xyz(50.0 + 2.0 * i as f32, 80.0, 0.0).with_scale(Vec3::splat(0.1));
    for (i, material) in materials.into_iter().enumerate() {
        let object = spawn_object(world, &Shape::Ball, material, place(i));
        if i == 3 {
            world.entity_mut(object).insert(Subsurface::default());
        }
    }
    let joints = skinned::swaying(place(4), 0.0, 1.0);
    spawn_object(world, &Shape::Tube(joints), StandardMaterial::default(), place(4));
    world.spawn((PointLight { intensity: 0.01, radius: 0.0, ..default() }, place(5)));
    world.spawn((PointLight { intensity: 0.01, radius: 0.1, ..default() }, place(6)));
    world.spawn((RectLight { intensity: 0.01, ..default() }, place(7)));
    world.spawn((DirectionalLight { illuminance: 1e-4, ..default() }, SunDisk::EARTH, place(8)));
}
