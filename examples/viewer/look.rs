//! From radiance to the screen: exposure that fits what is seen, tonemapping, Bevy's effects, and debug views scaled to what a screen
//! can show.

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
use bevy_restir::{CapturedRadiance, RadianceCapture, RestirStatistics, prelude::*};

use super::{
    light::TooDark,
    load::{Arrived, Stage},
};

/// Frames of a new scene before it is measured: the first few are too noisy, or not rendered yet.
const FRAMES: u32 = 3;
/// Pixels a side whose light is one measurement.
const BLOCK: usize = 8;
/// Share of a picture that must be lit for it to be a picture.
const LEAST_LIT: f32 = 0.01;
/// What the logarithmic mean of the picture becomes.
const GREY: f32 = 0.18;

/// How the picture is shown.
#[derive(Component, Clone, Debug)]
pub struct Look {
    /// Of light; debug views are shown as they are.
    pub tonemapping: Tonemapping,
    /// New scenes are exposed by what they show.
    pub fits: bool,
    /// The next picture decides the exposure.
    pub measures: bool,
    /// Bright things glow; light only.
    pub glows: bool,
    /// Bevy's temporal anti-aliasing; of light only.
    pub smooths: bool,
    waited: u32,
    scaled_for: Option<(DebugView, Technique)>,
}

/// What the camera carries for its look; `ev100` where one was asked for.
pub fn look(ev100: Option<f32>) -> impl Bundle {
    let look = Look {
        tonemapping: Tonemapping::default(),
        fits: ev100.is_none(),
        measures: false,
        glows: false,
        smooths: false,
        waited: 0,
        scaled_for: None,
    };
    let exposure = ev100.map_or(Exposure::default(), |ev100| Exposure { ev100 });
    (look, exposure, RadianceCapture::default())
}

pub fn plugin(app: &mut App) {
    app.add_systems(Update, (measure_arrivals, expose, show_views, add_effects).chain());
}

fn measure_arrivals(mut arrived: MessageReader<Arrived>, mut looks: Query<&mut Look>) {
    if arrived.read().next().is_some() {
        for mut look in &mut looks {
            look.measures = look.fits;
            look.scaled_for = None;
        }
    }
}

/// Measures a picture where that is asked for.
fn expose(
    statistics: Res<RestirStatistics>,
    mut cameras: Query<(&mut Look, &RadianceCapture, &mut Exposure, &Restir, Has<RestirEnvironment>)>,
    mut too_dark: MessageWriter<TooDark>,
) {
    for (mut look, capture, mut exposure, restir, has_environment) in &mut cameras {
        if !look.measures || restir.debug_view != DebugView::Off {
            continue;
        }
        if let Some(picture) = capture.take() {
            if look.waited >= FRAMES {
                let (lit, radiance) = typical_luminance(&picture);
                let is_dark = lit < LEAST_LIT && !has_environment;
                // Once more, under the sky that is then lent.
                (look.measures, look.waited) = (is_dark, 0);
                if is_dark {
                    too_dark.write_default();
                } else if let Some(radiance) = radiance {
                    // exposure = 1/(1.2 · 2^ev100).
                    exposure.ev100 = (radiance / (1.2 * GREY)).log2().clamp(-40.0, 60.0);
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

/// Share of the picture that is lit, and the logarithmic mean of its luminance, cd/m².
fn typical_luminance(picture: &CapturedRadiance) -> (f32, Option<f32>) {
    let (width, height) = (picture.size.x as usize, picture.size.y as usize);
    let luminance: Vec<f32> = picture.mean().map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b).collect();
    let (mut logarithms, mut blocks) = (Vec::new(), 0.0);
    // Blocks of pixels, since single ones are noise.
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let rows = top..(top + BLOCK).min(height);
            let columns = left..(left + BLOCK).min(width);
            let pixels = rows.flat_map(|y| columns.clone().map(move |x| y * width + x));
            let (sum, count) = pixels.fold((0.0, 0.0), |(sum, count), i| (sum + luminance[i], count + 1.0));
            blocks += 1.0;
            if sum > 0.0 && sum < f32::MAX {
                logarithms.push((sum / count).log2());
            }
        }
    }
    let count = logarithms.len() as f32;
    (count / f32::max(blocks, 1.0), (count > 0.0).then(|| (logarithms.iter().sum::<f32>() / count).exp2()))
}

/// Debug views go to the screen without a curve, and scaled to what they usually hold.
fn show_views(stage: Res<Stage>, mut cameras: Query<(&mut Look, &mut Restir, &mut Tonemapping, &Transform)>) {
    for (mut look, mut restir, mut tonemapping, place) in &mut cameras {
        let wanted = if restir.debug_view == DebugView::Off { look.tonemapping } else { Tonemapping::None };
        tonemapping.set_if_neq(wanted);
        let shown = Some((restir.debug_view, restir.technique));
        if look.scaled_for == shown {
            continue;
        }
        look.scaled_for = shown;
        let far = stage.shown.as_ref().map_or(1.0, |s| s.centre.distance(place.translation) + s.radius);
        let scale = 1.0 / white_of(&restir, far);
        if restir.debug_scale != scale {
            restir.debug_scale = scale;
        }
    }
}

/// What is asked for of Bevy's effects, and is not to be seen on debug views.
pub fn add_effects(
    mut commands: Commands,
    cameras: Query<(Entity, &Look, &Restir, Has<Bloom>, Has<TemporalAntiAliasing>)>,
) {
    for (camera, look, restir, glows, smooths) in &cameras {
        let is_light = restir.debug_view == DebugView::Off;
        let mut camera = commands.entity(camera);
        match (look.glows && is_light, glows) {
            (true, false) => _ = camera.insert(Bloom::NATURAL),
            (false, true) => _ = camera.remove::<Bloom>(),
            _ => {}
        }
        match (look.smooths && is_light, smooths) {
            (true, false) => _ = camera.insert(TemporalAntiAliasing::default()),
            // What it needs goes as well: our own jitter takes the place of its.
            (false, true) => {
                camera.remove::<(TemporalAntiAliasing, TemporalJitter, MipBias, DepthPrepass, MotionVectorPrepass)>();
            }
            _ => {}
        }
    }
}

/// What a view shows as white, at first.
fn white_of(restir: &Restir, far: f32) -> f32 {
    let bounces = restir.bounces.max(1) as f32;
    match (restir.debug_view, restir.technique) {
        (DebugView::Depth, _) => far,
        (DebugView::Motion, _) => 16.0,
        (DebugView::ReservoirConfidence, _) => 2.0 * restir.direct.confidence_cap.max(1.0),
        (DebugView::PathConfidence, _) => 2.0 * restir.paths.confidence_cap.max(1.0),
        (DebugView::PathLengths | DebugView::Bounces, _) => bounces,
        (DebugView::PathReconnections, _) => bounces + 1.0,
        (DebugView::PathAges, _) => 32.0,
        (DebugView::PathJacobians, _) => 2.0,
        (DebugView::Rays, Technique::Di) => 16.0,
        (DebugView::Rays, Technique::Reference) => 2.0 * bounces,
        (DebugView::Rays, _) => 8.0 * bounces,
        _ => 1.0,
    }
}

/// What white stands for.
pub fn legend(restir: &Restir) -> Option<String> {
    let unit = match restir.debug_view {
        DebugView::Depth => "m",
        DebugView::Motion => "pixels",
        DebugView::ReservoirConfidence | DebugView::PathConfidence | DebugView::PathAges => "frames",
        DebugView::PathLengths | DebugView::Bounces => "bounces",
        DebugView::PathReconnections => "th vertex",
        DebugView::Rays => "rays",
        DebugView::ReservoirWeights | DebugView::PathWeights | DebugView::PathJacobians => "",
        _ => return None,
    };
    (restir.debug_scale > 0.0).then(|| format!("white: {:.3} {unit}", 1.0 / restir.debug_scale))
}
