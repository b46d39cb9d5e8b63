//! A scene that changes in a fixed rhythm: every round of frames is like the one before.

use bevy::{
    camera::{Exposure, Hdr, ImageRenderTarget, RenderTarget},
    mesh::{VertexAttributeValues, morph::MeshMorphWeights},
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_restir::{Preset, RayBackend, Restir, RestirEnvironment, Subsurface, Technique};
use bevy_restir_support::{
    exposure::unit_exposure,
    headless,
    scene::{self, CameraSetup, View},
    scenes::Random,
    skinned,
    sky::studio,
};
use core::f32::consts::{FRAC_PI_2, TAU};
use std::path::Path;

use crate::things::{Shape, Thing, despawn, spawn};

/// Frames of a round.
pub const ROUND: u32 = 24;

/// The scene with a permanent camera, and objects, lights and cameras that come and go.
pub struct Show {
    pub app: App,
    size: UVec2,
    settings: Restir,
    cube: Entity,
    tube: Entity,
    sheet: Entity,
    lamp: Entity,
    /// Objects that appear in every round.
    visitors: Vec<Thing>,
    lights: Vec<Thing>,
    /// Entities that are there now.
    present: Vec<Entity>,
    guest: Option<Entity>,
}

/// Colors of the material that is painted.
const PAINTS: [Color; 2] = [Color::linear_rgb(0.7, 0.3, 0.2), Color::linear_rgb(0.2, 0.5, 0.7)];
/// Lights of the lamp and of the sky.
const LAMPS: [LinearRgba; 2] = [LinearRgba::rgb(9.0, 8.0, 6.0), LinearRgba::rgb(4.0, 6.0, 9.0)];
const SKIES: [LinearRgba; 2] = [LinearRgba::rgb(0.2, 0.25, 0.3), LinearRgba::rgb(0.4, 0.2, 0.1)];

impl Show {
    pub fn new(technique: Technique, size: UVec2, seed: u64) -> Result<Self, String> {
        let mut app = headless::app(Path::new("."), RayBackend::Auto)?;
        let mut random = Random::new(seed);
        let settings = settings(technique, random.bits());
        let sky = studio(&mut app.world_mut().resource_mut::<Assets<Image>>(), 1.0);
        let environment = Some(RestirEnvironment { color: SKIES[0], ..sky });
        let setup = CameraSetup { size, exposure: unit_exposure(), environment, settings: settings.clone() };
        scene::spawn_camera(app.world_mut(), (eye(0.0), Projection::default()), setup);
        let world = app.world_mut();
        let floor = Transform::from_xyz(0.0, -1.0, 0.0)
            .with_rotation(Quat::from_rotation_x(-FRAC_PI_2))
            .with_scale(Vec3::splat(8.0));
        object(world, Shape::Square, plain(Color::linear_rgb(0.5, 0.5, 0.5)), floor);
        spawn_features(world);
        spawn_translucent(world);
        let above = Transform::from_xyz(0.0, 2.5, 0.0).with_rotation(Quat::from_rotation_x(FRAC_PI_2));
        let lamp = StandardMaterial { emissive: LAMPS[0], base_color: Color::BLACK, ..default() };
        Ok(Self {
            cube: object(world, Shape::Cube, plain(PAINTS[0]), Transform::default()),
            tube: object(
                world,
                Shape::Tube(joints(0.0)),
                plain(Color::linear_rgb(0.6, 0.6, 0.3)),
                Transform::default(),
            ),
            sheet: object(world, Shape::Sheet([0.0; 2]), plain(PAINTS[1]), Transform::from_xyz(-1.5, 0.2, -1.0)),
            lamp: object(world, Shape::Square, lamp, above),
            app,
            size,
            settings,
            visitors: visitors(&mut random),
            lights: lights(&mut random),
            present: Vec::new(),
            guest: None,
        })
    }

    /// Makes the changes before a frame.  Half of them are undone in the second half of the round, and only motion is left in its
    /// last frames.
    pub fn change(&mut self, frame: u32) {
        let phase = frame % ROUND;
        self.perform(phase);
        match phase {
            1 => self.invite(self.visitors.clone()),
            2 => self.paint(1),
            3 => self.invite(self.lights.clone()),
            4 => self.guest_arrives(),
            5 => self.set(|settings| settings.direct.candidates += 2),
            6 => self.guest_is_resized(),
            7 => self.texture(),
            8 => {
                self.light(1);
                self.resize(self.size + UVec2::ONE);
            }
            9 => self.show(self.cube, Visibility::Hidden),
            10 => self.guest_changes(),
            11 => self.show(self.cube, Visibility::Inherited),
            12 => self.reshape(1.3),
            13 => self.set(|settings| {
                for reuse in [&mut settings.direct.reuse, &mut settings.paths.reuse] {
                    reuse.spatial_samples = 0;
                }
            }),
            14 => self.paint(0),
            15 => self.light(0),
            16 => self.guest_leaves(),
            17 => {
                self.reshape(1.0 / 1.3);
                self.resize(self.size);
            }
            18 => self.settings_return(),
            19 => self.dismiss(),
            _ => {}
        }
    }

    /// Moves the camera, objects, bodies and the lamp: the same way in every round.
    fn perform(&mut self, phase: u32) {
        let turn = TAU * phase as f32 / ROUND as f32;
        let (sin, cos) = turn.sin_cos();
        let world = self.app.world_mut();
        let camera = world.resource::<View>().camera;
        place(world, camera, eye(turn));
        place(
            world,
            self.cube,
            Transform::from_xyz(0.8 * sin, -0.4, 0.8 * cos).with_rotation(Quat::from_rotation_y(turn)),
        );
        let above = Transform::from_xyz(0.5 * cos, 2.5, 0.5 * sin).with_rotation(Quat::from_rotation_x(FRAC_PI_2));
        place(world, self.lamp, above);
        skinned::set_joints(world, self.tube, &joints(turn));
        if let Some(mut morph) = world.get_mut::<MeshMorphWeights>(self.sheet) {
            *morph = MeshMorphWeights::Value { weights: vec![0.5 * sin, 0.5 * cos] };
        }
    }

    fn invite(&mut self, things: Vec<Thing>) {
        let world = self.app.world_mut();
        self.present.extend(things.iter().map(|thing| spawn(world, thing)));
    }

    fn dismiss(&mut self) {
        for entity in self.present.drain(..) {
            despawn(self.app.world_mut(), entity);
        }
    }

    fn show(&mut self, entity: Entity, visibility: Visibility) {
        self.app.world_mut().entity_mut(entity).insert(visibility);
    }

    /// Edits the material of an object.
    fn edit(&mut self, entity: Entity, edit: impl FnOnce(&mut StandardMaterial)) {
        let world = self.app.world_mut();
        let Some(material) = world.get::<MeshMaterial3d<StandardMaterial>>(entity).map(|material| material.id()) else {
            return;
        };
        if let Some(mut material) = world.resource_mut::<Assets<StandardMaterial>>().get_mut(material) {
            edit(&mut material);
        }
    }

    fn paint(&mut self, which: usize) {
        self.edit(self.cube, |material| {
            material.base_color = PAINTS[which];
            material.perceptual_roughness = [0.6, 0.2][which];
            material.base_color_texture = None;
        });
    }

    /// Edits the lights that stay: the lamp and the sky.
    fn light(&mut self, which: usize) {
        self.edit(self.lamp, |material| material.emissive = LAMPS[which]);
        let world = self.app.world_mut();
        let camera = world.resource::<View>().camera;
        if let Some(mut environment) = world.get_mut::<RestirEnvironment>(camera) {
            environment.color = SKIES[which];
        }
    }

    /// Gives an object an image of its own.
    fn texture(&mut self) {
        let image = self.app.world_mut().resource_mut::<Assets<Image>>().add(image());
        self.edit(self.cube, |material| material.base_color_texture = Some(image));
    }

    /// Scales the vertices of an object's mesh.
    fn reshape(&mut self, by: f32) {
        let world = self.app.world_mut();
        let Some(mesh) = world.get::<Mesh3d>(self.cube).map(|mesh| mesh.id()) else { return };
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let Some(mut mesh) = meshes.get_mut(mesh) else { return };
        if let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION) {
            positions.iter_mut().for_each(|position| position[1] *= by);
        }
    }

    /// Changes settings that histories survive.
    fn set(&mut self, change: impl FnOnce(&mut Restir)) {
        let world = self.app.world_mut();
        let camera = world.resource::<View>().camera;
        if let Some(mut settings) = world.get_mut::<Restir>(camera) {
            change(&mut settings);
        }
    }

    fn settings_return(&mut self) {
        let settings = self.settings.clone();
        self.set(|current| *current = settings);
    }

    /// A second camera, with its own target and settings.
    fn guest_arrives(&mut self) {
        let world = self.app.world_mut();
        let size = (self.size / 2).max(UVec2::ONE);
        let target = world.resource_mut::<Assets<Image>>().add(scene::target(size));
        let exposure: Exposure = unit_exposure();
        let place = Transform::from_xyz(2.0, 1.0, 3.0).looking_at(Vec3::ZERO, Vec3::Y);
        let to = RenderTarget::Image(ImageRenderTarget::from(target));
        let guest = world.spawn((Camera3d::default(), to, Hdr, place, exposure, self.settings.clone())).id();
        self.guest = Some(guest);
    }

    fn guest_is_resized(&mut self) {
        if let Some(guest) = self.guest {
            let size = (self.size + UVec2::new(3, 0)) / 2 + UVec2::ONE;
            scene::resize(self.app.world_mut(), guest, size);
        }
    }

    /// Resizes the camera that stays.
    fn resize(&mut self, size: UVec2) {
        let world = self.app.world_mut();
        let camera = world.resource::<View>().camera;
        scene::resize(world, camera, size);
    }

    /// Changes settings that restart histories.
    fn guest_changes(&mut self) {
        let Some(guest) = self.guest else { return };
        if let Some(mut settings) = self.app.world_mut().get_mut::<Restir>(guest) {
            settings.bounces += 1;
            settings.seed += 1;
        }
    }

    fn guest_leaves(&mut self) {
        if let Some(guest) = self.guest.take() {
            self.app.world_mut().despawn(guest);
        }
    }
}

/// Settings with little work in a frame.
fn settings(technique: Technique, seed: u32) -> Restir {
    let mut settings = Restir { technique, bounces: 2, seed, ..Restir::preset(Preset::Performance) };
    (settings.direct.subset_count, settings.direct.subset_size, settings.direct.candidates) = (8, 64, 4);
    settings
}

fn eye(turn: f32) -> Transform {
    let (sin, cos) = turn.sin_cos();
    Transform::from_xyz(0.4 * sin, 0.7 + 0.1 * cos, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y)
}

fn joints(turn: f32) -> Vec<Transform> {
    let foot = Transform::from_xyz(1.4, -1.0, -0.5);
    skinned::swaying(foot, 2.0 * turn.sin(), 1.0)
}

fn plain(color: Color) -> StandardMaterial {
    StandardMaterial { base_color: color, perceptual_roughness: 0.6, ..default() }
}

fn object(world: &mut World, shape: Shape, material: StandardMaterial, at: Transform) -> Entity {
    spawn(world, &Thing::Object { shape, material: Box::new(material), subsurface: None, at })
}

fn place(world: &mut World, entity: Entity, at: Transform) {
    if let Some(mut transform) = world.get_mut::<Transform>(entity) {
        *transform = at;
    }
}

/// A ball of glass, and one that light enters.
fn spawn_translucent(world: &mut World) {
    let glass = StandardMaterial { specular_transmission: 1.0, thickness: 0.4, ior: 1.5, ..plain(Color::WHITE) };
    let glass = StandardMaterial { perceptual_roughness: 0.1, ..glass };
    let at = |x: f32| Transform::from_xyz(x, -0.7, 1.0).with_scale(Vec3::splat(0.6));
    object(world, Shape::Ball, glass, at(-0.5));
    let subsurface = Some(Subsurface { mean_free_path: Vec3::new(0.1, 0.05, 0.03), ..default() });
    let material = Box::new(plain(Color::linear_rgb(0.8, 0.6, 0.5)));
    spawn(world, &Thing::Object { shape: Shape::Ball, material, subsurface, at: at(0.5) });
}

/// Faint lights and a small object far away, with the features of all that comes and goes, so that shaders are compiled once.
fn spawn_features(world: &mut World) {
    let at = |x: f32| Transform::from_xyz(50.0 + x, 80.0, 0.0).with_scale(Vec3::splat(0.1));
    let image = world.resource_mut::<Assets<Image>>().add(image());
    object(world, Shape::Cube, StandardMaterial { base_color_texture: Some(image), ..default() }, at(0.0));
    for (i, radius) in [0.0, 0.1].into_iter().enumerate() {
        spawn(world, &Thing::Point(PointLight { intensity: 0.01, radius, ..default() }, at(2.0 + i as f32)));
    }
}

fn image() -> Image {
    let texel = |i: u8| [128 + i % 100, 255 - i % 90, 200, 255];
    Image::new(
        Extent3d { width: 8, height: 8, ..default() },
        TextureDimension::D2,
        (0..64).flat_map(texel).collect(),
        TextureFormat::Rgba8UnormSrgb,
        default(),
    )
}

/// Objects that appear in every round: one of each shape.
fn visitors(random: &mut Random) -> Vec<Thing> {
    let soup = (0..36).map(|_| random.point(0.4)).collect();
    let tube = skinned::swaying(Transform::from_xyz(-1.6, -1.0, 0.8).with_scale(Vec3::splat(0.5)), 1.0, 1.0);
    let shapes = [Shape::Ball, Shape::Soup(soup), Shape::Tube(tube), Shape::Sheet([0.2, 0.4])];
    let mut visitor = |shape| {
        let [x, y, z] = random.point(1.0);
        let mut color = || random.range(0.1, 0.9);
        let color = Color::linear_rgb(color(), color(), color());
        let emissive = if random.below(2) == 0 { LinearRgba::rgb(1.0, 2.0, 1.0) } else { LinearRgba::BLACK };
        let material = Box::new(StandardMaterial { emissive, ..plain(color) });
        Thing::Object { shape, material, subsurface: None, at: Transform::from_xyz(x, y + 0.3, z) }
    };
    shapes.into_iter().map(&mut visitor).collect()
}

/// Lights that appear in every round: a point, a sphere and a cone.
fn lights(random: &mut Random) -> Vec<Thing> {
    let mut at = || {
        let [x, _, z] = random.point(1.5);
        Transform::from_xyz(x, 2.0, z).looking_at(Vec3::ZERO, Vec3::X)
    };
    vec![
        Thing::Point(PointLight { intensity: 20.0, radius: 0.0, ..default() }, at()),
        Thing::Point(PointLight { intensity: 20.0, radius: 0.1, ..default() }, at()),
        Thing::Spot(SpotLight { intensity: 20.0, ..default() }, at()),
    ]
}
