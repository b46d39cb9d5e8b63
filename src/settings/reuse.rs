//! Settings of reuse that all techniques share.

use bevy::reflect::Reflect;

use super::validate::{Problem, Ranges};

/// When a pixel resamples the samples of its neighbors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum ReuseOrder {
    /// Once a frame, from neighbors of the last frame (Wyman and Panteleev 2021, 6.2).  Fastest: no pass waits for another one.  Where a
    /// surface has just come into view its neighbors help one frame later.  No bias.
    Spatiotemporal,
    /// First the surface's own sample of the last frame, then the samples of neighbors in this frame, in passes of their own (Bitterli et
    /// al. 2020).  Less noise where surfaces come into view; one more pass.  No bias.
    TemporalThenSpatial,
}

/// MIS weights: how the samples of a pixel and of its neighbors are weighted against each other.  All kinds are unbiased; they differ in
/// noise and cost.  They weight the samples before one is selected (Lin et al. 2022); Wyman and Panteleev 2021 weight the selected one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Mis {
    /// 1/|Z|: by confidence among the pixels that could have found the sample (after Wyman and Panteleev 2021, Eq. 22).  Noisy: where
    /// neighbors or frames differ much, rare pixels are a thousand times too bright, so that short means look dark.  k² + k target
    /// evaluations for k neighbors.
    OneOverZ,
    /// Generalized balance heuristic (after Wyman and Panteleev 2021, Eq. 30).  Without pairs it has the least noise in two of three measured
    /// scenes; in the third one `DefensivePairwiseGris` has 20 % less error (`docs/experiments.md`).  k² + k target evaluations
    /// with their rays for k neighbors.
    Balance,
    /// Each neighbor against the pixel's own sample, by confidence (Wyman et al. 2023, 7.1.3).  2k target evaluations.
    Pairwise,
    /// As `Pairwise`, with a share of the weight reserved for the pixel's own sample by its confidence (Wyman et al. 2023, 7.1.3).  Safest
    /// where neighbors have long histories.
    DefensivePairwise,
    /// Each neighbor against a share of 1/k of the pixel's own sample, with 1/(k + 1) of the weight reserved for that sample (Lin et al.
    /// 2022, Eq. 38; Lanz 2025, Eqs. 28-29).  For neighbors of similar confidence.
    DefensivePairwiseGris,
}

impl Mis {
    /// Whether each neighbor is weighted against the pixel's own sample alone.
    pub(crate) fn is_pairwise(self) -> bool {
        match self {
            Self::Pairwise | Self::DefensivePairwise | Self::DefensivePairwiseGris => true,
            Self::OneOverZ | Self::Balance => false,
        }
    }
}

/// Reuse of samples across frames and pixels, for [`Direct`](super::Direct), [`Paths`](super::Paths) and
/// [`SubsurfaceSampling`](super::SubsurfaceSampling).  Where one default is given, all three share it.  It has no `Default`, because direct
/// light and paths have different ones: write `Reuse { radius: 30.0, ..Reuse::DIRECT }` or `..Reuse::PATHS`.  A serialized `Reuse` that lacks
/// fields gets those of paths.
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default = "paths"))]
pub struct Reuse {
    /// When neighbors are resampled.  Default: temporal, then spatial.
    pub order: ReuseOrder,
    /// Reuses the sample that the surface had in the last frame: much less noise, for one neighbor's cost.  Without it a frame uses its own
    /// samples only.  No bias.  Default: on.
    pub temporal: bool,
    /// Takes the temporal sample from one of the four pixels around the last place of the surface, at random with bilinear weights, instead of
    /// the nearest (Wyman and Panteleev 2021, 4.5): neighboring pixels take the same sample less often under motion.  The effect on noise has
    /// not been measured.  No cost, no bias.  Default: on for light that enters objects, otherwise off.
    pub bilinear: bool,
    /// Neighbors whose samples are reused in an iteration: more give less noise, which is more correlated.  Each costs a shift and its rays.
    /// No bias.  0 to 6, or to 5 in [`ReuseOrder::Spatiotemporal`], where the sample of the last frame takes a place of its own; default 3 for
    /// direct light, 5 for paths, 4 for light that enters objects.
    pub spatial_samples: u32,
    /// Number of neighbors where the surface was not visible in the last frame, if it is larger than [`Reuse::spatial_samples`] (Wyman and
    /// Panteleev 2021, 6.4): less noise in disocclusions and after a cut.  Only such pixels pay for these neighbors.  It has an effect only
    /// with `temporal` and, in [`ReuseOrder::TemporalThenSpatial`], with `spatial_samples`.  Without the geometry heuristics every surface
    /// that was within the image counts as seen.  No bias.  0 to 5; default 3 for direct light, otherwise 5.
    pub disocclusion_samples: u32,
    /// Pairs pixels for spatial reuse: two pixels that reuse each other's samples share the shifts between them, with their rays.  This
    /// halves the shifts and the rays of spatial reuse, for the same noise.  Partners come from squares whose sides are 0.9 to 1.8
    /// times [`Reuse::radius`], and [`Reuse::neighbor_attempts`] has no effect.  No bias.  It applies to iterations over samples of the same
    /// frame ([`ReuseOrder::TemporalThenSpatial`]) with a pairwise kind of [`Reuse::mis`].  [`Direct`](super::Direct) also needs
    /// [`VisibilityReuse::Resampled`](super::VisibilityReuse::Resampled) and MIS weights with rays.  Light that enters objects has no pairs.
    /// Memory: 4 bytes a pixel, and 16 for each shift; the number of shifts is the larger one of `spatial_samples` + 1 (at most 6) and
    /// `disocclusion_samples`.  Default: on for direct light and paths.  (Paired spatial reuse: Lin et al. 2026, supplement, Table 1.)
    pub paired: bool,
    /// Iterations of spatial reuse: more give less noise, which is more correlated.  Each is a pass.  No bias.  1 to 4; default 1.
    pub spatial_iterations: u32,
    /// Places that are tried for each neighbor until its geometry is similar (greedy neighbor search, Lanz 2025, 4.5.4): less noise at edges,
    /// for a few texture reads at each failure.  Each neighbor has its own; the paper shares nine among three.  No bias.  1 to 8; default 3
    /// for direct light, otherwise 5.
    pub neighbor_attempts: u32,
    /// Places that are tried for the surface itself in the last frame: first the nearest pixel, then pixels within 1.5 pixels.  With 1, the
    /// history is lost along edges and at the border of the image, where the jitter of the camera moves the nearest pixel to another
    /// surface: these pixels are often black in a single frame.  A few texture reads, at such pixels only.  No bias.  1 to 8; default 5.
    pub temporal_attempts: u32,
    /// Where a moving object hid the surface in the last frame, takes the sample of the surface that was visible next to the object then, at
    /// the same offset from it (dual motion vectors, Zeng et al. 2021; Lin et al. 2026, supplement, 7).  The noise behind moving objects is
    /// lower and somewhat correlated.  Cost: a texture read and a projection, at such pixels only; a pixel that finds a sample in this way gets
    /// no [`Reuse::disocclusion_samples`].  It has an effect only with `temporal` and the geometry heuristics.  No bias.  Default: on.
    pub dual_motion: bool,
    /// Greatest distance of neighbors, in pixels of an image that is 1080 lines high, and at least 2 pixels of the traced image: larger radii
    /// share rarely found light among more pixels, and find fewer similar neighbors.  No bias.  0 to 1e5; default 60 for direct light, 100 for
    /// paths, 30 for light that enters objects.
    pub radius: f32,
    /// Greatest confidence of a sample of the last frame, in frames' worth of candidates: longer histories are smoother and more
    /// correlated, which shows as blotches.  Neighbors within a frame count in full.  No cost, no bias.  0 to 250 for direct light, otherwise
    /// 0 to 30; default 8 for direct light, 12 for paths, 20 for light that enters objects.
    pub confidence_cap: f32,
    /// MIS weights.  Default for direct light: pairwise; otherwise defensive pairwise.
    pub mis: Mis,
    /// Shades all samples that are resampled, each by its share, instead of the selected one alone: less noise, above all of color, for little
    /// cost (decoupled shading, Wyman and Panteleev 2021, 7.1; vector weights, Lin et al. 2026, supplement, 7).  No bias.  Default: on.
    pub shade_all: bool,
    /// Least cosine between the normals of a pixel and its neighbor; a test of the geometry heuristics.  Larger values accept fewer
    /// neighbors: black pixels on thin and curved objects.  No bias, except with a biased [`BiasCorrection`](super::BiasCorrection), which
    /// needs the 0.9 of `Performance` (about the 25 degrees of Bitterli et al. 2020).  -1 to 1; default 0.5.
    pub normal_threshold: f32,
    /// Greatest distance of a neighbor's surface from the tangent plane, relative to the distance from the camera; a test of the geometry
    /// heuristics.  Larger values accept more neighbors.  No bias.  0 to 1e6; default 0.02: 0.05 and 0.1 have more noise between thin slats
    /// (`docs/experiments.md`).
    pub depth_threshold: f32,
    /// Skips neighbors with another material; a test of the geometry heuristics.  Fewer neighbors are accepted.  No bias.  Default: off.
    pub same_material: bool,
}

/// For serialized settings that lack fields.
#[cfg(feature = "serde")]
fn paths() -> Reuse {
    Reuse::PATHS
}

impl Reuse {
    /// The defaults of [`Direct`](super::Direct): temporal reuse, then one iteration of spatial reuse with three neighbors within 60 pixels in
    /// pairs, history capped at 8 frames: fewer rays and less noise than [`Self::SPATIOTEMPORAL`] (`docs/experiments.md`).
    pub const DIRECT: Self = Self {
        order: ReuseOrder::TemporalThenSpatial,
        temporal: true,
        bilinear: false,
        spatial_samples: 3,
        disocclusion_samples: 3,
        paired: true,
        spatial_iterations: 1,
        neighbor_attempts: 3,
        temporal_attempts: 5,
        dual_motion: true,
        radius: 60.0,
        confidence_cap: 8.0,
        mis: Mis::Pairwise,
        shade_all: true,
        normal_threshold: 0.5,
        depth_threshold: 0.02,
        same_material: false,
    };

    /// Direct light from neighbors of the last frame alone (Wyman and Panteleev 2021): one temporal and two spatiotemporal neighbors, history
    /// capped at 5 frames.  Saves 68 bytes a pixel compared with pairs in [`Technique::Di`](super::Technique::Di).  The paper has one
    /// spatiotemporal neighbor within 30 pixels, two or three in disocclusions where quality matters, and 20 frames, which shows more
    /// blotches where lights are many.
    pub const SPATIOTEMPORAL: Self = Self {
        order: ReuseOrder::Spatiotemporal,
        spatial_samples: 2,
        disocclusion_samples: 2,
        paired: false,
        confidence_cap: 5.0,
        mis: Mis::Balance,
        ..Self::DIRECT
    };

    /// The defaults of [`Paths`](super::Paths): temporal reuse, then one iteration of spatial reuse with five neighbors within 100 pixels in
    /// pairs, history capped at 12 frames.  Lin et al. 2022 and 2026 have three neighbors within 20 pixels, and 20 frames.  Where light is
    /// found rarely, a smaller circle shares each find among too few pixels, and a longer history keeps it for too long; both show as
    /// blotches (`docs/experiments.md`).  Without pairs up to five positions are tried for each neighbor, since a pixel without neighbors has
    /// only its own candidates and stays noisy or black.
    pub const PATHS: Self = Self {
        spatial_samples: 5,
        disocclusion_samples: 5,
        neighbor_attempts: 5,
        radius: 100.0,
        confidence_cap: 12.0,
        mis: Mis::DefensivePairwise,
        ..Self::DIRECT
    };

    /// The settings that reservoirs of a history depend on; the others are as in [`Self::PATHS`].
    pub(super) fn history_key(&self) -> Self {
        // All fields are named, so that a new one cannot be forgotten.
        let &Self {
            order,
            temporal,
            bilinear: _,
            spatial_samples: _,
            disocclusion_samples: _,
            paired: _,
            spatial_iterations: _,
            neighbor_attempts: _,
            temporal_attempts: _,
            dual_motion: _,
            radius: _,
            confidence_cap: _,
            mis: _,
            shade_all: _,
            normal_threshold: _,
            depth_threshold: _,
            same_material: _,
        } = self;
        Self { order, temporal, ..Self::PATHS }
    }

    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, path: &'static str, confidence_max: f32, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path, report };
        // The resampling routine has seven inputs: the pixel's own sample, that of the last frame in the same pass, and those of neighbors.
        let most = match self.order {
            ReuseOrder::Spatiotemporal => 5,
            ReuseOrder::TemporalThenSpatial => 6,
        };
        ranges.count("spatial_samples", &mut self.spatial_samples, 0, most);
        ranges.count("disocclusion_samples", &mut self.disocclusion_samples, 0, 5);
        ranges.count("spatial_iterations", &mut self.spatial_iterations, 1, 4);
        ranges.count("neighbor_attempts", &mut self.neighbor_attempts, 1, 8);
        ranges.count("temporal_attempts", &mut self.temporal_attempts, 1, 8);
        ranges.number("radius", &mut self.radius, 0.0, 1e5);
        ranges.number("confidence_cap", &mut self.confidence_cap, 0.0, confidence_max);
        ranges.number("normal_threshold", &mut self.normal_threshold, -1.0, 1.0);
        ranges.number("depth_threshold", &mut self.depth_threshold, 0.0, 1e6);
    }
}
