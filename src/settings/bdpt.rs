//! ReSTIR BDPT (Hedstrom et al. 2025).

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

use super::validate::{Problem, Ranges};

/// Uses of light paths in [`Technique::Bdpt`](super::Technique::Bdpt).  Camera paths always find light by hits of lights and by
/// next-event estimation, and are resampled.  The variants differ in noise and cost, not in bias.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum LightTechniques {
    /// The camera sees light paths, and each vertex of a camera path is connected with a vertex of a random light path, by a ray.  Such
    /// camera paths are resampled like all others.
    #[default]
    Full,
    /// The camera sees light paths; there are no connections ("lightweight", Hedstrom et al. 2025, 7.2).  Light that bounces towards hidden
    /// places is noisier: a lamp in glass has 1.7 times the error (relMSE without the worst percent), a door ajar 1.5 times; simple rooms
    /// have 2 to 5 % less.  Saves 8 to 40 % of the frame time on a CPU.
    Lightweight,
    /// Camera paths are connected with light paths, which the camera does not see: caustics on what it sees directly are found by camera
    /// paths only, with more noise.  Saves the four passes of light paths that the camera sees, 168 bytes a pixel and 60 a light path.
    NoLightTracing,
}

/// MIS weights of camera paths that [`Technique::Bdpt`](super::Technique::Bdpt) shifts to another pixel or frame (Hedstrom et al. 2025, 6.4; the
/// paper copies weights between pixels only, because it traces all paths of the last frame again).  Light paths that the camera sees have
/// weights of their own in both variants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum ShiftedMis {
    /// The weight of the shifted path.  No bias.
    #[default]
    Exact,
    /// The weight that the path had in the pixel that sampled it.  Biased: light is wrong where weights change from pixel to pixel, darker at
    /// corners and edges of shadows (same section).  The means of two pictures did not change beyond noise (0.2 and 0.4 %).  Saves the
    /// arithmetic of weights in shifts, and neither rays nor memory.
    Copied,
}

/// Settings of [`Technique::Bdpt`](super::Technique::Bdpt).
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default)]
pub struct Bdpt {
    /// Light paths of a frame for each pixel of the picture (`N_L`, Hedstrom et al. 2025, 7.1): more make caustics and hidden light less
    /// noisy.  Each costs as much as a path from the camera, 60 bytes if the camera sees light paths, and 48 bytes with connections; a device
    /// that cannot bind that many traces fewer, with a warning.  With 0, lights are found from the camera only.  No bias.  0 to 8, and at most
    /// 16,777,216 in all; default 1.
    pub light_paths: f32,
    /// Uses of light paths.  Default: [`LightTechniques::Full`].
    pub techniques: LightTechniques,
    /// Light paths that the camera sees are reused in other pixels, too, if the two vertices next to the camera can be reconnected by the
    /// criteria of [`Paths::reconnection`](super::Paths::reconnection): light that scatters twice at rough surfaces.  All others, such as
    /// caustics and light that scatters once, are reused from the last frame only.  Helps [`LightTechniques::Lightweight`]: a lamp in glass has
    /// 34 % less error (relMSE without the worst percent), but 2.5 % less with `Full`, whose connections find the same light.  Costs a
    /// pass in which each pixel traces one of these light paths again, the passes of [`Paths::reuse`](super::Paths::reuse), and 160 bytes a
    /// pixel.  No bias.  Default off.
    pub reconnect_light_paths: bool,
    /// MIS weights of shifted paths.  Default: [`ShiftedMis::Exact`].
    pub mis: ShiftedMis,
    /// MIS weights count a resampled camera path as this many samples, because pixels share camera paths but not light paths.  They count a
    /// connection as the square root of this number.  For light that arrives by a mirror or through glass, which next-event estimation cannot
    /// find, the factor favors the light path.  Larger values give less noise in light that resampling finds well, and more where light paths
    /// would have found it better.  No effect without temporal and spatial reuse, except in the order `Spatiotemporal`.  No cost, no bias.  1
    /// to 1000; default 16; other values have not been measured.
    pub reuse_gain: f32,
}

impl Default for Bdpt {
    fn default() -> Self {
        Self {
            light_paths: 1.0,
            techniques: LightTechniques::default(),
            reconnect_light_paths: false,
            mis: ShiftedMis::default(),
            reuse_gain: 16.0,
        }
    }
}

impl Bdpt {
    /// Whether camera paths are connected with light paths.
    pub(crate) fn connects(&self) -> bool {
        self.light_paths > 0.0 && self.techniques != LightTechniques::Lightweight
    }

    /// Whether the camera sees light paths.
    pub(crate) fn splats(&self) -> bool {
        self.light_paths > 0.0 && self.techniques != LightTechniques::NoLightTracing
    }

    /// Whether light paths that can be reconnected have reservoirs of their own.
    pub(crate) fn reconnects(&self) -> bool {
        self.splats() && self.reconnect_light_paths
    }

    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path: "bdpt.", report };
        ranges.number("light_paths", &mut self.light_paths, 0.0, 8.0);
        ranges.number("reuse_gain", &mut self.reuse_gain, 1.0, 1000.0);
    }
}
