//! `Restir` cameras of the main world, as the render world takes them.

use bevy::{
    asset::AssetId,
    camera::{ClearColor, visibility::RenderLayers},
    ecs::prelude::*,
    image::Image,
    log::warn,
    math::{Mat3, Vec3},
    platform::collections::{HashMap, HashSet},
    render::{Extract, MainWorld, camera::ExtractedCamera, sync_world::RenderEntity},
};

use super::capture::RadianceCapture;
use crate::{
    scene::layers::LayerSets,
    settings::{Restir, RestirEnvironment},
};

/// What a `Restir` camera shows.
#[derive(Clone, Debug)]
pub(crate) struct ExtractedRestir {
    pub settings: Restir,
    pub environment: Option<ExtractedEnvironment>,
    /// What the camera sees where there is no environment: the clear colour, as the view target holds it.
    pub background: Vec3,
    /// It has a clear colour; otherwise what earlier cameras have drawn stays.
    pub has_backdrop: bool,
    pub capture: Option<RadianceCapture>,
    /// Bit of its render layers.
    pub layers: u32,
}

/// A `RestirEnvironment`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExtractedEnvironment {
    pub color: Vec3,
    pub image: Option<AssetId<Image>>,
    /// Environment from world.
    pub rotation: Mat3,
}

/// The cameras of this frame, by render entity.
#[derive(Resource, Default)]
pub(crate) struct ExtractedViews(pub HashMap<Entity, ExtractedRestir>);

type ViewData<'a> = (
    RenderEntity,
    &'a bevy::camera::Camera,
    &'a Restir,
    Option<&'a RestirEnvironment>,
    Option<&'a RadianceCapture>,
    Option<&'a RenderLayers>,
);

pub(crate) fn extract_views(
    mut views: ResMut<ExtractedViews>,
    cameras: Extract<Query<ViewData>>,
    clear_color: Extract<Res<ClearColor>>,
    mut said: Local<HashSet<String>>,
    sets: Res<LayerSets>,
) {
    views.0.clear();
    for (entity, camera, restir, environment, capture, layers) in &cameras {
        if !camera.is_active {
            continue;
        }
        let mut settings = restir.clone();
        for warning in settings.validate() {
            if said.insert(warning.clone()) {
                warn!("restir: {warning}");
            }
        }
        let clear = match camera.clear_color {
            bevy::camera::ClearColorConfig::Default => clear_color.0.to_linear(),
            bevy::camera::ClearColorConfig::Custom(color) => color.to_linear(),
            bevy::camera::ClearColorConfig::None => bevy::color::LinearRgba::BLACK,
        };
        let environment = environment.map(|e| {
            let scale = if e.intensity.is_finite() { e.intensity.max(0.0) } else { 0.0 };
            let channel = |c: f32| {
                if c.is_finite() { (c.max(0.0) * scale).min(1e30) } else { 0.0 }
            };
            ExtractedEnvironment {
                color: Vec3::new(channel(e.color.red), channel(e.color.green), channel(e.color.blue)),
                image: e.image.as_ref().map(|image| image.id()),
                rotation: Mat3::from_quat(e.rotation.normalize().inverse()),
            }
        });
        views.0.insert(
            entity,
            ExtractedRestir {
                settings,
                environment: environment.filter(|e| e.rotation.is_finite()),
                has_backdrop: !matches!(camera.clear_color, bevy::camera::ClearColorConfig::None),
                background: Vec3::new(clear.red, clear.green, clear.blue),
                capture: capture.cloned(),
                layers: sets.bit_of(layers),
            },
        );
    }
}

/// `Restir::reset` was taken: it clears itself here and nowhere else, so that it counts whenever it was set.
pub(crate) fn clear_reset(mut main_world: ResMut<MainWorld>) {
    let mut cameras = main_world.query::<&mut Restir>();
    for mut restir in cameras.iter_mut(&mut main_world) {
        if restir.reset {
            restir.reset = false;
        }
    }
}

/// Cameras that Bevy stopped extracting are no views, whatever they carry.
pub(crate) fn has_view(camera: Option<&ExtractedCamera>) -> bool {
    camera.is_some_and(|c| c.physical_viewport_size.is_some_and(|s| s.x > 0 && s.y > 0))
}
