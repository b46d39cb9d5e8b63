//! From radiance to the screen: exposure, tonemapping, Bevy's effects, and the scale of debug views.

use bevy::{
    anti_alias::taa::TemporalAntiAliasing,
    camera::Exposure,
    core_pipeline::{
        prepass::{DepthPrepass, MotionVectorPrepass},
        tonemapping::Tonemapping,
    },
    post_process::bloom::Bloom,
    prelude::*,
    render::camera::{MipBias, TemporalJitter},
};
use bevy_restir::{RadianceCapture, RestirStatistics, prelude::*};
use bevy_restir_support::exposure::{ev100_for, measure};

/// A new scene is measured after this many frames, because the first ones are noisy or not rendered yet.
const FRAMES: u32 = 3;
/// A picture with a smaller share of lit blocks counts as black.
const LEAST_LIT: f32 = 0.01;

/// A picture is black except for a few places.
#[derive(Message, Default)]
pub struct TooDark;

/// How the picture is shown.
#[derive(Component, Clone, Debug)]
pub struct Look {
    /// The curve for light. Debug views have none.
    pub tonemapping: Tonemapping,
    /// Whether a new scene chooses the exposure.
    pub auto_exposure: bool,
    /// Whether the next picture chooses the exposure.
    pub measure_next: bool,
    /// Bloom, of light only.
    pub bloom: bool,
    /// Bevy's temporal anti-aliasing, of light only.
    pub taa: bool,
    /// Center and radius of the scene, for the scale of the depth view.
    scene: (Vec3, f32),
    waited: u32,
    scaled_for: Option<(DebugView, Technique)>,
}

/// The components of a camera for its look. Without `ev100` new scenes choose the exposure.
pub fn look(ev100: Option<f32>) -> impl Bundle {
    let look = Look {
        tonemapping: Tonemapping::default(),
        auto_exposure: ev100.is_none(),
        measure_next: false,
        bloom: false,
        taa: false,
        scene: (Vec3::ZERO, 10.0),
        waited: 0,
        scaled_for: None,
    };
    let exposure = ev100.map_or(Exposure::default(), |ev100| Exposure { ev100 });
    (look, exposure, RadianceCapture::default())
}

pub fn plugin(app: &mut App) {
    app.add_message::<TooDark>().add_systems(Update, (expose, show_views, add_effects).chain());
}

impl Look {
    /// Adapts to a new scene.
    pub fn adapt(&mut self, center: Vec3, radius: f32) {
        self.measure_next = self.auto_exposure;
        self.scaled_for = None;
        self.scene = (center, radius);
    }
}

/// Measures a picture and chooses the exposure where `Look::measure_next` asks for it.
fn expose(
    statistics: Res<RestirStatistics>,
    mut cameras: Query<(&mut Look, &RadianceCapture, &mut Exposure, &Restir, Has<RestirEnvironment>)>,
    mut too_dark: MessageWriter<TooDark>,
) {
    for (mut look, capture, mut exposure, restir, has_environment) in &mut cameras {
        if !look.measure_next || restir.debug_view != DebugView::Off {
            continue;
        }
        if let Some(picture) = capture.take() {
            if look.waited >= FRAMES {
                let brightness = measure(picture.size, picture.mean());
                let is_dark = brightness.lit < LEAST_LIT && !has_environment;
                // A dark scene may get a sky, and is then measured again.
                (look.measure_next, look.waited) = (is_dark, 0);
                if is_dark {
                    too_dark.write_default();
                } else if let Some(luminance) = brightness.luminance {
                    exposure.ev100 = ev100_for(luminance);
                }
            }
            continue;
        }
        let report = statistics.report();
        if report.ready && report.samples > 0 {
            look.waited += 1;
            if look.waited == FRAMES {
                capture.request();
            }
        }
    }
}

/// Shows debug views without a curve and with a scale that fits their usual values.
fn show_views(mut cameras: Query<(&mut Look, &mut Restir, &mut Tonemapping, &Transform)>) {
    for (mut look, mut restir, mut tonemapping, place) in &mut cameras {
        let wanted = if restir.debug_view.shows_light() { look.tonemapping } else { Tonemapping::None };
        tonemapping.set_if_neq(wanted);
        let shown = Some((restir.debug_view, restir.technique));
        if look.scaled_for == shown {
            continue;
        }
        look.scaled_for = shown;
        let far = look.scene.0.distance(place.translation) + look.scene.1;
        let scale = 1.0 / white_of(&restir, far);
        if restir.debug_scale != scale {
            restir.debug_scale = scale;
        }
    }
}

/// Adds and removes Bevy's effects; debug views are shown without them.
pub fn add_effects(
    mut commands: Commands,
    cameras: Query<(Entity, &Look, &Restir, Has<Bloom>, Has<TemporalAntiAliasing>)>,
) {
    for (camera, look, restir, has_bloom, has_taa) in &cameras {
        let is_light = restir.debug_view.shows_light();
        let mut camera = commands.entity(camera);
        match (look.bloom && is_light, has_bloom) {
            (true, false) => _ = camera.insert(Bloom::NATURAL),
            (false, true) => _ = camera.remove::<Bloom>(),
            _ => {}
        }
        match (look.taa && is_light, has_taa) {
            (true, false) => _ = camera.insert(TemporalAntiAliasing::default()),
            // The components that it requires are removed, too. The plugin then jitters the camera itself.
            (false, true) => {
                camera.remove::<(TemporalAntiAliasing, TemporalJitter, MipBias, DepthPrepass, MotionVectorPrepass)>();
            }
            _ => {}
        }
    }
}

/// The value that a debug view shows as white at first.
fn white_of(restir: &Restir, far: f32) -> f32 {
    let bounces = restir.bounces.max(1) as f32;
    match (restir.debug_view, restir.technique) {
        (DebugView::Depth, _) => far,
        (DebugView::Motion, _) => 16.0,
        (DebugView::ReservoirConfidence, _) => 2.0 * restir.direct.reuse.confidence_cap.max(1.0),
        (DebugView::PathConfidence | DebugView::LightPathConfidence, _) => {
            2.0 * restir.paths.reuse.confidence_cap.max(1.0)
        }
        (DebugView::SubsurfaceConfidence, _) => 2.0 * restir.subsurface.reuse.confidence_cap.max(1.0),
        (DebugView::SubsurfaceDistances, _) => 4.0,
        (DebugView::LightPathCounts | DebugView::LightVertices, _) => 4.0 * restir.bdpt.light_paths.max(1.0),
        (DebugView::PathLengths | DebugView::LightPathLengths | DebugView::Bounces, _) => bounces,
        (DebugView::PathReconnections, _) => bounces + 1.0,
        (DebugView::PathTechniques, _) => bounces + 2.0,
        (DebugView::PathAges | DebugView::LightPathAges, _) => 32.0,
        (DebugView::PathJacobians, _) => 2.0,
        (DebugView::Rays, Technique::Di) => 16.0,
        (DebugView::Rays, Technique::Reference) => 2.0 * bounces,
        (DebugView::Rays, _) => 8.0 * bounces,
        _ => 1.0,
    }
}

/// Describes the value that is shown as white.
pub fn legend(restir: &Restir) -> Option<String> {
    let unit = match restir.debug_view {
        DebugView::Depth => "m",
        DebugView::Motion => "pixels",
        DebugView::ReservoirConfidence | DebugView::PathConfidence | DebugView::PathAges => "frames",
        DebugView::LightPathConfidence | DebugView::LightPathAges | DebugView::SubsurfaceConfidence => "frames",
        DebugView::SubsurfaceDistances => "d",
        DebugView::PathLengths | DebugView::LightPathLengths | DebugView::Bounces => "bounces",
        DebugView::PathTechniques | DebugView::LightVertices => "vertices",
        DebugView::LightPathCounts => "light paths",
        DebugView::PathReconnections => "(index of the vertex)",
        DebugView::Rays => "rays",
        DebugView::ReservoirWeights | DebugView::PathWeights | DebugView::LightPathWeights => "",
        DebugView::PathJacobians | DebugView::SubsurfaceWeights => "",
        _ => return None,
    };
    (restir.debug_scale > 0.0).then(|| format!("white: {:.3} {unit}", 1.0 / restir.debug_scale))
}
