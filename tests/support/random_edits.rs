//! A scene that random edits change, and its load from scratch.

use super::{app::*, bodies::*, scenes::Random};
use bevy::{
    camera::visibility::RenderLayers, light::NotShadowCaster, mesh::skinning::SkinnedMesh, prelude::*,
    render::render_resource::TextureFormat,
};
use bevy_restir::{RestirEnvironment, Subsurface};
use bevy_restir_support::skinned;

/// An object of the scene: all that a fresh load needs.
#[derive(Clone, Debug, PartialEq)]
pub enum Thing {
    Solid(Solid),
    Body(Body),
    /// Kind, power, position.
    Light(usize, f32, Vec3),
}

impl Thing {
    /// The seed of its image; 0 for no image.
    fn image(&self) -> u32 {
        match self {
            Self::Solid(Solid { material, .. }) | Self::Body(Body { material, .. }) => material.image,
            Self::Light(..) => 0,
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    mesh: usize,
    material: Look,
    /// There is no rotation, because it would round differently in a fresh load.
    translation: Vec3,
    scale: Vec3,
    has_mesh: bool,
    hidden: bool,
    layer: usize,
    casts_shadows: bool,
    /// The mean free path of [`Subsurface`] in meters; 0: the object is opaque.
    translucent: f32,
}

/// An object that bends: a tube with a skin, or a sheet with morph targets.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    has_skin: bool,
    material: Look,
    place: Vec3,
    /// The time of its pose.
    time: f32,
}

/// The camera and its sky.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlook {
    eye: Vec3,
    /// The turn of the sky, its brightness and its greenness.
    sky: [f32; 3],
}

/// The parameters of a material.
#[derive(Clone, Debug, PartialEq)]
pub struct Look {
    albedo: f32,
    metallic: f32,
    roughness: f32,
    emission: f32,
    /// The seed of an image; 0 for no image.
    image: u32,
    masked: bool,
}

fn mesh(kind: usize) -> Mesh {
    match kind {
        0 => square(1.0),
        1 => Cuboid::from_length(0.8).into(),
        2 => Sphere::new(0.5).mesh().uv(12, 8),
        3 => Torus::new(0.2, 0.5).mesh().minor_resolution(6).major_resolution(10).build(),
        _ => Sphere::new(0.4).mesh().ico(12).expect("few enough triangles"),
    }
}

const MESHES: usize = 5;

fn image(seed: u32) -> Image {
    let mut random = Random::new(u64::from(seed));
    let texels: Vec<[u8; 4]> =
        (0..16).map(|_| [0; 4].map(|_: u8| random.bits() as u8)).map(|[r, g, b, a]| [r, g, b, a | 1]).collect();
    if seed.is_multiple_of(2) {
        return texture(4, 4, |x, y| texels[(4 * y + x) as usize]);
    }
    // It has levels of its own, so it is bound directly where the device has texture arrays.
    let levels = [16, 4, 1].map(|count| texels[..count].concat());
    image_with_levels(TextureFormat::Rgba8UnormSrgb, 4, 4, &levels)
}

fn material(look: &Look, image: Option<Handle<Image>>) -> StandardMaterial {
    StandardMaterial {
        base_color: Color::linear_rgb(look.albedo, 0.8 * look.albedo, look.albedo),
        metallic: look.metallic,
        perceptual_roughness: look.roughness,
        emissive: LinearRgba::rgb(look.emission, look.emission, 0.5 * look.emission),
        base_color_texture: image,
        alpha_mode: if look.masked { AlphaMode::Mask(0.5) } else { AlphaMode::Opaque },
        cull_mode: None,
        ..default()
    }
}

fn point(random: &mut Random) -> Vec3 {
    Vec3::new(random.range(-1.5, 1.5), random.range(-1.5, 1.5), random.range(-1.5, 1.0))
}

fn scale(random: &mut Random) -> Vec3 {
    Vec3::new(random.range(0.3, 1.2), random.range(0.3, 1.2), random.range(0.3, 1.2))
}

fn look(random: &mut Random) -> Look {
    Look {
        albedo: random.range(0.2, 0.9),
        metallic: if random.below(3) == 0 { 1.0 } else { 0.0 },
        roughness: random.range(0.3, 1.0),
        emission: if random.below(4) == 0 { random.range(1.0, 5.0) } else { 0.0 },
        image: if random.below(2) == 0 { 1 + random.bits() % 1000 } else { 0 },
        masked: random.below(4) == 0,
    }
}

fn mean_free_path(random: &mut Random) -> f32 {
    if random.below(4) == 0 { random.range(0.05, 0.3) } else { 0.0 }
}

fn thing(random: &mut Random) -> Thing {
    match random.below(8) {
        0 | 1 => Thing::Light(random.below(3), random.range(1.0, 30.0), point(random)),
        2 => Thing::Body(Body {
            has_skin: random.below(2) == 0,
            material: look(random),
            place: point(random),
            time: random.range(0.0, 20.0),
        }),
        _ => Thing::Solid(Solid {
            mesh: random.below(MESHES),
            material: look(random),
            translation: point(random),
            scale: scale(random),
            has_mesh: true,
            hidden: false,
            layer: 0,
            casts_shadows: true,
            translucent: mean_free_path(random),
        }),
    }
}

/// One object of every kind, so that all pipelines are created at the beginning.
fn first_things(random: &mut Random) -> Vec<Thing> {
    let floor = Solid {
        mesh: 0,
        material: Look { albedo: 0.7, metallic: 0.0, roughness: 1.0, emission: 0.0, image: 7, masked: true },
        translation: Vec3::new(0.0, 0.0, -2.0),
        scale: Vec3::splat(6.0),
        has_mesh: true,
        hidden: false,
        layer: 0,
        casts_shadows: true,
        translucent: 0.0,
    };
    let plain = Look { image: 0, masked: false, ..floor.material.clone() };
    let lamp = Solid {
        mesh: 1,
        material: Look { emission: 5.0, ..plain.clone() },
        translation: Vec3::new(1.5, 1.8, 1.0),
        scale: Vec3::splat(0.3),
        ..floor.clone()
    };
    let ball = Solid {
        mesh: 4,
        material: Look { image: 8, ..plain.clone() },
        translation: Vec3::new(-1.2, -0.8, 0.3),
        translucent: 0.2,
        ..lamp.clone()
    };
    let without_shadow = Solid { casts_shadows: false, translation: Vec3::new(-1.5, 1.5, -1.0), ..lamp.clone() };
    let on_another_layer = Solid { layer: 1, ..without_shadow.clone() };
    let solids = [floor, lamp, ball, without_shadow, on_another_layer].map(Thing::Solid);
    let body = |has_skin| Body { has_skin, material: plain.clone(), place: Vec3::new(0.9, -1.2, -0.8), time: 0.0 };
    let bodies = [true, false].map(|has_skin| Thing::Body(body(has_skin)));
    let lights = (0..3).map(|kind| Thing::Light(kind, 10.0, point(random)));
    solids.into_iter().chain(bodies).chain(lights).collect()
}

/// Adds the components of an object to an empty entity.
fn dress(rig: &mut Rig, entity: Entity, thing: &Thing) {
    match thing {
        Thing::Light(kind, power, place) => {
            let transform = Transform::from_translation(*place).looking_at(Vec3::new(0.0, 0.1, -2.0), Vec3::Y);
            match kind {
                0 => rig.insert(entity, (PointLight { intensity: 10.0 * power, ..default() }, transform)),
                1 => rig.insert(entity, (SpotLight { intensity: 10.0 * power, ..default() }, transform)),
                _ => rig.insert(entity, (DirectionalLight { illuminance: 0.1 * power, ..default() }, transform)),
            }
        }
        Thing::Solid(solid) => {
            let mesh = rig.add::<Mesh>(mesh(solid.mesh));
            let transform = Transform::from_translation(solid.translation).with_scale(solid.scale);
            let material = new_material(rig, &solid.material);
            rig.insert(entity, (Mesh3d(mesh), material, transform));
            flags(rig, entity, solid);
        }
        Thing::Body(body) => {
            let material = new_material(rig, &body.material);
            let mesh = rig.add::<Mesh>(if body.has_skin { tube() } else { sheet() });
            rig.insert(entity, (Mesh3d(mesh), material, Transform::default()));
            if body.has_skin {
                let skin = skinned::skin(rig.app.world_mut());
                rig.insert(entity, skin);
            }
            pose(rig, entity, body);
        }
    }
}

/// A new material, with a new image.
fn new_material(rig: &mut Rig, look: &Look) -> MeshMaterial3d<StandardMaterial> {
    let image = (look.image != 0).then(|| rig.add::<Image>(image(look.image)));
    MeshMaterial3d(rig.add(material(look, image)))
}

/// Bends a body and moves it.
fn pose(rig: &mut Rig, entity: Entity, body: &Body) {
    let foot = Transform::from_translation(body.place).with_scale(Vec3::splat(0.5));
    if body.has_skin {
        set_joints(rig, entity, &swaying(foot, body.time, 1.0));
    } else {
        rig.insert(entity, foot);
        set_weights(rig, entity, &[body.time.sin(), body.time.cos()]);
    }
}

/// Removes an object, and the joints of a skin.
fn remove(rig: &mut Rig, entity: Entity) {
    let world = rig.app.world_mut();
    let joints = world.get::<SkinnedMesh>(entity).map(|skin| skin.joints.clone());
    for entity in joints.into_iter().flatten().chain([entity]) {
        world.despawn(entity);
    }
}

/// Updates the marker components.
fn flags(rig: &mut Rig, entity: Entity, solid: &Solid) {
    rig.insert(
        entity,
        (if solid.hidden { Visibility::Hidden } else { Visibility::Inherited }, RenderLayers::layer(solid.layer)),
    );
    let mut entity = rig.app.world_mut().entity_mut(entity);
    if solid.casts_shadows {
        entity.remove::<NotShadowCaster>();
    } else {
        entity.insert(NotShadowCaster);
    }
    if !solid.has_mesh {
        entity.remove::<Mesh3d>();
    }
    if solid.translucent > 0.0 {
        let mean_free_path = solid.translucent * Vec3::new(1.0, 0.5, 0.3);
        entity.insert(Subsurface { mean_free_path, weight: 0.8 });
    } else {
        entity.remove::<Subsurface>();
    }
}

/// The objects of a scene, its camera and its sky, as random edits leave them.
pub struct Edited {
    things: Vec<(Entity, Thing)>,
    /// The first objects are never edited.
    kept: usize,
    outlook: Outlook,
    random: Random,
    /// How many images were added or edited.
    pub images: u64,
}

impl Edited {
    /// Spawns the first objects.
    pub fn new(rig: &mut Rig, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let outlook = Outlook { eye: Vec3::new(0.0, 0.0, 5.0), sky: [0.7, 1.0, 0.5] };
        outlook.apply_to(rig);
        let mut spawn = |thing: Thing| {
            let entity = rig.spawn_bundle(());
            dress(rig, entity, &thing);
            (entity, thing)
        };
        let things: Vec<_> = first_things(&mut random).into_iter().map(&mut spawn).collect();
        Self { kept: things.len(), things, outlook, random, images: 0 }
    }

    /// Shows the same scene in a new app.
    pub fn load(mut self, rig: &mut Rig) {
        self.outlook.apply_to(rig);
        // Lights and meshes are ordered by entity.
        self.things.sort_by_key(|(entity, _)| *entity);
        let mut entities: Vec<_> = self.things.iter().map(|_| rig.spawn_bundle(())).collect();
        entities.sort();
        for (entity, (_, thing)) in entities.into_iter().zip(&self.things) {
            dress(rig, entity, thing);
        }
    }

    /// Applies one random edit to the app and to the list of objects.
    pub fn edit(&mut self, rig: &mut Rig) {
        let Self { things, kept, outlook, random, images } = self;
        if random.below(10) == 0 {
            outlook.change(random);
            outlook.apply_to(rig);
            return;
        }
        if things.len() < 20 || (things.len() < 40 && random.below(4) == 0) {
            let thing = thing(random);
            let entity = rig.spawn_bundle(());
            dress(rig, entity, &thing);
            *images += u64::from(thing.image() != 0);
            things.push((entity, thing));
            return;
        }
        let chosen = *kept + random.below(things.len() - *kept);
        if random.below(7) == 0 {
            let (entity, _) = things.swap_remove(chosen);
            remove(rig, entity);
            return;
        }
        let (entity, thing) = &mut things[chosen];
        let image = thing.image();
        edit_thing(rig, *entity, thing, random);
        *images += u64::from(thing.image() != 0 && thing.image() != image);
    }
}

impl Outlook {
    fn change(&mut self, random: &mut Random) {
        if random.below(2) == 0 {
            self.eye = Vec3::new(random.range(-0.5, 0.5), random.range(-0.5, 0.5), random.range(4.0, 5.5));
        } else {
            self.sky = [random.range(0.0, 6.0), random.range(0.0, 2.0), random.range(0.2, 1.0)];
        }
    }

    fn apply_to(&self, rig: &mut Rig) {
        *rig.get_mut::<Transform>(rig.camera) =
            Transform::from_translation(self.eye).looking_at(Vec3::new(0.0, 0.0, -1.0), Vec3::Y);
        let [turn, intensity, green] = self.sky;
        let mut sky = rig.get_mut::<RestirEnvironment>(rig.camera);
        sky.rotation = Quat::from_rotation_y(turn);
        (sky.intensity, sky.color) = (intensity, LinearRgba::rgb(1.0, green, 1.0));
    }
}

/// Applies one random edit to an object.
fn edit_thing(rig: &mut Rig, entity: Entity, thing: &mut Thing, random: &mut Random) {
    match thing {
        Thing::Light(_, power, place) => {
            if random.below(2) == 0 {
                *power = random.range(1.0, 30.0);
            } else {
                *place = point(random);
            }
            dress(rig, entity, thing);
        }
        Thing::Body(body) => {
            body.time = random.range(0.0, 20.0);
            if random.below(4) == 0 {
                body.place = point(random);
            }
            pose(rig, entity, body);
        }
        Thing::Solid(solid) => edit_solid(rig, entity, solid, random),
    }
}

/// Applies one random edit to a solid object.
fn edit_solid(rig: &mut Rig, entity: Entity, solid: &mut Solid, random: &mut Random) {
    let material_of = |rig: &Rig| rig.material_of(entity);
    match random.below(11) {
        0 | 1 => {
            solid.translation = point(random);
            rig.get_mut::<Transform>(entity).translation = solid.translation;
        }
        2 => {
            solid.scale = scale(random);
            rig.get_mut::<Transform>(entity).scale = solid.scale;
        }
        // Edit the asset itself.
        3 => {
            solid.material = Look { image: solid.material.image, ..look(random) };
            let handle = material_of(rig);
            let image = rig.app.world().resource::<Assets<StandardMaterial>>().get(&handle);
            let image = image.and_then(|m| m.base_color_texture.clone());
            rig.edit(&handle, |m| *m = material(&solid.material, image));
        }
        // Use another asset.
        4 => {
            solid.material = look(random);
            let material = new_material(rig, &solid.material);
            rig.insert(entity, material);
        }
        // Change the image of its material.
        5 => {
            let handle = material_of(rig);
            let texture = rig.app.world().resource::<Assets<StandardMaterial>>().get(&handle);
            if let Some(texture) = texture.and_then(|m| m.base_color_texture.clone()) {
                solid.material.image = 1 + random.bits() % 1000;
                let new = image(solid.material.image);
                rig.edit(&texture, |image| *image = new);
            }
        }
        6 => {
            solid.mesh = random.below(MESHES);
            let new = mesh(solid.mesh);
            let handle = rig.app.world().get::<Mesh3d>(entity).map(|m| m.0.clone());
            match handle.filter(|_| random.below(2) == 0) {
                Some(handle) => rig.edit(&handle, |mesh| *mesh = new),
                None => {
                    let handle = rig.add::<Mesh>(new);
                    rig.insert(entity, Mesh3d(handle));
                }
            }
            solid.has_mesh = true;
        }
        7 => solid.hidden = !solid.hidden,
        8 => solid.layer = 1 - solid.layer,
        9 => solid.translucent = mean_free_path(random),
        _ if random.below(3) == 0 => solid.has_mesh = false,
        _ => solid.casts_shadows = !solid.casts_shadows,
    }
    flags(rig, entity, solid);
}
