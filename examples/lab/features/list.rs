//! What a scene may contain, and how the lab takes it out.

use bevy::{
    light::{EnvironmentMapLight, Skybox, SunDisk},
    mesh::{MeshVertexAttributeId, morph::MeshMorphWeights, skinning::SkinnedMesh},
    platform::collections::HashMap,
    prelude::*,
};
use bevy_restir::{RestirEnvironment, Subsurface};

/// A feature that a scene can be rendered without.
pub struct Feature {
    /// Completes the sentence "Without ..., a frame takes ...".
    pub name: &'static str,
    edit: Edit,
}

/// How a feature is found and taken out.
enum Edit {
    /// Takes it out of a material; false if the material lacks it.
    Material(fn(&mut StandardMaterial) -> bool),
    /// An attribute of meshes.
    Attribute(MeshVertexAttributeId),
    /// Whether an entity has it, how it is taken out of the entity, and the name of such an entity.
    Entity(fn(EntityRef) -> bool, fn(&mut EntityWorldMut), &'static str),
}

/// Perceptual roughness of surfaces that are no mirrors.
const ROUGH: f32 = 0.15;

/// All features.
pub const FEATURES: &[Feature] = &[
    // Lights.
    material("emission", |m| {
        let had = emits(m);
        m.emissive = LinearRgba::BLACK;
        had
    }),
    light::<PointLight>("point lights"),
    light::<SpotLight>("spot lights"),
    light::<DirectionalLight>("directional lights"),
    light::<RectLight>("rectangular lights"),
    Feature {
        name: "radii of point lights",
        edit: Edit::Entity(
            |entity| entity.get::<PointLight>().is_some_and(|light| light.radius > 0.0),
            |entity| {
                if let Some(mut light) = entity.get_mut::<PointLight>() {
                    light.radius = 0.0;
                }
            },
            "light",
        ),
    },
    Feature { name: "disks of suns", edit: components::<SunDisk>("light") },
    Feature {
        name: "the environment",
        edit: Edit::Entity(
            |entity| {
                entity.contains::<RestirEnvironment>()
                    || entity.contains::<Skybox>()
                    || entity.contains::<EnvironmentMapLight>()
            },
            |entity| {
                entity.remove::<(RestirEnvironment, Skybox, EnvironmentMapLight)>();
            },
            "camera",
        ),
    },
    // Lobes.
    material("clearcoats", |m| replaced(&mut m.clearcoat, 0.0)),
    material("anisotropy", |m| replaced(&mut m.anisotropy_strength, 0.0)),
    material("specular transmission", |m| replaced(&mut m.specular_transmission, 0.0)),
    material("diffuse transmission", |m| replaced(&mut m.diffuse_transmission, 0.0)),
    material("absorption", |m| {
        let transmits = m.specular_transmission > 0.0 || m.diffuse_transmission > 0.0;
        let absorbs = m.attenuation_color != Color::WHITE && m.attenuation_distance.is_finite();
        m.attenuation_distance = f32::INFINITY;
        transmits && absorbs && m.thickness > 0.0
    }),
    // They become slightly rough.
    material("mirrors and clear glass", |m| {
        let is_smooth = m.perceptual_roughness < ROUGH && !m.unlit;
        m.perceptual_roughness = m.perceptual_roughness.max(ROUGH);
        is_smooth
    }),
    Feature { name: "subsurface scattering", edit: components::<Subsurface>("object") },
    // Textures.
    material("color textures", |m| m.base_color_texture.take().is_some()),
    material("normal maps", |m| m.normal_map_texture.take().is_some()),
    material("textures of metal and roughness", |m| m.metallic_roughness_texture.take().is_some()),
    material("emissive textures", |m| emits(m) && m.emissive_texture.take().is_some()),
    material("textures of layers", |m| {
        [
            &mut m.specular_transmission_texture,
            &mut m.diffuse_transmission_texture,
            &mut m.thickness_texture,
            &mut m.clearcoat_texture,
            &mut m.clearcoat_roughness_texture,
            &mut m.clearcoat_normal_texture,
            &mut m.anisotropy_texture,
            &mut m.specular_texture,
            &mut m.specular_tint_texture,
        ]
        .map(|texture| texture.take().is_some())
        .contains(&true)
    }),
    // Surfaces become opaque.
    material("alpha masks", |m| {
        let has_mask = matches!(m.alpha_mode, AlphaMode::Mask(_) | AlphaMode::AlphaToCoverage);
        has_mask && replaced(&mut m.alpha_mode, AlphaMode::Opaque)
    }),
    material("alpha blending", |m| {
        let has_mask = matches!(m.alpha_mode, AlphaMode::Mask(_) | AlphaMode::AlphaToCoverage);
        !has_mask && replaced(&mut m.alpha_mode, AlphaMode::Opaque)
    }),
    // Meshes.
    Feature { name: "vertex colors", edit: Edit::Attribute(Mesh::ATTRIBUTE_COLOR.id) },
    // Objects keep the shape of the file.
    Feature {
        name: "skins and morph targets",
        edit: Edit::Entity(
            |entity| entity.contains::<SkinnedMesh>() || entity.contains::<MeshMorphWeights>(),
            |entity| {
                entity.remove::<(SkinnedMesh, MeshMorphWeights)>();
            },
            "object",
        ),
    },
];

const fn material(name: &'static str, change: fn(&mut StandardMaterial) -> bool) -> Feature {
    Feature { name, edit: Edit::Material(change) }
}

/// Lights of a kind, which are removed.
const fn light<T: Component>(name: &'static str) -> Feature {
    Feature { name, edit: components::<T>("light") }
}

/// The component of all entities, which are named by `noun`.
const fn components<T: Component>(noun: &'static str) -> Edit {
    Edit::Entity(
        |entity| entity.contains::<T>(),
        |entity| {
            entity.remove::<T>();
        },
        noun,
    )
}

/// Sets a field; false if it had the value.
fn replaced<T: PartialEq>(field: &mut T, value: T) -> bool {
    let differs = *field != value;
    *field = value;
    differs
}

fn emits(m: &StandardMaterial) -> bool {
    m.emissive.red.max(m.emissive.green).max(m.emissive.blue) > 0.0
}

impl Feature {
    /// Where a scene has it, such as "2 materials of 5 objects"; `None` if the scene lacks it.
    pub fn place(&self, world: &mut World) -> Option<String> {
        let (count, text) = match self.edit {
            Edit::Material(change) => {
                let used = users(world, |material: &MeshMaterial3d<StandardMaterial>| material.0.id());
                let assets = world.resource::<Assets<StandardMaterial>>();
                let has = |id| assets.get(id).is_some_and(|material: &StandardMaterial| change(&mut material.clone()));
                let objects: Vec<usize> = used.into_iter().filter(|(id, _)| has(*id)).map(|(_, users)| users).collect();
                let text = [counted(objects.len(), "material"), counted(objects.iter().sum(), "object")];
                (objects.len(), text.join(" of "))
            }
            Edit::Attribute(attribute) => {
                let used = users(world, |mesh: &Mesh3d| mesh.0.id());
                let assets = world.resource::<Assets<Mesh>>();
                // The main world may no longer have the data of a mesh.
                let has = |id| assets.get(id).is_some_and(|m| m.try_contains_attribute(attribute).unwrap_or(false));
                let count = used.into_keys().filter(|id| has(*id)).count();
                (count, counted(count, "mesh"))
            }
            Edit::Entity(has, _, noun) => {
                let count = world.query::<EntityRef>().iter(world).filter(|entity| has(*entity)).count();
                (count, counted(count, noun))
            }
        };
        (count > 0).then_some(text)
    }

    /// Takes it out of a scene.
    pub fn take_out(&self, world: &mut World) {
        match self.edit {
            Edit::Material(change) => {
                let used = users(world, |material: &MeshMaterial3d<StandardMaterial>| material.0.id());
                let mut assets = world.resource_mut::<Assets<StandardMaterial>>();
                for id in used.into_keys() {
                    if let Some(mut material) = assets.get_mut(id) {
                        change(&mut material);
                    }
                }
            }
            Edit::Attribute(attribute) => {
                let used = users(world, |mesh: &Mesh3d| mesh.0.id());
                let mut assets = world.resource_mut::<Assets<Mesh>>();
                for id in used.into_keys() {
                    if let Some(mut mesh) = assets.get_mut(id) {
                        // A mesh without the attribute, or without its data, stays as it is.
                        let _ = mesh.try_remove_attribute(attribute);
                    }
                }
            }
            Edit::Entity(has, change, _) => {
                let all: Vec<Entity> =
                    world.query::<EntityRef>().iter(world).filter(|entity| has(*entity)).map(|e| e.id()).collect();
                for entity in all {
                    change(&mut world.entity_mut(entity));
                }
            }
        }
    }
}

/// The assets in use, each with the number of its objects.
fn users<C: Component, A: Asset>(world: &mut World, id: fn(&C) -> AssetId<A>) -> HashMap<AssetId<A>, usize> {
    let mut users = HashMap::default();
    for component in world.query::<&C>().iter(world) {
        *users.entry(id(component)).or_insert(0) += 1;
    }
    users
}

fn counted(count: usize, noun: &str) -> String {
    let ending = match (count, noun.ends_with("sh")) {
        (1, _) => "",
        (_, true) => "es",
        (_, false) => "s",
    };
    format!("{count} {noun}{ending}")
}
