//! From the main world: what is visible, lit and shaded, as plain lists.  Nothing is decided here but what exists.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::visibility::{InheritedVisibility, RenderLayers},
    ecs::prelude::*,
    light::{DirectionalLight, NotShadowCaster, PointLight, RectLight, SpotLight, SunDisk},
    log::warn_once,
    math::{Affine3A, Mat3, Quat, Vec2, Vec3},
    mesh::{Mesh, Mesh3d, morph::MeshMorphWeights, skinning::SkinnedMesh},
    pbr::{MeshMaterial3d, StandardMaterial},
    platform::collections::{HashMap, HashSet},
    render::{Extract, sync_world::MainEntity},
    transform::components::GlobalTransform,
};

use crate::scene::{
    geometry::render_layers::{ALL_CAMERAS, LayerSets},
    geometry::visibility_range::VisibilityRanges,
};
use crate::settings::{EmissiveLuminance, Restir};

/// One drawn mesh.
#[derive(Clone, Debug)]
pub(crate) struct ExtractedInstance {
    pub entity: MainEntity,
    pub mesh: AssetId<Mesh>,
    pub material: AssetId<StandardMaterial>,
    pub world_from_object: Affine3A,
    /// Bits of the cameras that see it ([`LayerSets`]).
    pub camera_mask: u32,
    /// Other rays than the camera's meet it.
    pub casts_shadows: bool,
    pub skinned: bool,
    pub morphed: bool,
}

/// What a light that is not a mesh emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum AnalyticLight {
    /// Intensity in candela (for Rec. 709 white: lm/4π); a ball where the radius is above 0.
    Point { position: Vec3, intensity: Vec3, radius: f32 },
    /// As a point, within a cone; cosines of its inner and outer half angle.
    Spot { position: Vec3, intensity: Vec3, direction: Vec3, cos_inner: f32, cos_outer: f32 },
    /// Illuminance in lux at normal incidence; a disc where its angular size (diameter, radians) is above 0.
    Directional { direction: Vec3, illuminance: Vec3, angular_size: f32 },
    /// Luminous power in lumens, along -Z of the rotation from a rectangle of this size.
    Rect { position: Vec3, rotation: Quat, power: Vec3, size: Vec2 },
}

impl AnalyticLight {
    /// A sun with a disc.  These come first in the table, so that rays find them.
    pub(crate) fn is_sun(&self) -> bool {
        matches!(self, Self::Directional { angular_size, .. } if is_size(*angular_size))
    }
}

/// Something that has an extent.
pub(crate) fn is_size(size: f32) -> bool {
    size > 0.0 && size.is_finite()
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
    /// Some camera wants energy compensation.
    pub energy_compensation: bool,
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
    Has<MeshMorphWeights>,
);

pub(crate) fn extract_scene(
    mut scene: ResMut<ExtractedScene>,
    instances: Extract<Query<InstanceData>>,
    points: Extract<Query<(Entity, &PointLight, &GlobalTransform, &InheritedVisibility)>>,
    spots: Extract<Query<(Entity, &SpotLight, &GlobalTransform, &InheritedVisibility)>>,
    suns: Extract<Query<(Entity, &DirectionalLight, Option<&SunDisk>, &GlobalTransform, &InheritedVisibility)>>,
    rects: Extract<Query<(Entity, &RectLight, &GlobalTransform, &InheritedVisibility)>>,
    mut events: Extract<MessageReader<AssetEvent<StandardMaterial>>>,
    materials: Extract<Res<Assets<StandardMaterial>>>,
    emissive_luminance: Extract<Res<EmissiveLuminance>>,
    layers: Extract<Query<&RenderLayers>>,
    sets: Res<LayerSets>,
    ranges: Extract<VisibilityRanges>,
    cameras: Extract<Query<&Restir>>,
) {
    let scene = &mut *scene;
    scene.energy_compensation = cameras.iter().any(|restir| restir.energy_compensation);
    scene.emissive_luminance = emissive_luminance.0;
    if !(scene.emissive_luminance >= 0.0 && scene.emissive_luminance.is_finite()) {
        warn_once!("restir: EmissiveLuminance is {}; 0 is used", scene.emissive_luminance);
        scene.emissive_luminance = 0.0;
    }

    scene.instances.clear();
    scene.instances.extend(instances.iter().filter(|row| row.4.get()).filter_map(
        |(entity, mesh, material, transform, _, layers, not_shadow_caster, skinned, morphed)| {
            let camera_mask = sets.camera_mask(layers);
            (camera_mask != 0).then(|| ExtractedInstance {
                entity: entity.into(),
                mesh: mesh.id(),
                material: material.id(),
                world_from_object: transform.affine(),
                camera_mask,
                casts_shadows: !not_shadow_caster,
                skinned,
                morphed,
            })
        },
    ));
    if let Some(eye) = ranges.eye() {
        scene.instances.retain(|instance| !ranges.hides(*instance.entity, eye));
    }
    // A stable order keeps light ids and the top level the same from frame to frame.
    scene.instances.sort_unstable_by_key(|i| *i.entity);

    scene.lights.clear();
    for (entity, light, transform, visible) in &points {
        if visible.get() {
            let intensity = rgb(light.color) * (light.intensity / (4.0 * core::f32::consts::PI));
            let (position, radius) = (transform.translation(), light.radius);
            scene.lights.push((entity.into(), AnalyticLight::Point { position, intensity, radius }));
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
    for (entity, light, disk, transform, visible) in &suns {
        if visible.get() {
            let illuminance = rgb(light.color) * light.illuminance;
            let direction = forward(transform);
            // A disc that is switched off leaves the light; how bright it looks does not change how much light it gives.
            let angular_size = disk.map_or(0.0, |disk| if disk.intensity == 0.0 { 0.0 } else { disk.angular_size });
            scene.lights.push((entity.into(), AnalyticLight::Directional { direction, illuminance, angular_size }));
        }
    }
    for (entity, light, transform, visible) in &rects {
        if visible.get() {
            let (x, y, rotation) = rect_axes(transform);
            scene.lights.push((
                entity.into(),
                AnalyticLight::Rect {
                    position: transform.translation(),
                    rotation,
                    power: rgb(light.color) * light.intensity,
                    size: Vec2::new(light.width * x, light.height * y),
                },
            ));
        }
    }
    scene.lights.sort_unstable_by_key(|(entity, light)| (!light.is_sun(), **entity));
    // Bevy's lights shine for the cameras that they share a layer with.
    let hidden = &mut scene.hidden_lights;
    hidden.clear();
    scene.lights.retain(|(entity, _)| {
        let camera_mask = sets.camera_mask(layers.get(**entity).ok());
        if camera_mask != ALL_CAMERAS {
            hidden.insert(*entity, ALL_CAMERAS & !camera_mask);
        }
        camera_mask != 0
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

/// Scale along x and y, and the rotation; NaN where there is none.
fn rect_axes(transform: &GlobalTransform) -> (f32, f32, Quat) {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| transform.affine().transform_vector3(axis));
    // The way that it shines is kept, then its width; a mirrored rectangle is one.
    let z_axis = z.try_normalize().or_else(|| x.cross(y).try_normalize()).unwrap_or(Vec3::NAN);
    let x_axis = (x - x.dot(z_axis) * z_axis).try_normalize().unwrap_or(Vec3::NAN);
    let axes = Mat3::from_cols(x_axis, z_axis.cross(x_axis), z_axis);
    let rotation =
        if axes.is_finite() { Quat::from_mat3(&axes).normalize() } else { Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0) };
    (x.length(), y.length(), rotation)
}

fn rgb(color: bevy::color::Color) -> Vec3 {
    let c = color.to_linear();
    // Below 0 a light would take light away; NaN stays, and the light is left out.
    [c.red, c.green, c.blue].map(|c| if c < 0.0 { 0.0 } else { c }).into()
}
