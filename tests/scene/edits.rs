//! The picture does not depend on how the scene came about: after hundreds of random edits, many during loading, it equals that of a
//! fresh load.

use crate::support::{app::*, scenes::Random};
use bevy::{
    camera::visibility::RenderLayers, light::NotShadowCaster, prelude::*, render::render_resource::TextureFormat,
};
use bevy_restir::{Restir, SceneFeatures, Technique};

const EDITS: usize = 300;

/// An object of the scene: all that a fresh load needs.
#[derive(Clone, Debug, PartialEq)]
enum Thing {
    Solid(Solid),
    /// Kind, power, position.
    Light(usize, f32, Vec3),
}

#[derive(Clone, Debug, PartialEq)]
struct Solid {
    mesh: usize,
    material: Look,
    /// There is no rotation, because it would round differently in a fresh load.
    translation: Vec3,
    scale: Vec3,
    has_mesh: bool,
    hidden: bool,
    layer: usize,
    casts_shadows: bool,
}

/// The parameters of a material.
#[derive(Clone, Debug, PartialEq)]
struct Look {
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

fn thing(random: &mut Random) -> Thing {
    if random.below(4) == 0 {
        return Thing::Light(random.below(3), random.range(1.0, 30.0), point(random));
    }
    Thing::Solid(Solid {
        mesh: random.below(MESHES),
        material: look(random),
        translation: point(random),
        scale: scale(random),
        has_mesh: true,
        hidden: false,
        layer: 0,
        casts_shadows: true,
    })
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
    };
    let lamp = Solid {
        mesh: 1,
        material: Look { emission: 5.0, image: 0, masked: false, ..floor.material.clone() },
        translation: Vec3::new(1.5, 1.8, 1.0),
        scale: Vec3::splat(0.3),
        ..floor.clone()
    };
    let lights = (0..3).map(|kind| Thing::Light(kind, 10.0, point(random)));
    [Thing::Solid(floor), Thing::Solid(lamp)].into_iter().chain(lights).collect()
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
            let image = (solid.material.image != 0).then(|| rig.add::<Image>(image(solid.material.image)));
            let material = rig.add::<StandardMaterial>(material(&solid.material, image));
            let mesh = rig.add::<Mesh>(mesh(solid.mesh));
            let transform = Transform::from_translation(solid.translation).with_scale(solid.scale);
            rig.insert(entity, (Mesh3d(mesh), MeshMaterial3d(material), transform));
            flags(rig, entity, solid);
        }
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
}

/// Applies one random edit to the app and to the list of objects.
fn edit(rig: &mut Rig, things: &mut Vec<(Entity, Thing)>, random: &mut Random) {
    let kept = 5;
    if things.len() < 20 || (things.len() < 40 && random.below(4) == 0) {
        let thing = thing(random);
        let entity = rig.spawn_bundle(());
        dress(rig, entity, &thing);
        things.push((entity, thing));
        return;
    }
    let chosen = kept + random.below(things.len() - kept);
    if random.below(7) == 0 {
        let (entity, _) = things.swap_remove(chosen);
        rig.app.world_mut().despawn(entity);
        return;
    }
    let (entity, thing) = &mut things[chosen];
    match thing {
        Thing::Light(_, power, place) => {
            if random.below(2) == 0 {
                *power = random.range(1.0, 30.0);
            } else {
                *place = point(random);
            }
            dress(rig, *entity, thing);
        }
        Thing::Solid(solid) => edit_solid(rig, *entity, solid, random),
    }
}

/// Applies one random edit to a solid object.
fn edit_solid(rig: &mut Rig, entity: Entity, solid: &mut Solid, random: &mut Random) {
    let material_of = |rig: &Rig| rig.material_of(entity);
    match random.below(10) {
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
            let image = (solid.material.image != 0).then(|| rig.add::<Image>(image(solid.material.image)));
            let handle = rig.add::<StandardMaterial>(material(&solid.material, image));
            rig.insert(entity, MeshMaterial3d(handle));
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
        _ if random.below(3) == 0 => solid.has_mesh = false,
        _ => solid.casts_shadows = !solid.casts_shadows,
    }
    flags(rig, entity, solid);
}

fn rig() -> Option<Rig> {
    let mut rig = Rig::new(32, 24)?;
    rig.insert(rig.camera, sky(0.2));
    rig.set(|restir| *restir = Restir { technique: Technique::Reference, bounces: 3, ..plain() });
    Some(rig)
}

/// A picture of the reference tracer and one of paths, each with the numbers of instances, triangles and lights and the features of the scene.
fn pictures(rig: &mut Rig) -> [(Picture, [u64; 3], SceneFeatures); 2] {
    let pictures = [Technique::Reference, Technique::Pt].map(|technique| {
        rig.set(|restir| restir.technique = technique);
        let picture = rig.picture(6);
        let report = rig.report();
        (picture, [report.instances, report.triangles, report.lights], report.features)
    });
    rig.frames(2);
    assert_eq!(rig.report().uploaded_bytes, 0, "nothing is left to upload");
    rig.assert_sound();
    pictures
}

#[test]
fn three_hundred_edits_end_in_the_picture_of_a_fresh_load() {
    let Some(mut edited) = rig() else { return };
    let mut random = Random::new(7);
    let mut things = Vec::new();
    for thing in first_things(&mut random) {
        let entity = edited.spawn_bundle(());
        dress(&mut edited, entity, &thing);
        things.push((entity, thing));
    }
    edited.until_ready();
    for i in 0..EDITS {
        edit(&mut edited, &mut things, &mut random);
        // Some edits share a frame, some come a frame apart, and from time to time all loading may finish.
        if random.below(3) == 0 {
            edited.frame();
        }
        if i % 60 == 59 {
            assert!(edited.next().is_finite(), "after {i} edits");
            edited.until_ready();
        }
    }

    let of_edited = pictures(&mut edited);
    // One device after the other, so that the second one finds the pipelines of the first.
    drop(edited);
    // Lights and meshes are ordered by entity.
    things.sort_by_key(|(entity, _)| *entity);
    let mut fresh = rig().expect("there is an adapter");
    let mut entities: Vec<_> = things.iter().map(|_| fresh.spawn_bundle(())).collect();
    entities.sort();
    for (entity, (_, thing)) in entities.into_iter().zip(&things) {
        dress(&mut fresh, entity, thing);
    }
    for ((a, counts, features), (b, fresh_counts, fresh_features)) in of_edited.into_iter().zip(pictures(&mut fresh)) {
        assert_eq!(counts, fresh_counts, "instances, triangles, lights");
        assert!(features.contains(fresh_features));
        assert!(counts[0] > 8 && counts[2] > 20, "{counts:?}");
        let other = a.iter().zip(b.iter()).filter(|(a, b)| a != b).count();
        assert_eq!(other, 0, "{other} of {} pixels differ", a.pixels.len());
        assert!(a.mean() > 0.05 && a.is_finite());
    }
}

/// As in Bevy, where such an object is drawn until the last handle of its material is dropped.
#[test]
fn an_object_whose_material_is_taken_out_of_the_assets_stays() {
    let Some(mut rig) = Rig::new(16, 12) else { return };
    let entity = rig.spawn(square(8.0), lamp(2.0, 2.0, 2.0), Transform::default());
    let before = rig.picture(1).mean();
    let handle = rig.material_of(entity);
    rig.app.world_mut().resource_mut::<Assets<StandardMaterial>>().remove(&handle);
    rig.frames(3);
    let after = rig.picture(1).mean();
    assert!(before > 1.0 && after == before, "{before} and {after}");
}
