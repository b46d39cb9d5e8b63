//! `Restir` cameras of the main world, as the render world takes them.

use bevy::{
    asset::AssetId,
    camera::{ClearColor, visibility::RenderLayers},
    color::LinearRgba,
    ecs::prelude::*,
    image::Image,
    light::{EnvironmentMapLight, Skybox},
    log::warn,
    math::{Mat3, Vec3},
    platform::collections::{HashMap, HashSet},
    render::{Extract, MainWorld, camera::ExtractedCamera, sync_world::RenderEntity},
};

use super::capture::RadianceCapture;
use crate::{
    scene::geometry::render_layers::LayerSets,
    settings::{Restir, RestirEnvironment},
};

/// What a `Restir` camera shows.
#[derive(Clone, Debug)]
pub(crate) struct ExtractedRestir {
    pub settings: Restir,
    pub environment: Option<ExtractedEnvironment>,
    /// What the camera sees where there is no environment: the clear color, as the view target holds it.
    pub background: Vec3,
    /// It has a clear color; otherwise what earlier cameras have drawn stays.
    pub has_backdrop: bool,
    pub capture: Option<RadianceCapture>,
    /// Bit of its render layers.
    pub layers: u32,
}

/// Where an environment comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum EnvironmentKind {
    Own,
    Skybox,
    MapLight,
}

/// What is round the scene of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExtractedEnvironment {
    pub kind: EnvironmentKind,
    pub color: Vec3,
    pub image: Option<AssetId<Image>>,
    /// Environment from world.
    pub rotation: Mat3,
}

impl ExtractedEnvironment {
    /// The camera's own environment, else its `Skybox`, else its `EnvironmentMapLight`; and what is wrong with it.
    fn of(
        own: Option<&RestirEnvironment>,
        skybox: Option<&Skybox>,
        light: Option<&EnvironmentMapLight>,
    ) -> (Option<Self>, Option<String>) {
        use EnvironmentKind::*;
        let skybox = skybox.and_then(|s| Some((s, s.image.as_ref()?)));
        let (kind, color, scale, image, rotation) = match (own, skybox, light) {
            (Some(e), ..) => (Own, e.color, e.intensity, e.image.as_ref(), e.rotation),
            (None, Some((s, image)), _) => (Skybox, LinearRgba::WHITE, s.brightness, Some(image), s.rotation),
            (None, None, Some(l)) => (MapLight, LinearRgba::WHITE, l.intensity, Some(&l.specular_map), l.rotation),
            (None, None, None) => return (None, None),
        };
        let channel = |c: f32| if c.is_finite() { (c.max(0.0) * scale.max(0.0)).min(1e30) } else { 0.0 };
        let rotation = Mat3::from_quat(rotation.normalize().inverse());
        let name = match kind {
            Own => "RestirEnvironment",
            Skybox => "Skybox",
            MapLight => "EnvironmentMapLight",
        };
        if !scale.is_finite() || !rotation.is_finite() {
            let what = if scale.is_finite() { "a rotation" } else { "a brightness" };
            return (None, Some(format!("a {name} has {what} that is no finite number; it is left out")));
        }
        let color = Vec3::new(channel(color.red), channel(color.green), channel(color.blue));
        (Some(Self { kind, color, image: image.map(|image| image.id()), rotation }), None)
    }

    /// The image is a cube.
    pub(crate) fn is_cube(self) -> bool {
        self.kind != EnvironmentKind::Own
    }

    /// The camera sees it.
    pub(crate) fn is_backdrop(self) -> bool {
        self.kind != EnvironmentKind::MapLight
    }

    /// The image that is asked for, and whether as a cube.
    pub(crate) fn key(self) -> Option<(AssetId<Image>, bool)> {
        Some((self.image?, self.is_cube()))
    }
}

/// The cameras of this frame, by render entity.
#[derive(Resource, Default)]
pub(crate) struct ExtractedViews(pub HashMap<Entity, ExtractedRestir>);

type ViewData<'a> = (
    RenderEntity,
    &'a bevy::camera::Camera,
    &'a Restir,
    Option<&'a RestirEnvironment>,
    Option<&'a Skybox>,
    Option<&'a EnvironmentMapLight>,
    Option<&'a RadianceCapture>,
    Option<&'a RenderLayers>,
);

pub(crate) fn extract_views(
    mut views: ResMut<ExtractedViews>,
    cameras: Extract<Query<ViewData>>,
    clear_color: Extract<Res<ClearColor>>,
    mut warned: Local<HashSet<String>>,
    sets: Res<LayerSets>,
) {
    views.0.clear();
    for (entity, camera, restir, own, skybox, light, capture, layers) in &cameras {
        if !camera.is_active {
            continue;
        }
        let mut settings = restir.clone();
        let (environment, flaw) = ExtractedEnvironment::of(own, skybox, light);
        for warning in settings.validate().into_iter().chain(flaw) {
            if warned.insert(warning.clone()) {
                warn!("restir: {warning}");
            }
        }
        let clear = match camera.clear_color {
            bevy::camera::ClearColorConfig::Default => clear_color.0.to_linear(),
            bevy::camera::ClearColorConfig::Custom(color) => color.to_linear(),
            bevy::camera::ClearColorConfig::None => bevy::color::LinearRgba::BLACK,
        };
        views.0.insert(
            entity,
            ExtractedRestir {
                settings,
                environment,
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
