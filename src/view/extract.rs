//! Extracts `Restir` cameras: settings, environment, background and render layers.

use bevy::{
    asset::AssetId,
    camera::{Camera3d, ClearColor, visibility::RenderLayers},
    color::LinearRgba,
    ecs::{entity::Entities, prelude::*},
    image::Image,
    light::{EnvironmentMapLight, Skybox},
    log::warn,
    math::{Mat3, Vec3},
    platform::collections::HashMap,
    render::{Extract, MainWorld, camera::ExtractedCamera, sync_world::RenderEntity},
};

use super::{ViewPool, capture::RadianceCapture};
use crate::{
    cpu_times::{CpuTimes, Stage},
    scene::{extract::lights::MAX_LIGHT, geometry::render_layers::LayerSets},
    settings::{Reduction, Restir, RestirEnvironment},
    warned::Warned,
};

/// A `Restir` camera.
#[derive(Clone, Debug)]
pub(crate) struct ExtractedRestir {
    /// Settings of this frame.  A budget may have reduced them.
    pub settings: Restir,
    /// The settings that the app asked for, in their ranges.
    pub asked: Restir,
    pub environment: Option<ExtractedEnvironment>,
    /// The clear color, linear: visible where a camera ray misses everything and no environment is a backdrop.
    pub background: Vec3,
    /// Alpha of the clear color.
    pub background_alpha: f32,
    /// The camera has a clear color; otherwise the pixels of earlier cameras stay where its rays miss everything.
    pub has_backdrop: bool,
    /// A capture of this frame, and the number of its request.
    pub capture: Option<(RadianceCapture, u64)>,
    /// Bit of its render layers ([`LayerSets`]).
    pub layers: u32,
}

/// Component that an environment comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum EnvironmentKind {
    RestirEnvironment,
    Skybox,
    EnvironmentMapLight,
}

impl EnvironmentKind {
    fn name(self) -> &'static str {
        match self {
            Self::RestirEnvironment => "RestirEnvironment",
            Self::Skybox => "Skybox",
            Self::EnvironmentMapLight => "EnvironmentMapLight",
        }
    }
}

/// An invalid value of an environment, and its consequence.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EnvironmentProblem {
    kind: EnvironmentKind,
    property: &'static str,
    complaint: &'static str,
    consequence: &'static str,
}

/// Light from infinity around the scene, as one camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExtractedEnvironment {
    pub kind: EnvironmentKind,
    pub color: Vec3,
    pub image: Option<AssetId<Image>>,
    /// Environment from world space.
    pub rotation: Mat3,
}

impl ExtractedEnvironment {
    /// The camera's `RestirEnvironment`, else its `Skybox`, else its `EnvironmentMapLight`; and the problem if a value is invalid.
    fn of(
        own: Option<&RestirEnvironment>,
        skybox: Option<&Skybox>,
        light: Option<&EnvironmentMapLight>,
    ) -> (Option<Self>, Option<EnvironmentProblem>) {
        use EnvironmentKind as K;
        let skybox = skybox.and_then(|s| Some((s, s.image.as_ref()?)));
        let (kind, color, scale, image, rotation) = match (own, skybox, light) {
            (Some(e), ..) => (K::RestirEnvironment, e.color, e.intensity, e.image.as_ref(), e.rotation),
            (None, Some((s, image)), _) => (K::Skybox, LinearRgba::WHITE, s.brightness, Some(image), s.rotation),
            (None, None, Some(l)) => {
                (K::EnvironmentMapLight, LinearRgba::WHITE, l.intensity, Some(&l.specular_map), l.rotation)
            }
            (None, None, None) => return (None, None),
        };
        let problem =
            |property, complaint, consequence| Some(EnvironmentProblem { kind, property, complaint, consequence });
        let not_finite = "not finite";
        let not_rendered = "this environment is not rendered";
        if !scale.is_finite() {
            let property = if kind == K::Skybox { "brightness" } else { "intensity" };
            return (None, problem(property, not_finite, not_rendered));
        }
        // Bevy's optional assertions of `glam` forbid to normalize a rotation without a length.
        let length = rotation.length();
        if !(length.is_finite() && length > 0.0) {
            return (None, problem("rotation", "not finite, or has the length 0", not_rendered));
        }
        let rotation = Mat3::from_quat((rotation / length).conjugate());
        let color = [color.red, color.green, color.blue];
        let color_problem = match color.iter().all(|c| c.is_finite()) {
            true => None,
            false => problem("color", not_finite, "the channels that are not finite count as 0"),
        };
        let channel = |c: f32| if c.is_finite() { (c.max(0.0) * scale.max(0.0)).min(MAX_LIGHT) } else { 0.0 };
        let environment =
            Self { kind, color: color.map(channel).into(), image: image.map(|image| image.id()), rotation };
        (Some(environment), color_problem)
    }

    /// Whether the image must be a cube map.
    pub(crate) fn is_cube(self) -> bool {
        self.kind != EnvironmentKind::RestirEnvironment
    }

    /// Whether camera rays see it.
    pub(crate) fn is_backdrop(self) -> bool {
        self.kind != EnvironmentKind::EnvironmentMapLight
    }

    /// The image, and whether it must be a cube map.
    pub(crate) fn key(self) -> Option<(AssetId<Image>, bool)> {
        Some((self.image?, self.is_cube()))
    }
}

/// The cameras of this frame, by render entity.
#[derive(Resource, Default)]
pub(crate) struct ExtractedViews(pub HashMap<Entity, ExtractedRestir>);

type ViewData<'a> = (
    Entity,
    RenderEntity,
    &'a bevy::camera::Camera,
    Has<Camera3d>,
    &'a Restir,
    Option<&'a RestirEnvironment>,
    Option<&'a Skybox>,
    Option<&'a EnvironmentMapLight>,
    Option<&'a RadianceCapture>,
    Option<&'a RenderLayers>,
);

pub(crate) fn extract_views(
    mut views: ResMut<ExtractedViews>,
    mut pool: ResMut<ViewPool>,
    cameras: Extract<Query<ViewData>>,
    clear_color: Extract<Res<ClearColor>>,
    reduction: Extract<Res<Reduction>>,
    entities: Extract<&Entities>,
    mut warned: Local<Warned<(Entity, [&'static str; 2])>>,
    sets: Res<LayerSets>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractViews);
    views.0.clear();
    warned.begin_frame();
    warned.retain(|(camera, _)| entities.contains(*camera));
    for (camera_entity, entity, camera, is_3d, restir, own, skybox, light, capture, layers) in &cameras {
        if restir.reset {
            pool.requested_resets.insert(entity);
        }
        if !camera.is_active {
            continue;
        }
        if !is_3d {
            if warned.is_due((camera_entity, ["Restir", "Camera3d"])) {
                warn!("restir: camera {camera_entity} has no `Camera3d`, so that nothing lights it; insert one");
            }
            continue;
        }
        let mut asked = Restir { reset: pool.requested_resets.contains(&entity), ..restir.clone() };
        let (environment, problem) = ExtractedEnvironment::of(own, skybox, light);
        asked.clamp(&mut |problem| {
            if warned.is_due((camera_entity, problem.field())) {
                warn!("restir: camera {camera_entity}: {problem}");
            }
        });
        if let Some(EnvironmentProblem { kind, property, complaint, consequence }) = problem
            && warned.is_due((camera_entity, [kind.name(), property]))
        {
            warn!(
                "restir: camera {camera_entity}: the {property} of its {} is {complaint}; {consequence}",
                kind.name()
            );
        }
        let clear = match camera.clear_color {
            bevy::camera::ClearColorConfig::Default => clear_color.0.to_linear(),
            bevy::camera::ClearColorConfig::Custom(color) => color.to_linear(),
            bevy::camera::ClearColorConfig::None => bevy::color::LinearRgba::BLACK,
        };
        views.0.insert(
            entity,
            ExtractedRestir {
                settings: asked.reduced_by(**reduction),
                asked,
                environment,
                has_backdrop: !matches!(camera.clear_color, bevy::camera::ClearColorConfig::None),
                background: Vec3::new(clear.red, clear.green, clear.blue),
                background_alpha: if clear.alpha.is_finite() { clear.alpha.clamp(0.0, 1.0) } else { 1.0 },
                // A request that the app makes while this frame is rendered is for a later frame.
                capture: capture.and_then(|capture| Some((capture.clone(), capture.requested()?))),
                layers: sets.bit_of(layers),
            },
        );
    }
}

/// Clears `Restir::reset` after every extraction, so that a reset takes effect whenever in the frame the app set it.  The render world keeps
/// the request until the camera is rendered.
pub(crate) fn clear_reset(
    mut main_world: ResMut<MainWorld>,
    mut cameras: Local<Option<QueryState<&'static mut Restir>>>,
) {
    let cameras = cameras.get_or_insert_with(|| main_world.query());
    for mut restir in cameras.iter_mut(&mut main_world) {
        if restir.reset {
            restir.reset = false;
        }
    }
}

/// Whether a camera is rendered.  Bevy may have stopped extracting it while it still carries our components.
pub(crate) fn has_view(camera: Option<&ExtractedCamera>) -> bool {
    camera.is_some_and(|c| c.physical_viewport_size.is_some_and(|s| s.x > 0 && s.y > 0))
}
