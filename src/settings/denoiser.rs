//! Settings of the denoiser.

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

use super::validate::{Problem, Ranges};

/// A filter that removes noise from every frame: light is averaged over frames and over pixels around that show similar surfaces (after
/// SVGF, Schied et al. 2017).  Diffuse and specular light are filtered apart and without the colors of their surfaces, so that textures stay
/// sharp.  Where light changes, fewer frames are averaged.  Single bright pixels are spread over the pixels around.  Figures:
/// `docs/performance.md`.
///
/// Biased: shadows, reflections and caustics that are finer than the filter are blurred; light that changes slowly lags behind.  Histories
/// are not filtered, so that reuse stays unbiased.  What smooth mirrors and clear glass show is filtered like other surfaces, which costs up
/// to six rays for each pixel that shows them.  On except in [`Preset::Unbiased`](super::Preset::Unbiased).  No effect on
/// [`Technique::Reference`](super::Technique::Reference), with [`Restir::accumulate`](super::Restir::accumulate) and on debug views.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default)]
pub struct Denoiser {
    /// Iterations of the filter over pixels.  Each doubles the spacing of the pixels that are averaged, so that the radius grows to 2, 6, 14,
    /// 30 and 62 pixels: less noise, and wider blur.  0 turns the denoiser off, and saves its passes and 160 bytes a pixel (208 in scenes with a
    /// roughness below 0.142 or a texture of roughness).  0 to 5; default 5.
    pub iterations: u32,
    /// Greatest number of frames in the mean of a pixel.  More frames have less noise and flicker; light that changes lags longer.  1 to 255;
    /// default 32.
    pub history: u32,
}

impl Denoiser {
    /// No denoiser.
    pub const OFF: Self = Self { iterations: 0, ..Self::ON };
    /// All iterations, over means of up to 32 frames.
    pub const ON: Self = Self { iterations: Self::MAX_ITERATIONS, history: 32 };
    /// Greatest value of [`Denoiser::iterations`].
    pub const MAX_ITERATIONS: u32 = 5;

    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path: "denoiser.", report };
        ranges.count("iterations", &mut self.iterations, 0, Self::MAX_ITERATIONS);
        ranges.count("history", &mut self.history, 1, 255);
    }
}

impl Default for Denoiser {
    /// [`Denoiser::ON`].
    fn default() -> Self {
        Self::ON
    }
}
