//! Copies the visible instances, the lights and the changed materials from the main world to the render world.
//!
//! The lists hold plain data and have a stable order.  What the device can show of them is decided later, by the pools that read them.

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    camera::visibility::{InheritedVisibility, RenderLayers},
    ecs::{prelude::*, system::SystemParam},
    image::Image,
    light::{DirectionalLight, NotShadowCaster, PointLight, RectLight, SpotLight, SunDisk},
    log::warn_once,
    math::{Affine3A, Mat3, Quat, Vec2, Vec3},
    mesh::{
        Mesh, Mesh3d,
        morph::{MeshMorphWeights, MorphWeights},
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    pbr::{MeshMaterial3d, StandardMaterial},
    platform::collections::{HashMap, HashSet},
    render::{Extract, sync_world::MainEntity},
    transform::components::GlobalTransform,
};
use core::f32::consts::PI;

use crate::cpu_times::{CpuTimes, Stage};
use crate::scene::{
    geometry::render_layers::{ALL_CAMERAS, LayerSets},
    geometry::rig::Pose,
    geometry::visibility_range::VisibilityRanges,
};
use crate::settings::{EmissiveLuminance, Restir, RestirIgnore, RestirMaterial, Subsurface};

/// A mesh instance that at least one camera sees.
#[derive(Clone, Debug)]
pub(crate) struct ExtractedInstance {
    pub entity: MainEntity,
    pub mesh: AssetId<Mesh>,
    pub material: AssetId<StandardMaterial>,
    pub world_from_object: Affine3A,
    /// Bits of the cameras that see it ([`LayerSets`]).
    pub camera_mask: u32,
    /// Rays other than the camera's can hit it.
    pub casts_shadows: bool,
    /// Bevy draws it, so that the camera's rays pass it.
    pub is_stand_in: bool,
    /// `None` if it has neither a skin nor morph targets.
    pub pose: Option<Pose>,
    pub subsurface: Option<Subsurface>,
}

/// A light component of Bevy.  A light whose transform has no direction has NaN in it, and the light table leaves it out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum AnalyticLight {
    /// Intensity in candela (lm/4π for white in Rec. 709).  A radius above 0 makes it a sphere.
    Point { position: Vec3, intensity: Vec3, radius: f32 },
    /// A point light with a cone, given by the cosines of its inner and outer half angle.
    Spot { position: Vec3, intensity: Vec3, direction: Vec3, cos_inner: f32, cos_outer: f32 },
    /// Illuminance in lux at normal incidence.  An angular size (diameter in radians) above 0 makes it a disk.
    Directional { direction: Vec3, illuminance: Vec3, angular_size: f32 },
    /// Luminous power in lumens, emitted along -Z of the rotation by a rectangle of this size.
    Rect { position: Vec3, rotation: Quat, power: Vec3, size: Vec2 },
}

impl AnalyticLight {
    fn point(light: &PointLight, transform: &GlobalTransform) -> Self {
        let intensity = bounded(rgb(light.color) * (light.intensity / (4.0 * PI)));
        Self::Point { position: transform.translation(), intensity, radius: light.radius }
    }

    fn spot(light: &SpotLight, transform: &GlobalTransform) -> Self {
        Self::Spot {
            position: transform.translation(),
            intensity: bounded(rgb(light.color) * (light.intensity / (4.0 * PI))),
            direction: forward(transform),
            cos_inner: light.inner_angle.cos(),
            cos_outer: light.outer_angle.cos(),
        }
    }

    fn directional(light: &DirectionalLight, disk: Option<&SunDisk>, transform: &GlobalTransform) -> Self {
        let illuminance = bounded(rgb(light.color) * light.illuminance);
        // Bevy draws no disk where `SunDisk::intensity` is 0.  Other values only change how bright Bevy draws it, not the illuminance.
        let angular_size = disk.map_or(0.0, |disk| if disk.intensity == 0.0 { 0.0 } else { disk.angular_size });
        Self::Directional { direction: forward(transform), illuminance, angular_size }
    }

    fn rect(light: &RectLight, transform: &GlobalTransform) -> Self {
        let (x, y, rotation) = rect_axes(transform);
        Self::Rect {
            position: transform.translation(),
            rotation,
            power: bounded(rgb(light.color) * light.intensity),
            size: Vec2::new(light.width * x, light.height * y),
        }
    }

    /// Whether it is a sun with a disk.  These come first in the light table, so that shaders can test a ray against all of them.
    pub(crate) fn is_sun(&self) -> bool {
        matches!(self, Self::Directional { illuminance, angular_size, .. }
            if is_size(*angular_size) && is_radiance(disk_radiance(*illuminance, *angular_size)))
    }
}

/// Greatest intensity, illuminance, power or radiance of a light.  Products of one of them and a few other numbers must not overflow.
pub(crate) const MAX_LIGHT: f32 = 1e30;

/// A light's brightness, at most [`MAX_LIGHT`].  Brightness that is not finite stays as it is, so that the light table leaves the light out.
fn bounded(brightness: Vec3) -> Vec3 {
    brightness.to_array().map(|c| if c.is_finite() { c.min(MAX_LIGHT) } else { c }).into()
}

/// Whether shaders can use a radiance.
pub(crate) fn is_radiance(radiance: Vec3) -> bool {
    radiance.to_array().iter().all(|c| *c <= MAX_LIGHT)
}

/// Radiance of a disk of this angular size (diameter in radians) with this illuminance at normal incidence: E/(π sin²).
pub(crate) fn disk_radiance(illuminance: Vec3, angular_size: f32) -> Vec3 {
    let sine = (0.5 * f64::from(angular_size).min(core::f64::consts::PI)).sin();
    illuminance.to_array().map(|e| (f64::from(e) / (core::f64::consts::PI * sine * sine)) as f32).into()
}

/// Whether a radius or length describes an extent: positive and finite.
pub(crate) fn is_size(size: f32) -> bool {
    size > 0.0 && size.is_finite()
}

/// The scene of this frame, as the main world describes it.
#[derive(Resource, Default)]
pub(crate) struct ExtractedScene {
    pub instances: Vec<ExtractedInstance>,
    pub lights: Vec<(MainEntity, AnalyticLight)>,
    /// Lights that some camera does not have on its render layers, with the bits of these cameras.
    pub hidden_lights: HashMap<MainEntity, u32>,
    /// Materials that were added or changed since the last frame.
    pub materials: HashMap<AssetId<StandardMaterial>, StandardMaterial>,
    pub removed_materials: HashSet<AssetId<StandardMaterial>>,
    /// The image of each material that has an emissive texture.
    pub emissive_image_of: HashMap<AssetId<StandardMaterial>, AssetId<Image>>,
    /// Luminance of an emissive value of 1, in cd/m².
    pub emissive_luminance: f32,
    /// Whether some camera uses energy compensation.
    pub energy_compensation: bool,
}

impl ExtractedScene {
    /// Images that a material uses as its emissive texture.
    pub(crate) fn emissive_images(&self) -> HashSet<AssetId<Image>> {
        self.emissive_image_of.values().copied().collect()
    }

    fn insert_material(&mut self, id: AssetId<StandardMaterial>, material: &StandardMaterial) {
        match &material.emissive_texture {
            Some(image) => self.emissive_image_of.insert(id, image.id()),
            None => self.emissive_image_of.remove(&id),
        };
        self.materials.insert(id, material.clone());
    }

    fn remove_material(&mut self, id: AssetId<StandardMaterial>) {
        self.emissive_image_of.remove(&id);
        self.materials.remove(&id);
        self.removed_materials.insert(id);
    }
}

/// Extracts the settings that apply to the whole scene.
pub(crate) fn extract_settings(
    mut scene: ResMut<ExtractedScene>,
    emissive_luminance: Extract<Res<EmissiveLuminance>>,
    cameras: Extract<Query<&Restir>>,
) {
    scene.energy_compensation = cameras.iter().any(|restir| restir.energy_compensation);
    scene.emissive_luminance = emissive_luminance.0;
    if !(scene.emissive_luminance >= 0.0 && scene.emissive_luminance.is_finite()) {
        warn_once!("restir: EmissiveLuminance is {}, which is not a luminance; 0 is used", scene.emissive_luminance);
        scene.emissive_luminance = 0.0;
    }
}

type InstanceData<'a> = (
    Entity,
    &'a Mesh3d,
    AnyOf<(&'static MeshMaterial3d<StandardMaterial>, &'static RestirMaterial)>,
    &'a GlobalTransform,
    &'a InheritedVisibility,
    Option<&'a RenderLayers>,
    Has<NotShadowCaster>,
    Option<&'a SkinnedMesh>,
    Option<&'a MeshMorphWeights>,
    Option<&'a Subsurface>,
);

/// What poses depend on besides the components of an instance.
#[derive(SystemParam)]
pub(crate) struct PoseSources<'w, 's> {
    inverse_bindposes: Option<Res<'w, Assets<SkinnedMeshInverseBindposes>>>,
    joints: Query<'w, 's, &'static GlobalTransform>,
    weights: Query<'w, 's, &'static MorphWeights>,
}

impl PoseSources<'_, '_> {
    /// The pose of an instance; `None` if nothing bends it.
    fn pose(&self, skin: Option<&SkinnedMesh>, morph: Option<&MeshMorphWeights>) -> Option<Pose> {
        if skin.is_none() && morph.is_none() {
            return None;
        }
        let weights = morph.map(|morph| match morph {
            MeshMorphWeights::Value { weights } => weights.clone(),
            MeshMorphWeights::Reference(entity) => {
                self.weights.get(*entity).map_or(Vec::new(), |weights| weights.weights().to_vec())
            }
        });
        let joints = skin.and_then(|skin| self.joints(skin)).unwrap_or_default();
        Some(Pose::new(joints, weights.unwrap_or_default()))
    }

    /// For each joint the transform from the mesh at rest to the world; `None` while the skin is not loaded.  A joint that does not exist
    /// counts as one without a transform.
    fn joints(&self, skin: &SkinnedMesh) -> Option<Vec<Affine3A>> {
        let bindposes = self.inverse_bindposes.as_ref()?.get(&skin.inverse_bindposes)?;
        let joints = skin.joints.iter().zip(bindposes.iter()).map(|(&joint, bindpose)| {
            let world_from_joint = self.joints.get(joint).map_or(Affine3A::IDENTITY, GlobalTransform::affine);
            world_from_joint * Affine3A::from_mat4(*bindpose)
        });
        Some(joints.collect())
    }
}

/// Extracts the mesh instances that at least one camera sees, in the order of their entities.
pub(crate) fn extract_instances(
    mut scene: ResMut<ExtractedScene>,
    instances: Extract<Query<InstanceData, Without<RestirIgnore>>>,
    sets: Res<LayerSets>,
    ranges: Extract<VisibilityRanges>,
    poses: Extract<PoseSources>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractInstances);
    let scene = &mut *scene;
    scene.instances.clear();
    scene.instances.extend(instances.iter().filter(|row| row.4.get()).filter_map(
        |(entity, mesh, materials, transform, _, layers, not_shadow_caster, skin, morph, subsurface)| {
            let camera_mask = sets.camera_mask(layers);
            let (own, stand_in) = materials;
            let material = stand_in.map(|material| material.0.id()).or(own.map(|material| material.id()))?;
            (camera_mask != 0).then(|| ExtractedInstance {
                entity: entity.into(),
                mesh: mesh.id(),
                material,
                world_from_object: transform.affine(),
                camera_mask,
                casts_shadows: !not_shadow_caster,
                is_stand_in: stand_in.is_some(),
                pose: poses.pose(skin, morph),
                subsurface: subsurface.copied(),
            })
        },
    ));
    if let Some(viewpoint) = ranges.viewpoint() {
        scene.instances.retain(|instance| !ranges.is_culled(*instance.entity, viewpoint));
    }
    // Queries have no fixed order.  Light ids and the top-level tree depend on the order, and must not change from frame to frame.
    scene.instances.sort_unstable_by_key(|i| *i.entity);
}

type LightData<'a, L> = (Entity, &'a L, &'a GlobalTransform, &'a InheritedVisibility);
type SunData<'a> = (Entity, &'a DirectionalLight, Option<&'a SunDisk>, &'a GlobalTransform, &'a InheritedVisibility);

/// Extracts the lights that at least one camera sees: suns with a disk first, then in the order of their entities.
pub(crate) fn extract_lights(
    mut scene: ResMut<ExtractedScene>,
    points: Extract<Query<LightData<PointLight>>>,
    spots: Extract<Query<LightData<SpotLight>>>,
    suns: Extract<Query<SunData>>,
    rects: Extract<Query<LightData<RectLight>>>,
    layers: Extract<Query<&RenderLayers>>,
    sets: Res<LayerSets>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractLights);
    let ExtractedScene { lights, hidden_lights, .. } = &mut *scene;
    lights.clear();
    for (entity, light, transform, visibility) in &points {
        if visibility.get() {
            lights.push((entity.into(), AnalyticLight::point(light, transform)));
        }
    }
    for (entity, light, transform, visibility) in &spots {
        if visibility.get() {
            lights.push((entity.into(), AnalyticLight::spot(light, transform)));
        }
    }
    for (entity, light, disk, transform, visibility) in &suns {
        if visibility.get() {
            lights.push((entity.into(), AnalyticLight::directional(light, disk, transform)));
        }
    }
    for (entity, light, transform, visibility) in &rects {
        if visibility.get() {
            lights.push((entity.into(), AnalyticLight::rect(light, transform)));
        }
    }
    lights.sort_unstable_by_key(|(entity, light)| (!light.is_sun(), **entity));
    // As in Bevy, a light illuminates what a camera sees only if it shares a render layer with the camera.
    hidden_lights.clear();
    lights.retain(|(entity, _)| {
        let camera_mask = sets.camera_mask(layers.get(**entity).ok());
        if camera_mask != ALL_CAMERAS {
            hidden_lights.insert(*entity, ALL_CAMERAS & !camera_mask);
        }
        camera_mask != 0
    });
}

/// Extracts the materials that were added, changed or removed.
pub(crate) fn extract_materials(
    mut scene: ResMut<ExtractedScene>,
    mut events: Extract<MessageReader<AssetEvent<StandardMaterial>>>,
    materials: Extract<Res<Assets<StandardMaterial>>>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractMaterials);
    scene.materials.clear();
    scene.removed_materials.clear();
    for event in events.read() {
        match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => {
                if let Some(material) = materials.get(*id) {
                    scene.insert_material(*id, material);
                }
            }
            AssetEvent::Removed { id } | AssetEvent::Unused { id } => scene.remove_material(*id),
            AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}

/// The direction in which a light points; NaN if the transform is degenerate.
fn forward(transform: &GlobalTransform) -> Vec3 {
    transform.affine().transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NAN)
}

/// Scale along x and y, and the rotation, which has NaN if the transform is degenerate.
fn rect_axes(transform: &GlobalTransform) -> (f32, f32, Quat) {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| transform.affine().transform_vector3(axis));
    // The rotation keeps the z axis, then as much of the x axis as possible.  A mirrored rectangle equals the rectangle.
    let z_axis = z.try_normalize().or_else(|| x.cross(y).try_normalize()).unwrap_or(Vec3::NAN);
    let x_axis = (x - x.dot(z_axis) * z_axis).try_normalize().unwrap_or(Vec3::NAN);
    let axes = Mat3::from_cols(x_axis, z_axis.cross(x_axis), z_axis);
    let rotation =
        if axes.is_finite() { Quat::from_mat3(&axes).normalize() } else { Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0) };
    (x.length(), y.length(), rotation)
}

/// The linear color without negative components, which would subtract light.  NaN is kept, so that the light table leaves the light out.
fn rgb(color: bevy::color::Color) -> Vec3 {
    let c = color.to_linear();
    [c.red, c.green, c.blue].map(|c| if c < 0.0 { 0.0 } else { c }).into()
}
