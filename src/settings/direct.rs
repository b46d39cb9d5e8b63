//! ReSTIR DI (Wyman and Panteleev 2021).

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

use super::{
    Reuse,
    validate::{Problem, Ranges},
};

/// Correction of the bias that the samples of other pixels bring (Wyman and Panteleev 2021, 4.6 and Fig. 6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum BiasCorrection {
    /// No correction: every sample counts by its confidence (1/M, Eq. 6).  Biased: darker at edges of depth and normals and near shadows,
    /// where a neighbor could not have found the pixel's samples.
    Off,
    /// Neighbors of dissimilar geometry are skipped (Eq. 24).  Biased: darker near shadows.
    Heuristics,
    /// As `Heuristics`, with MIS weights that assume that every neighbor sees every light.  Biased: darker near shadows, but less so than with
    /// `Heuristics`.
    HeuristicsAndMis,
    /// MIS weights that test the visibility of each sample from each neighbor, across all edges (Eq. 31).  Unbiased.  One more ray for each
    /// neighbor.  Only with [`VisibilityReuse::Discard`] and [`VisibilityReuse::Resampled`]; with other values the weights assume that every
    /// neighbor sees every light, without rays.
    UnbiasedMis,
    /// As `UnbiasedMis`, and neighbors of dissimilar geometry are skipped (Eq. 33).  Unbiased, with less noise at edges.  One more ray for
    /// each neighbor.  Only with [`VisibilityReuse::Discard`] and [`VisibilityReuse::Resampled`]; with other values it is the same as
    /// `HeuristicsAndMis`.
    #[default]
    HeuristicsAndUnbiasedMis,
}

impl BiasCorrection {
    /// Whether neighbors of dissimilar geometry are skipped.
    pub(crate) fn uses_heuristics(self) -> bool {
        matches!(self, Self::Heuristics | Self::HeuristicsAndMis | Self::HeuristicsAndUnbiasedMis)
    }

    /// Whether samples are weighted by [`Mis`](super::Mis).
    pub(crate) fn uses_mis(self) -> bool {
        !matches!(self, Self::Off | Self::Heuristics)
    }

    /// Whether rays test visibility for these weights.
    pub(crate) fn uses_mis_rays(self) -> bool {
        matches!(self, Self::UnbiasedMis | Self::HeuristicsAndUnbiasedMis)
    }
}

/// Whether and when rays test the visibility of lights, and which results are reused (Wyman and Panteleev 2021, 7.2 and Fig. 15).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum VisibilityReuse {
    /// No rays to lights (a).  Biased: brighter, without shadows.
    Ignored,
    /// Rays decide what is shaded, not what is stored (b).  Noisy in shadows.  Biased with [`Direct::bsdf_candidate`] (the default): slightly
    /// darker where an object hides the light of that candidate.  Unbiased without it.
    Shading,
    /// Rays decide which candidates are stored; the samples of neighbors are assumed to be visible (c).  Biased: brighter in shadows, darker
    /// beside them.
    Candidates,
    /// Rays test candidates and the samples of neighbors; an occluded sample is dropped with its neighbor's confidence (d).  Biased:
    /// brighter, even with unbiased MIS weights; darker with MIS weights without rays.
    Discard,
    /// Rays test candidates and the samples of neighbors; the confidence of neighbors is kept (e).  Unbiased where [`BiasCorrection`]
    /// traces rays as well; otherwise darker near shadows.
    #[default]
    Resampled,
    /// Rays decide which candidates are stored and what is shaded (f, the pipeline of that paper).  The visibility of the surface's own
    /// sample and of neighbors within [`Direct::visibility_radius`] is reused from the last frame: fewest rays, but shadows lag.  Biased:
    /// darker near shadows, and brighter in them within the radius.
    Decoupled,
}

impl VisibilityReuse {
    /// Whether rays test the samples of neighbors before one of them is selected, and with them those of
    /// [`BiasCorrection::uses_mis_rays`].
    pub(crate) fn tests_neighbors(self) -> bool {
        matches!(self, Self::Discard | Self::Resampled)
    }
}

/// Resampled direct light, for [`Technique::Di`](super::Technique::Di), [`Technique::Gi`](super::Technique::Gi), and
/// [`Technique::Pt`](super::Technique::Pt) with [`Paths::separate_direct_light`](super::Paths::separate_direct_light).  All techniques that
/// resample take their light candidates from its subsets.
///
/// With the defaults a pixel traces at most eight rays: one for its BSDF candidate, one for the selected candidate, two for the temporal
/// neighbor, and one for each partner.  It has three partners, or four where one of them found few others.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default)]
pub struct Direct {
    /// Light candidates of a pixel: more give less noise at higher cost.  No bias.  1 to 64; default 32.  Where the only light is a point, spot
    /// or directional light, one is taken.
    pub candidates: u32,
    /// Adds a candidate of BSDF sampling, joined with the light candidates by MIS: sharp reflections of lights, for one ray.  Without it
    /// lights in mirrors, and lights beyond the table, are missing (darker).  Default: on.
    pub bsdf_candidate: bool,
    /// Presampled subsets of lights.  The pixels of a tile share a subset, so their noise is correlated; without subsets (0) every pixel
    /// draws from all lights, which is slower if there are many.  No bias.  0 to 4096; default 128.
    pub subset_count: u32,
    /// Points of lights in a subset: more give less correlated noise, for 48 bytes each.  No bias.  1 to 16384, and at most 2^21 in all
    /// subsets (96 MiB); default 1024.
    pub subset_size: u32,
    /// Reuse of samples; default [`Reuse::DIRECT`].
    pub reuse: Reuse,
    /// Correction of the bias of reused samples.  Its rays are traced only where `visibility` tests the samples of neighbors.  Default:
    /// [`BiasCorrection::HeuristicsAndUnbiasedMis`].
    pub bias_correction: BiasCorrection,
    /// Use of the rays to lights; it also decides whether `bias_correction` traces rays.  Default: [`VisibilityReuse::Resampled`].
    pub visibility: VisibilityReuse,
    /// Distance within which visibility is reused, in pixels of an image that is 1080 lines high; for [`VisibilityReuse::Decoupled`].  Larger
    /// values save rays and blur shadows.  Biased, as described there.  0 to 1e6; default 0 (only the surface's own visibility is reused).
    pub visibility_radius: f32,
}

impl Default for Direct {
    /// As in Wyman and Panteleev 2021: 32 candidates from 128 subsets of 1024 lights; unbiased.
    fn default() -> Self {
        Self {
            candidates: 32,
            bsdf_candidate: true,
            subset_count: 128,
            subset_size: 1024,
            reuse: Reuse::DIRECT,
            bias_correction: BiasCorrection::default(),
            visibility: VisibilityReuse::default(),
            visibility_radius: 0.0,
        }
    }
}

impl Direct {
    /// Greatest number of points of lights in all subsets: 96 MiB, which a binding of WebGPU's default limits holds.
    const MAX_PRESAMPLED: u32 = 1 << 21;

    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path: "direct.", report };
        ranges.count("candidates", &mut self.candidates, 1, 64);
        ranges.count("subset_count", &mut self.subset_count, 0, 4096);
        let max_size = Self::MAX_PRESAMPLED / self.subset_count.max(1);
        ranges.count("subset_size", &mut self.subset_size, 1, max_size.min(16384));
        ranges.number("visibility_radius", &mut self.visibility_radius, 0.0, 1e6);
        self.reuse.clamp("direct.reuse.", 250.0, report);
        // Where no ray decides what is stored, weights without rays are right.
        let tests_candidates = matches!(self.visibility, VisibilityReuse::Candidates | VisibilityReuse::Decoupled);
        if self.bias_correction.uses_mis_rays() && tests_candidates {
            report(Problem::NoMisRays(self.bias_correction, self.visibility));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bias_correction_without_its_rays_is_reported() {
        use VisibilityReuse::*;
        let reports = |bias_correction, visibility| {
            let mut problems = Vec::new();
            Direct { bias_correction, visibility, ..Direct::default() }.clamp(&mut |problem| problems.push(problem));
            problems
        };
        for visibility in [Ignored, Shading, Candidates, Discard, Resampled, Decoupled] {
            for correction in [BiasCorrection::UnbiasedMis, BiasCorrection::HeuristicsAndUnbiasedMis] {
                let problem = Problem::NoMisRays(correction, visibility);
                let expected = if matches!(visibility, Candidates | Decoupled) { vec![problem] } else { Vec::new() };
                assert_eq!(reports(correction, visibility), expected);
            }
            assert_eq!(reports(BiasCorrection::HeuristicsAndMis, visibility), []);
        }
    }
}
