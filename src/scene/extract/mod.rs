//! Copies instances, lights and materials that have changed from the main world to the render world.
//!
//! The lists hold plain data.  The pools that read them decide later which elements fit the device.

pub(crate) mod instances;
pub(crate) mod lights;
mod poses;
mod users;

use bevy::{
    asset::{AssetEvent, AssetId, Assets},
    ecs::prelude::*,
    image::Image,
    log::warn_once,
    pbr::StandardMaterial,
    platform::collections::{HashMap, HashSet},
    render::{Extract, sync_world::MainEntity},
};

use crate::{
    cpu_times::{CpuTimes, Stage},
    scene::features::SceneFeatures,
    settings::{EmissiveLuminance, Restir, RestirExpected},
};
use instances::InstanceList;
use lights::AnalyticLight;

/// The scene of this frame, as the main world describes it.
#[derive(Resource, Default)]
pub(crate) struct ExtractedScene {
    pub instances: InstanceList,
    /// Suns with a disk first, then in the order of their entities.
    pub lights: Vec<(MainEntity, AnalyticLight)>,
    /// The lights were extracted again after the last update of the light table.
    pub lights_changed: bool,
    /// Lights that some camera does not have on its render layers, with the bits of these cameras.
    pub hidden_lights: HashMap<MainEntity, u32>,
    /// Materials that were added or changed since the pool of materials last took them.
    pub materials: HashMap<AssetId<StandardMaterial>, StandardMaterial>,
    pub removed_materials: HashSet<AssetId<StandardMaterial>>,
    /// The image of each material that has an emissive texture.
    pub emissive_image_of: HashMap<AssetId<StandardMaterial>, AssetId<Image>>,
    /// Luminance of an emissive value of 1, in cd/m².
    pub emissive_luminance: f32,
    /// Whether some camera uses energy compensation.
    pub energy_compensation: bool,
    /// Features of objects and lights that the app expects.
    pub expected: SceneFeatures,
    /// The lists are those of a new device: everything is extracted, whether it has changed or not.
    pub is_new: bool,
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
    expected: Extract<Res<RestirExpected>>,
    cameras: Extract<Query<&Restir>>,
) {
    scene.expected = SceneFeatures::of_expected(&expected);
    scene.energy_compensation = cameras.iter().any(|restir| restir.energy_compensation);
    scene.emissive_luminance = emissive_luminance.0;
    if !(scene.emissive_luminance >= 0.0 && scene.emissive_luminance.is_finite()) {
        warn_once!(
            "restir: EmissiveLuminance is {}, which is negative or not finite; 0 is used",
            scene.emissive_luminance
        );
        scene.emissive_luminance = 0.0;
    }
}

/// Extracts the materials that were added, changed or removed.
pub(crate) fn extract_materials(
    mut scene: ResMut<ExtractedScene>,
    mut events: Extract<MessageReader<AssetEvent<StandardMaterial>>>,
    materials: Extract<Res<Assets<StandardMaterial>>>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractMaterials);
    // Materials are extracted last, so that all lists have seen `is_new`.
    if core::mem::take(&mut scene.is_new) {
        materials.iter().for_each(|(id, material)| scene.insert_material(id, material));
    }
    for event in events.read() {
        match event {
            AssetEvent::Added { id } | AssetEvent::Modified { id } => {
                if let Some(material) = materials.get(*id) {
                    scene.insert_material(*id, material);
                }
            }
            AssetEvent::Unused { id } => scene.remove_material(*id),
            // As in Bevy, an asset that is taken out of `Assets` is drawn until its last handle is dropped.
            AssetEvent::Removed { .. } | AssetEvent::LoadedWithDependencies { .. } => {}
        }
    }
}
