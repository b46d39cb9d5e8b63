//! What a user sets: [`Restir`] and [`RestirEnvironment`] on a camera, [`EmissiveLuminance`] for the whole app.

use bevy::{
    asset::Handle,
    camera::Hdr,
    color::LinearRgba,
    ecs::{component::Component, reflect::ReflectComponent, resource::Resource},
    image::Image,
    math::Quat,
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// How light is carried from the scene to a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum Technique {
    /// Unidirectional path tracing: next-event estimation and BSDF sampling joined by the balance heuristic, Russian roulette,
    /// accumulated over frames for as long as nothing that it shows changes.  Unbiased; every other technique is held against it.
    #[default]
    Reference,
    /// ReSTIR DI (Wyman and Panteleev 2021, paper 003): emission and direct light, one bounce whatever `bounces` says (none where that
    /// is 0).  See [`Direct`].
    Di,
}

/// How the samples of a pixel and of its neighbours are weighed against each other when they are resampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[repr(u32)]
pub enum Mis {
    /// By confidence alone: dark where a neighbour could not have found a sample (biased).  No further evaluation.
    Uniform,
    /// By confidence among those that could have found it: unbiased with `mis_rays`, noisy.  k² evaluations for k neighbours.
    Valid,
    /// Generalised balance heuristic: unbiased with `mis_rays`.  k² evaluations.
    Balance,
    /// Each neighbour against the pixel's own sample: unbiased with `mis_rays`.  2k evaluations.
    Pairwise,
    /// As `Pairwise`, with a share kept for the pixel's own sample by its confidence: safest where neighbours have long histories.
    #[default]
    DefensivePairwise,
    /// As `Pairwise`, with 1/(k + 1) kept for the pixel's own sample (paper 002, Eqs. 28-29): for neighbours of like confidence.
    DefensivePairwiseGris,
}

/// Resampled direct light.
#[derive(Clone, Debug, PartialEq, Reflect)]
pub struct Direct {
    /// Points of lights that a pixel draws, 1 to 64; cost grows with it, noise falls.
    pub candidates: u32,
    /// Presampled subsets of lights, at most 1024; 0: every pixel draws from all lights, slower with many of them.  Pixels of a tile
    /// share a subset: correlated noise, no bias.
    pub subset_count: u32,
    /// Points of lights in a subset, 1 to 16384.
    pub subset_size: u32,
    /// Pixels a side that share a subset, 1 to 16.
    pub tile: u32,
    /// Reuses the sample that the surface had in the last frame.
    pub temporal: bool,
    /// Samples of places round it in the last frame, at most 5.
    pub spatial_taps: u32,
    /// How far round it, pixels.
    pub radius: f32,
    /// Most that a history counts, in frames' worth of candidates, at most 60.  Longer histories are smoother and more correlated.
    pub confidence_cap: f32,
    /// How samples are weighed against each other.
    pub mis: Mis,
    /// Rays decide what a neighbour could have found: without them light is lost near shadows (biased, darker), with them each tap
    /// costs one more ray.
    pub mis_rays: bool,
    /// Leaves out neighbours whose geometry differs: less noise at edges, no bias.
    pub reject: bool,
    /// Least cosine between the normals of pixels that reuse each other's samples.
    pub normal_threshold: f32,
    /// Most distance of one from the other's tangent plane, relative to the distance from the camera.
    pub depth_threshold: f32,
}

impl Default for Direct {
    /// Paper 003: 32 candidates from 128 subsets of 1024, tiles of 8 pixels, one temporal and one spatiotemporal tap within 30 pixels,
    /// history capped at 20.
    fn default() -> Self {
        Self {
            candidates: 32,
            subset_count: 128,
            subset_size: 1024,
            tile: 8,
            temporal: true,
            spatial_taps: 1,
            radius: 30.0,
            confidence_cap: 20.0,
            mis: Mis::default(),
            mis_rays: true,
            reject: true,
            normal_threshold: 0.9,
            depth_threshold: 0.02,
        }
    }
}

/// What a camera shows in place of light.  Values reach the view target and [`RadianceCapture`](crate::RadianceCapture) as they are,
/// whatever the exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[repr(u32)]
pub enum DebugView {
    /// Light.
    #[default]
    Off,
    /// Instances of the visibility buffer, in false colours.
    Instances,
    /// Its triangles, in false colours.
    Triangles,
    /// Instances that a traced primary ray meets; the same colours.
    TracedInstances,
    /// Triangles that a traced primary ray meets; the same colours.
    TracedTriangles,
    /// Distance from the camera, m.
    Depth,
    /// Motion since the last frame, pixels: x right in red, y down in green; add it to find the surface in the last frame.
    Motion,
    /// Shading normals, world space, from -1..1 to 0..1.
    Normals,
    /// Base colour.
    Albedo,
}

/// A set of settings with a purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Reflect)]
pub enum Preset {
    /// Fewest rays: light after the third bounce is missing (darker).
    Performance,
    /// Light after the fifth bounce is missing (darker).
    Balanced,
    /// Light after the eighth bounce is missing (darker).
    Quality,
    /// As `Quality` with 32 bounces; nothing else is left out.
    Unbiased,
}

/// Lights what this camera sees by path tracing, in place of Bevy's own lighting.  Multisampling (`Msaa`) is turned off: the jitter of
/// the primary rays does its work.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// fn setup(mut commands: Commands) {
///     commands.spawn((Camera3d::default(), Restir::default()));
/// }
/// ```
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Default)]
#[require(Hdr)]
pub struct Restir {
    /// How light is carried from the scene to a pixel.
    pub technique: Technique,
    /// Scattering events that a path may have: 0 shows emission only, 1 adds direct light.  At most 64.  Light that takes more is
    /// missing (darker); the cost grows with it.
    pub bounces: u32,
    /// Moves the primary rays within the pixel from frame to frame (box filter).  Without it every frame looks through the centres of
    /// the pixels: edges alias.
    pub jitter: bool,
    /// Adds the light that bounces more than once within a rough surface to the specular lobes of reflection (Turquin 2019, as in
    /// paper 002, 2.1.3).  Without it rough metals are darker than they are.
    pub energy_compensation: bool,
    /// Selects one of 2^32 independent sequences of random numbers.
    pub seed: u32,
    /// Direct light, for [`Technique::Di`].
    pub direct: Direct,
    /// Shows the mean of all frames for as long as nothing that is shown changes: for stills.  [`Technique::Reference`] always does.
    pub accumulate: bool,
    /// Shows something else than light.
    pub debug_view: DebugView,
    /// Forgets what earlier frames gathered, then clears itself.
    pub reset: bool,
}

impl Default for Restir {
    fn default() -> Self {
        Self::preset(Preset::Balanced)
    }
}

impl Restir {
    /// Most bounces that a path may have.
    pub const MAX_BOUNCES: u32 = 64;

    /// The settings of a preset.
    pub fn preset(preset: Preset) -> Self {
        let bounces = match preset {
            Preset::Performance => 3,
            Preset::Balanced => 5,
            Preset::Quality => 8,
            Preset::Unbiased => 32,
        };
        Self {
            technique: Technique::Reference,
            bounces,
            jitter: true,
            energy_compensation: true,
            seed: 0,
            direct: Direct::default(),
            accumulate: false,
            debug_view: DebugView::Off,
            reset: false,
        }
    }

    /// Brings every field into its range and says what it changed, one line a field.
    pub fn validate(&mut self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.bounces > Self::MAX_BOUNCES {
            warnings.push(format!("bounces = {} is out of range, {} is used", self.bounces, Self::MAX_BOUNCES));
            self.bounces = Self::MAX_BOUNCES;
        }
        let direct = &mut self.direct;
        let mut count = |name: &str, value: &mut u32, low: u32, high: u32| {
            let clamped = (*value).clamp(low, high);
            if clamped != *value {
                warnings.push(format!("direct.{name} = {value} is out of range, {clamped} is used"));
                *value = clamped;
            }
        };
        count("candidates", &mut direct.candidates, 1, 64);
        count("subset_count", &mut direct.subset_count, 0, 1024);
        count("subset_size", &mut direct.subset_size, 1, 16384);
        count("tile", &mut direct.tile, 1, 16);
        count("spatial_taps", &mut direct.spatial_taps, 0, 5);
        let mut number = |name: &str, value: &mut f32, low: f32, high: f32| {
            let clamped = if value.is_nan() { low } else { value.clamp(low, high) };
            if clamped != *value {
                warnings.push(format!("direct.{name} = {value} is out of range, {clamped} is used"));
                *value = clamped;
            }
        };
        number("radius", &mut direct.radius, 0.0, 1000.0);
        number("confidence_cap", &mut direct.confidence_cap, 0.0, 60.0);
        number("normal_threshold", &mut direct.normal_threshold, -1.0, 1.0);
        number("depth_threshold", &mut direct.depth_threshold, 0.0, 1e6);
        warnings
    }
}

/// What surrounds the scene of one camera: light from every direction, shown behind it.
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Default)]
pub struct RestirEnvironment {
    /// Uniform radiance, cd/m²; multiplies the image where there is one.
    pub color: LinearRgba,
    /// Equirectangular radiance: u = 0.5 + atan2(d.x, -d.z)/2π, v = acos(d.y)/π.
    pub image: Option<Handle<Image>>,
    /// Multiplies all of it.
    pub intensity: f32,
    /// Turns the environment: world from environment.
    pub rotation: Quat,
}

impl Default for RestirEnvironment {
    fn default() -> Self {
        Self { color: LinearRgba::WHITE, image: None, intensity: 1.0, rotation: Quat::IDENTITY }
    }
}

/// Luminance, cd/m², of `StandardMaterial::emissive` = 1: one number for the whole app.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Reflect)]
pub struct EmissiveLuminance(pub f32);

impl Default for EmissiveLuminance {
    /// 1/exposure of Bevy's default camera, so that a lamp looks as bright as Bevy's rasteriser draws it.
    fn default() -> Self {
        Self(1.0 / bevy::camera::Exposure::default().exposure())
    }
}
