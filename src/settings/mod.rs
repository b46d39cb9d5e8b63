//! Settings that users choose: [`Restir`] and [`RestirEnvironment`] on a camera, [`Subsurface`], [`RestirMaterial`] and [`RestirIgnore`] on
//! an object, [`EmissiveLuminance`], [`RestirBudget`] and [`RestirExpected`] for the whole app.

mod bdpt;
mod budget;
mod debug_view;
mod denoiser;
mod direct;
mod environment;
mod expected;
mod jitter;
mod paths;
mod presets;
mod research;
mod reuse;
mod stand_in;
mod subsurface;
mod validate;

pub use bdpt::{Bdpt, LightTechniques, ShiftedMis};
pub use budget::RestirBudget;
pub(crate) use budget::{Reduction, least_scale};
pub use debug_view::DebugView;
pub use denoiser::Denoiser;
pub use direct::{BiasCorrection, Direct, VisibilityReuse};
pub use environment::RestirEnvironment;
pub use expected::RestirExpected;
pub use jitter::Jitter;
pub use paths::{Paths, Reconnection, SuffixRetrace};
pub use presets::Preset;
pub use research::{Research, ReservoirLayout};
pub use reuse::{Mis, Reuse, ReuseOrder};
pub use stand_in::{RestirIgnore, RestirMaterial};
pub use subsurface::{Subsurface, SubsurfaceSampling, SubsurfaceShift};

use bevy::{
    camera::{Exposure, Hdr},
    ecs::{
        component::Component,
        reflect::{ReflectComponent, ReflectResource},
        resource::Resource,
    },
    reflect::{Reflect, std_traits::ReflectDefault},
};
use validate::{Problem, Ranges};

/// Algorithm that computes the light of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum Technique {
    /// Path tracing without reuse: next-event estimation and BSDF sampling, joined by the balance heuristic, with Russian roulette.
    /// Accumulates frames for as long as the image does not change: slow and noisy in motion, and converges at rest.  Caustics of lights
    /// without a size are missing (darker; only [`Technique::Bdpt`] finds them).  All other light is unbiased, and all other techniques are
    /// compared with it.
    Reference,
    /// ReSTIR DI (Wyman and Panteleev 2021): emission and direct light only.  Values of `bounces` above 1 have no effect, and 0 leaves the
    /// emission only.  Settings: [`Direct`].
    Di,
    /// ReSTIR GI (Ouyang et al. 2021; candidates, Jacobian and limits as in Lanz 2025, 4.3 and 4.5.5) for indirect light, and
    /// [`Technique::Di`] for direct light: a complete image with up to `bounces` scattering events.  Settings: [`Paths`] and [`Direct`].
    Gi,
    /// ReSTIR PT (Lin et al. 2022, improved as in Lin et al. 2026): whole paths of up to `bounces` scattering events; glossy and mirrored
    /// light is reused, too.  Direct light has reservoirs of its own, as in [`Technique::Di`], unless [`Paths::separate_direct_light`] is
    /// off.  Settings: [`Paths`] and [`Direct`].
    #[default]
    Pt,
    /// ReSTIR BDPT (Hedstrom et al. 2025): for caustics and for lamps inside glass, which `Pt` hardly finds.  Whole paths of up to `bounces`
    /// scattering events are resampled as in [`Technique::Pt`]; some of them connect with a path from a lamp.  Light paths that the camera
    /// sees are resampled over time, each in the pixel that it lands in: caustics are smooth in still scenes, and follow lamps and objects
    /// that move.  What the camera sees in mirrors and through glass gains nothing from them.  In addition to the cost of `Pt`, a frame traces
    /// [`Bdpt::light_paths`] light paths for each pixel (one by default), and each pixel replays up to three more while the camera or
    /// something else moves.  Unbiased with [`Jitter::Always`].  Otherwise caustics are blurred by up to a pixel, because light paths that the
    /// camera sees are averaged over the pixel, and all other light is that of its center.  Settings: [`Bdpt`] and [`Paths`].
    Bdpt,
}

impl Technique {
    /// All techniques.
    pub const ALL: [Self; 5] = [Self::Reference, Self::Di, Self::Gi, Self::Pt, Self::Bdpt];

    /// Whether it computes light that bounces; [`Technique::Di`] alone does not.
    pub fn has_indirect_light(self) -> bool {
        self != Self::Di
    }
}

/// Lights the image of this camera, a `Camera3d`, by path tracing, in place of Bevy's own lighting.  Multisampling (`Msaa`) is turned off;
/// `TemporalAntiAliasing` smooths edges in its place.
///
/// The history of earlier frames survives when objects, lights and cameras move, and when objects, lights, images and skies appear, vanish or
/// change.  It restarts when
///
/// - an image changes and its pixels of the last frame are lost (`docs/limits.md`, "History restarts"), which happens in every frame while an
///   object shows an image that the GPU writes;
/// - shaders have been compiled for the first light of a kind, the first material with transmission, diffuse transmission, a thin wall, alpha
///   or a clearcoat, the first texture or vertex color in a scene with alpha, the first texture of transmission, specular, clearcoat or
///   anisotropy, or the first object that render layers hide;
/// - the first object with [`Subsurface`] appears, or the last one disappears; in [`Technique::Bdpt`] also the first or last object with
///   `NotShadowCaster` or [`RestirMaterial`] (an object or light that [`RestirExpected`] announces restarts nothing);
/// - the size of the image, the render layers, the kind of projection or `Camera::invert_culling` changes;
/// - one of these settings changes, except [`Direct::candidates`], `firefly_limit`, `denoiser`, `accumulate`, `debug_scale`,
///   [`Research::replay_compaction`], [`Research::rays_per_dispatch`], and all of [`Reuse`] but `order` and `temporal`;
///
/// and sometimes when the texture atlas is packed again, when the device has no free slot for an object that is edited, or after a frame in
/// which the camera was not rendered.  [`RestirReport::history_resets`](crate::RestirReport::history_resets) counts the restarts by reason.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// fn setup(mut commands: Commands) {
///     commands.spawn((Camera3d::default(), Restir::default()));
/// }
/// ```
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Component, Default)]
#[require(Hdr)]
pub struct Restir {
    /// Algorithm that computes the light of a pixel.
    pub technique: Technique,
    /// Greatest number of scattering events of a path: 0 shows emission only, 1 adds direct light, more add bounced light.  Cost grows with
    /// it.  Light that needs more events is missing (darker).  0 to 64; default 8.
    pub bounces: u32,
    /// Traced pixels for each pixel of the viewport, in width and in height.  With 0.5, a frame takes about a third of the time and of the
    /// memory for pixels.  Below 1, light is interpolated between traced pixels that show the same surface: edges of objects, depth and motion
    /// vectors keep their resolution, textures and shadows are blurred (with [`Restir::accumulate`], edges are, too).  Objects that no traced
    /// pixel shows take the light of others.
    /// [`RadianceCapture`](crate::RadianceCapture) holds the traced pixels.  0.25 to 1; default 1.
    pub resolution_scale: f32,
    /// Frames in which primary rays are jittered within the pixel, which smooths edges in means of frames.  No cost.  No bias, except for
    /// [`Technique::Bdpt`] (see there).  Default: [`Jitter::Auto`].
    pub jitter: Jitter,
    /// Adds the light that bounces more than once within a rough surface to specular lobes of reflection (Turquin 2019, as in Lanz 2025,
    /// 2.1.3), so that rough metals keep their brightness.  Without it, rough metals are too dark.  Cost: one texture read.  Default: on.
    pub energy_compensation: bool,
    /// Limits single very bright pixels (fireflies) of the displayed frame; reservoirs keep the full value.  The light that a pixel's surface
    /// scatters is limited to this number times that of the brightest of the eight pixels around it.  Only neighbors that show the same object
    /// count, and a pixel with fewer than three of them is not limited.  No effect on [`Technique::Reference`], with [`Restir::accumulate`] and
    /// on debug views.  Cost: eight neighboring pixels are read for each pixel and domain.  Biased: darker, by the light of such pixels;
    /// glints and texture details that are smaller than a pixel dim.  0: no limit; otherwise 1 to 1e6; default 2.5.
    pub firefly_limit: f32,
    /// Removes noise from the displayed frame by a filter over frames and pixels; reservoirs are not filtered.  Biased: blurs fine shadows.
    /// Default: [`Denoiser::ON`]; [`Denoiser::OFF`] for frames that something else filters or averages.
    pub denoiser: Denoiser,
    /// Selects one of 2^32 independent sequences of random numbers.  Default 0.
    pub seed: u32,
    /// Direct light, for [`Technique::Di`], [`Technique::Gi`], and [`Technique::Pt`] with [`Paths::separate_direct_light`]; its light subsets
    /// serve all techniques that resample.
    pub direct: Direct,
    /// Paths, for [`Technique::Gi`], [`Technique::Pt`] and [`Technique::Bdpt`].
    pub paths: Paths,
    /// Light paths, for [`Technique::Bdpt`].
    pub bdpt: Bdpt,
    /// Direct light that enters objects with [`Subsurface`], for [`Technique::Di`], [`Technique::Gi`], and [`Technique::Pt`] with
    /// [`Paths::separate_direct_light`].  Elsewhere such light is part of the paths, by [`Restir::paths`].
    pub subsurface: SubsurfaceSampling,
    /// Variants for measurements, which apps leave at their defaults.
    pub research: Research,
    /// Shows the mean of all frames for as long as the image does not change: for stills.  [`Technique::Reference`] always does so.  It
    /// turns [`Restir::firefly_limit`] and [`Restir::denoiser`] off, and [`Jitter::Auto`] jitters.  No cost; no bias.  Default: off.
    pub accumulate: bool,
    /// Shows a debug view instead of light.
    pub debug_view: DebugView,
    /// Multiplies debug views, so that meters and counts fit between 0 and 1.  [`DebugView::DiffuseLight`] and [`DebugView::SpecularLight`]
    /// have the camera's exposure instead.  0 to 1e6; default 1.
    pub debug_scale: f32,
    /// Drops the history of earlier frames and restarts the sequence of random numbers.  The plugin sets it back to `false` in the same frame.  If
    /// the camera is not rendered in that frame, for example because it is inactive, its next rendered frame restarts.
    pub reset: bool,
}

impl Default for Restir {
    /// [`Preset::Balanced`].
    fn default() -> Self {
        Self {
            technique: Technique::Pt,
            bounces: 8,
            resolution_scale: 1.0,
            jitter: Jitter::Auto,
            energy_compensation: true,
            firefly_limit: 2.5,
            denoiser: Denoiser::ON,
            seed: 0,
            direct: Direct::default(),
            paths: Paths::default(),
            bdpt: Bdpt::default(),
            subsurface: SubsurfaceSampling::default(),
            research: Research::default(),
            accumulate: false,
            debug_view: DebugView::Off,
            debug_scale: 1.0,
            reset: false,
        }
    }
}

impl Restir {
    /// Greatest value of [`Restir::bounces`].
    pub const MAX_BOUNCES: u32 = 64;
    /// Least value of [`Restir::resolution_scale`].
    pub const LEAST_RESOLUTION_SCALE: f32 = 0.25;

    /// Iterations of the denoiser's filter in a frame; 0 if it does not run.
    pub(crate) fn filter_iterations(&self) -> u32 {
        let denoises = self.technique != Technique::Reference && !self.accumulate && self.debug_view == DebugView::Off;
        if denoises { self.denoiser.iterations } else { 0 }
    }

    /// Whether camera paths are connected with light paths.
    pub(crate) fn connects_light_paths(&self) -> bool {
        self.technique == Technique::Bdpt && self.bdpt.connects()
    }

    /// Whether shifted paths keep the MIS weights of the paths that they are shifts of.
    pub(crate) fn copies_mis_weights(&self) -> bool {
        self.technique == Technique::Bdpt && self.bdpt.mis == ShiftedMis::Copied
    }

    /// Whether frames without Bevy's jitter are jittered.  `shows_earlier`: pixels without a surface show what lies behind the image.
    pub(crate) fn jitters(&self, shows_earlier: bool) -> bool {
        match self.jitter {
            Jitter::Auto => !shows_earlier && (self.accumulate || self.technique == Technique::Reference),
            Jitter::Always => true,
            Jitter::Never => false,
        }
    }

    /// Brings every field into its range.  Returns a warning for each field that it changed, one for a debug view that has nothing to show
    /// with the technique, and one for a [`Direct::bias_correction`] that is biased because [`Direct::visibility`] turns its rays off.  The
    /// plugin does the same with a copy of each camera's settings, and logs the warnings.
    pub fn validate(&mut self) -> Vec<String> {
        let mut warnings = Vec::new();
        self.clamp(&mut |problem| warnings.push(problem.to_string()));
        warnings
    }

    /// The settings that reservoirs of the last frame depend on: fields that only choose how many samples a frame takes, how it weights them or
    /// how it shows them have fixed values.
    pub(crate) fn history_key(&self) -> Self {
        let mut settings = self.clone();
        // `paths.candidates` stays: it is part of the MIS weights that reservoirs of paths store.
        settings.direct.candidates = 1;
        settings.firefly_limit = 0.0;
        settings.denoiser = Denoiser::OFF;
        settings.research.replay_compaction = true;
        settings.research.rays_per_dispatch = 0;
        for reuse in [&mut settings.direct.reuse, &mut settings.paths.reuse, &mut settings.subsurface.reuse] {
            *reuse = reuse.history_key();
        }
        settings
    }

    /// Brings every field into its range, and reports each field that it changes and the other problems of [`Restir::validate`].
    pub(crate) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path: "", report };
        ranges.count("bounces", &mut self.bounces, 0, Self::MAX_BOUNCES);
        ranges.number_or("resolution_scale", &mut self.resolution_scale, Self::LEAST_RESOLUTION_SCALE, 1.0, 1.0);
        ranges.number_or("debug_scale", &mut self.debug_scale, 0.0, 1e6, 1.0);
        let least_limit = if self.firefly_limit > 0.0 { 1.0 } else { 0.0 };
        ranges.number("firefly_limit", &mut self.firefly_limit, least_limit, 1e6);
        self.denoiser.clamp(report);
        self.direct.clamp(report);
        self.paths.clamp(report);
        self.bdpt.clamp(report);
        self.subsurface.clamp(report);
        self.research.clamp(report);
        if !self.debug_view.shows(self) {
            report(Problem::NothingToShow(self.debug_view, self.technique));
        }
    }
}

/// Scale of emission for the whole app, cd/m²: the luminance of a material with `emissive` = 1 and `emissive_exposure_weight` = 0, and of an
/// `unlit` material with a base color of 1.  Larger values make emissive surfaces and the light that they cast brighter.  An app whose
/// exposure is not Bevy's default sets it by [`EmissiveLuminance::for_exposure`], so that lamps look as bright as Bevy draws them.  At least 0
/// and finite; default about 998.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Reflect)]
#[reflect(Resource, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct EmissiveLuminance(pub f32);

impl EmissiveLuminance {
    /// The luminance with which lamps look as bright as Bevy draws them at this exposure: 1/exposure.
    pub fn for_exposure(exposure: &Exposure) -> Self {
        Self(1.0 / exposure.exposure())
    }
}

impl Default for EmissiveLuminance {
    /// [`Self::for_exposure`] of Bevy's default exposure.
    fn default() -> Self {
        Self::for_exposure(&Exposure::default())
    }
}

/// How rays are traced: [`RestirPlugin::backend`](crate::RestirPlugin::backend).
///
/// Both back ends give the same images, except for rays that pass an edge so closely that rounding decides; they differ in speed.
/// [`RestirReport::backend`](crate::RestirReport::backend) names the one in use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum RayBackend {
    /// Ray queries where a GPU has them, otherwise compute shaders.
    #[default]
    Auto,
    /// Compute shaders that traverse a two-level compressed BVH: on every device.
    Software,
    /// The device's ray queries.  Where it has none: compute shaders, with one warning.
    Hardware,
}
