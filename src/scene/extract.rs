//! From the main world: what is visible, lit and shaded, as plain lists.  Nothing is decided here but what exists.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::visibility::{InheritedVisibility, RenderLayers},
    ecs::prelude::*,
    light::{DirectionalLight, NotShadowCaster, PointLight, SpotLight},
    log::warn_once,
    math::{Affine3A, Vec3},
    mesh::{Mesh, Mesh3d, skinning::SkinnedMesh},
    pbr::{MeshMaterial3d, StandardMaterial},
    platform::collections::{HashMap, HashSet},
    render::{Extract, sync_world::MainEntity},
    transform::components::GlobalTransform,
};

use super::layers::{EVERYONE, LayerSets};
use crate::settings::EmissiveLuminance;

/// One drawn mesh.
#[derive(Clone, Debug)]
pub(crate) struct ExtractedInstance {
    pub entity: MainEntity,
    pub mesh: AssetId<Mesh>,
    pub material: AssetId<StandardMaterial>,
    pub world_from_object: Affine3A,
    /// Bits of the cameras that see it ([`LayerSets`]).
    pub seen_by: u32,
    /// Other rays than the camera's meet it.
    pub casts_shadows: bool,
    pub skinned: bool,
}

/// What a light that is not a mesh emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum AnalyticLight {
    /// Intensity in candela (for Rec. 709 white: lm/4π).
    Point { position: Vec3, intensity: Vec3 },
    /// As a point, within a cone; cosines of its inner and outer half angle.
    Spot { position: Vec3, intensity: Vec3, direction: Vec3, cos_inner: f32, cos_outer: f32 },
    /// Illuminance in lux at normal incidence.
    Directional { direction: Vec3, illuminance: Vec3 },
}

/// The scene of this frame as the main world has it.
#[derive(Resource, Default)]
pub(crate) struct ExtractedScene {
    pub instances: Vec<ExtractedInstance>,
    pub lights: Vec<(MainEntity, AnalyticLight)>,
    /// Those that not every camera has on its render layers, with the bits of the cameras that have not.
    pub hidden_lights: HashMap<MainEntity, u32>,
    /// Materials that were added or changed.
    pub materials: HashMap<AssetId<StandardMaterial>, StandardMaterial>,
    pub removed_materials: HashSet<AssetId<StandardMaterial>>,
    pub emissive_luminance: f32,
}

type InstanceData<'a> = (
    Entity,
    &'a Mesh3d,
    &'a MeshMaterial3d<StandardMaterial>,
    &'a GlobalTransform,
    &'a InheritedVisibility,
    Option<&'a RenderLayers>,
    Has<NotShadowCaster>,
    Has<SkinnedMesh>,
);

pub(crate) fn extract_scene(
    mut scene: ResMut<ExtractedScene>,
    instances: Extract<Query<InstanceData>>,
    points: Extract<Query<(Entity, &PointLight, &GlobalTransform, &InheritedVisibility)>>,
    spots: Extract<Query<(Entity, &SpotLight, &GlobalTransform, &InheritedVisibility)>>,
    suns: Extract<Query<(Entity, &DirectionalLight, &GlobalTransform, &InheritedVisibility)>>,
    mut events: Extract<MessageReader<AssetEvent<StandardMaterial>>>,
    materials: Extract<Res<Assets<StandardMaterial>>>,
    emissive_luminance: Extract<Res<EmissiveLuminance>>,
    layers: Extract<Query<&RenderLayers>>,
    sets: Res<LayerSets>,
) {
    let scene = &mut *scene;
    scene.emissive_luminance = emissive_luminance.0;
    if !(scene.emissive_luminance >= 0.0 && scene.emissive_luminance.is_finite()) {
        warn_once!("restir: EmissiveLuminance is {}; 0 is used", scene.emissive_luminance);
        scene.emissive_luminance = 0.0;
    }

    scene.instances.clear();
    scene.instances.extend(instances.iter().filter(|row| row.4.get()).filter_map(
        |(entity, mesh, material, transform, _, layers, not_shadow_caster, skinned)| {
            let seen_by = sets.seen_by(layers);
            (seen_by != 0).then(|| ExtractedInstance {
                entity: entity.into(),
                mesh: mesh.id(),
                material: material.id(),
                world_from_object: transform.affine(),
                seen_by,
                casts_shadows: !not_shadow_caster,
                skinned,
            })
        },
    ));
    // A stable order keeps light ids and the top level the same from frame to frame.
    scene.instances.sort_unstable_by_key(|i| *i.entity);

    scene.lights.clear();
    for (entity, light, transform, visible) in &points {
        if visible.get() {
            let intensity = rgb(light.color) * (light.intensity / (4.0 * core::f32::consts::PI));
            scene.lights.push((entity.into(), AnalyticLight::Point { position: transform.translation(), intensity }));
        }
    }
    for (entity, light, transform, visible) in &spots {
        if visible.get() {
            scene.lights.push((
                entity.into(),
                AnalyticLight::Spot {
                    position: transform.translation(),
                    intensity: rgb(light.color) * (light.intensity / (4.0 * core::f32::consts::PI)),
                    direction: forward(transform),
                    cos_inner: light.inner_angle.cos(),
                    cos_outer: light.outer_angle.cos(),
                },
            ));
        }
    }
    for (entity, light, transform, visible) in &suns {
        if visible.get() {
            let illuminance = rgb(light.color) * light.illuminance;
            let direction = forward(transform);
            scene.lights.push((entity.into(), AnalyticLight::Directional { direction, illuminance }));
        }
    }
    scene.lights.sort_unstable_by_key(|(entity, _)| **entity);
    // Bevy's lights shine for the cameras that they share a layer with.
    let hidden = &mut scene.hidden_lights;
    hidden.clear();
    scene.lights.retain(|(entity, _)| {
        let seen_by = sets.seen_by(layers.get(**entity).ok());
        if seen_by != EVERYONE {
            hidden.insert(*entity, EVERYONE & !seen_by);
        }
        seen_by != 0
    });

    scene.materials.clear();
    scene.removed_materials.clear();
    for event in events.read() {
        match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => {
                if let Some(material) = materials.get(*id) {
                    scene.materials.insert(*id, material.clone());
                }
            }
            AssetEvent::Removed { id } | AssetEvent::Unused { id } => {
                scene.materials.remove(id);
                scene.removed_materials.insert(*id);
            }
            AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}

/// The way a light shines; NaN where its transform has none, and the light is left out.
fn forward(transform: &GlobalTransform) -> Vec3 {
    transform.affine().transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NAN)
}

fn rgb(color: bevy::color::Color) -> Vec3 {
    let c = color.to_linear();
    // Below 0 a light would take light away; NaN stays, and the light is left out.
    [c.red, c.green, c.blue].map(|c| if c < 0.0 { 0.0 } else { c }).into()
}
