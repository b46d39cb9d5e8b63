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

mod direct;
mod paths;

pub use direct::{BiasCorrection, Direct, Mis, ReservoirLayout, ReuseOrder, VisibilityReuse};
pub use paths::{Paths, Reconnection, Suffix};

/// How light is carried from the scene to a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum Technique {
    /// Unidirectional path tracing: next-event estimation and BSDF sampling joined by the balance heuristic, Russian roulette,
    /// accumulated over frames for as long as nothing that it shows changes.  Unbiased; every other technique is held against it.
    Reference,
    /// ReSTIR DI (Wyman and Panteleev 2021): emission and direct light, one bounce whatever `bounces` says (none where that
    /// is 0).  See [`Direct`].
    Di,
    /// ReSTIR GI (Ouyang et al. 2021; candidates, Jacobian and limits as in Lanz 2025, 4.3 and 4.5.5) for indirect light, beside
    /// [`Technique::Di`] for direct light: up to `bounces`.  See [`Paths`] and [`Direct`].
    Gi,
    /// ReSTIR PT (Lin et al. 2022, improved as in Lin et al. 2026): whole paths up to `bounces`, direct light among them.  See [`Paths`].
    #[default]
    Pt,
}

/// What a camera shows in place of light.  Values reach [`RadianceCapture`](crate::RadianceCapture) as they are, and the view target
/// times [`Restir::debug_scale`], whatever the exposure.  Where frames are summed (the reference path tracer's `Rays` and `Bounces`, and
/// all of [`Restir::accumulate`]) they are means.
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
    /// Instances that a traced primary ray meets; the same colours.  What casts no shadow is not among them: no traced ray meets it.
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
    /// Lights of the reservoirs that are kept, in false colours; black: none.  This and the four that follow need
    /// [`Technique::Di`] or [`Technique::Gi`].
    ReservoirLights,
    /// Where on its light the kept sample is: its two coordinates, 0 to 1, in red and green.
    ReservoirPoints,
    /// Unbiased contribution weights of the kept samples, in the lights' own measure.
    ReservoirWeights,
    /// Confidence of the reservoirs, in frames' worth of candidates.
    ReservoirConfidence,
    /// Whether the kept sample was seen when it was shaded: green, red where not, black where there is none.
    ReservoirVisibility,
    /// How the kept paths end: aimed at a light in red, at an emitter that they met in green, at the environment in blue.  This and the
    /// following need [`Technique::Pt`] or [`Technique::Gi`].
    PathEnds,
    /// Scattering events of the kept paths.
    PathLengths,
    /// Index of the vertex that other pixels reconnect to: from 2; 0: all is replayed.
    PathReconnections,
    /// Unbiased contribution weights of the kept paths, in their own measure.
    PathWeights,
    /// Confidence of the reservoirs, in frames' worth of candidates.
    PathConfidence,
    /// Frames since the kept paths were sampled; of `Pt`.
    PathAges,
    /// Why a kept path has no counterpart in the pixel 8 to the right, in false colours; white: it has.
    PathShifts,
    /// The Jacobian of that shift; 0 where it is not defined; of `Gi` 1, whose measure needs none.
    PathJacobians,
    /// Rays that the technique traced for a pixel in this frame.
    Rays,
    /// How often a path of the reference path tracer goes on after it met what the pixel shows, whatever the technique: 0 where it sees no
    /// surface or all is absorbed, at most [`Restir::bounces`].  Roulette ends paths from the third time on.
    Bounces,
}

impl DebugView {
    /// It shows what direct lighting keeps.
    pub fn is_of_reservoirs(self) -> bool {
        (Self::ReservoirLights as u32..=Self::ReservoirVisibility as u32).contains(&(self as u32))
    }

    /// It shows what is kept of paths.
    pub fn is_of_paths(self) -> bool {
        (Self::PathEnds as u32..=Self::PathJacobians as u32).contains(&(self as u32))
    }

    /// Whether it shows something of a technique.
    pub fn shows(self, technique: Technique) -> bool {
        match technique {
            Technique::Reference => !self.is_of_reservoirs() && !self.is_of_paths(),
            Technique::Di => !self.is_of_paths(),
            Technique::Gi => true,
            Technique::Pt => !self.is_of_reservoirs(),
        }
    }
}

/// A set of settings with a purpose, of [`Technique::Pt`]; another `technique` takes its part of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Reflect)]
pub enum Preset {
    /// Fewest rays: light after the third bounce is missing (darker), and direct light is resampled as by Wyman and Panteleev 2021, with
    /// visibility reused within 30 pixels (shadows are blurred and lag).  Where something moves, light that has just come into view of a
    /// path's end is missed (darker; [`Suffix::Forward`]).
    Performance,
    /// Light after the fifth bounce is missing (darker).
    Balanced,
    /// Light after the eighth bounce is missing (darker).  Paths meet three neighbours instead of one.
    Quality,
    /// As `Quality` with 32 bounces; nothing else is left out.
    Unbiased,
}

/// Lights what this camera sees by path tracing, in place of Bevy's own lighting.  Multisampling (`Msaa`) is turned off: the jitter of
/// the primary rays does its work.
///
/// What ReSTIR keeps of earlier frames outlives motion of things, lights and cameras, and lights that change, come and go.  It is begun
/// anew where things appear or go, or a mesh, a material, an image, the environment or one of these settings changes.
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
    /// the pixels: edges alias.  A camera with Bevy's `TemporalJitter`, as `TemporalAntiAliasing` brings it, is moved by that instead.
    pub jitter: bool,
    /// Adds the light that bounces more than once within a rough surface to the specular lobes of reflection (Turquin 2019, as in
    /// Lanz 2025, 2.1.3).  Without it rough metals are darker than they are.
    pub energy_compensation: bool,
    /// Selects one of 2^32 independent sequences of random numbers.
    pub seed: u32,
    /// Direct light, for [`Technique::Di`] and [`Technique::Gi`]; of all that resample its subsets of lights.
    pub direct: Direct,
    /// Paths, for [`Technique::Gi`] and [`Technique::Pt`].
    pub paths: Paths,
    /// Shows the mean of all frames for as long as nothing that is shown changes: for stills.  [`Technique::Reference`] always does.
    pub accumulate: bool,
    /// Shows something else than light.
    pub debug_view: DebugView,
    /// Multiplies what debug views show, so that metres and counts fit between 0 and 1; from 0 to 1e6.
    pub debug_scale: f32,
    /// Forgets what earlier frames gathered and begins the sequence of random numbers again, then clears itself.
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
        let direct = match preset {
            Preset::Performance => Direct {
                bias_correction: BiasCorrection::HeuristicsAndMis,
                visibility: VisibilityReuse::Decoupled,
                visibility_radius: 30.0,
                ..Direct::default()
            },
            _ => Direct::default(),
        };
        let paths = match preset {
            Preset::Performance => Paths { suffix: Suffix::Forward, ..Paths::default() },
            Preset::Quality | Preset::Unbiased => Paths { spatial_taps: 3, ..Paths::default() },
            _ => Paths::default(),
        };
        Self {
            technique: Technique::Pt,
            bounces,
            jitter: true,
            energy_compensation: true,
            seed: 0,
            direct,
            paths,
            accumulate: false,
            debug_view: DebugView::Off,
            debug_scale: 1.0,
            reset: false,
        }
    }

    /// Brings every field into its range and says what it changed and what has no effect, one line a field.
    pub fn validate(&mut self) -> Vec<String> {
        let mut warnings = Vec::new();
        Ranges { of: "", warnings: &mut warnings }.count("bounces", &mut self.bounces, 0, Self::MAX_BOUNCES);
        self.direct.validate(&mut warnings);
        self.paths.validate(&mut warnings);
        let scale = if self.debug_scale.is_nan() { 1.0 } else { self.debug_scale.clamp(0.0, 1e6) };
        if scale != self.debug_scale {
            warnings.push(format!("debug_scale = {} is out of range, {scale} is used", self.debug_scale));
            self.debug_scale = scale;
        }
        if !self.debug_view.shows(self.technique) {
            warnings
                .push(format!("debug_view = {:?} shows nothing of technique {:?}", self.debug_view, self.technique));
        }
        warnings
    }
}

/// Brings fields into their ranges and says what it changed.
struct Ranges<'a> {
    /// Whose fields they are, with a dot.
    of: &'static str,
    warnings: &'a mut Vec<String>,
}

impl Ranges<'_> {
    fn count(&mut self, name: &str, value: &mut u32, low: u32, high: u32) {
        let clamped = (*value).clamp(low, high);
        if clamped != *value {
            self.warnings.push(format!("{}{name} = {value} is out of range, {clamped} is used", self.of));
            *value = clamped;
        }
    }

    fn number(&mut self, name: &str, value: &mut f32, low: f32, high: f32) {
        let clamped = if value.is_nan() { low } else { value.clamp(low, high) };
        if clamped != *value {
            self.warnings.push(format!("{}{name} = {value} is out of range, {clamped} is used", self.of));
            *value = clamped;
        }
    }
}

/// What surrounds the scene of one camera: light from every direction, shown behind it.  A camera without one has its
/// `Skybox`, which lights as it looks (Bevy's rasteriser lets it light nothing), or else its `EnvironmentMapLight`: the sharpest level
/// of the specular map, which lights and is not shown.  Images are drawn from by their luminance in cells of a third of a degree: finer
/// light is noisier, never biased.
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

/// How rays are traced: a resource, read once when the app is finished.
///
/// Both back ends give the same pictures but for rays that pass an edge so closely that rounding decides; the difference is speed.
/// [`RestirReport::backend`](crate::RestirReport) says which one is at work.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum RayBackend {
    /// Ray queries where the device has them and is no CPU, else the software's.
    #[default]
    Auto,
    /// Compute shaders that walk a two-level compressed BVH: runs on every device.
    Software,
    /// The device's ray queries.  Where it has none: the software's, with one warning.
    Hardware,
}
