//! Bidirectional path tracing (Hedstrom et al. 2025).

use bevy::reflect::Reflect;

use super::validate::{Problem, Ranges};

/// Settings of [`Technique::Bdpt`](super::Technique::Bdpt).
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct Bdpt {
    /// Light sub-paths of a frame for each pixel of the picture (`N_L`, ibid., 5.1), 0 to 8; at most 16,777,216 in all.  More make caustics
    /// and hidden light less noisy.  Each costs as much as a path from the camera, and 112 bytes; a device that cannot bind that many traces
    /// fewer, with a warning.  With 0, lights are found from the camera only.  No bias.
    pub light_paths: f32,
}

impl Default for Bdpt {
    fn default() -> Self {
        Self { light_paths: 1.0 }
    }
}

impl Bdpt {
    /// Brings every field into its range.
    pub(super) fn validate(&mut self, report: &mut dyn FnMut(Problem)) {
        Ranges { path: "bdpt.", report }.number("light_paths", &mut self.light_paths, 0.0, 8.0);
    }
}
