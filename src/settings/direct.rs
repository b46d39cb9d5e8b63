//! Resampled direct light (Wyman and Panteleev 2021).

use bevy::reflect::Reflect;

use super::Ranges;

/// What keeps the samples of other pixels from falsifying this one's light (Wyman and Panteleev 2021, 4.6 and Fig. 6).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum BiasCorrection {
    /// Nothing: every sample counts by its confidence (1/M, Eq. 6).  Biased: darker at edges of depth and normals and near shadows, where
    /// a neighbour could not have found the pixel's samples.
    Off,
    /// Neighbours whose geometry differs are left out (Eq. 24).  Biased: darker near shadows.
    Heuristics,
    /// As `Heuristics`, and MIS weights that take every neighbour to see every light.  Biased: darker near shadows, less than
    /// `Heuristics`.
    HeuristicsAndMis,
    /// MIS weights, and a ray for each of their visibilities, across all edges (Eq. 31).  Unbiased.  A ray more a tap.
    UnbiasedMis,
    /// As `UnbiasedMis` among the neighbours that `Heuristics` leaves (Eq. 33).  Unbiased, less noise at edges.  A ray more a tap.
    #[default]
    HeuristicsAndUnbiasedMis,
}

impl BiasCorrection {
    /// Neighbours of other geometry are left out.
    pub fn uses_heuristics(self) -> bool {
        matches!(self, Self::Heuristics | Self::HeuristicsAndMis | Self::HeuristicsAndUnbiasedMis)
    }

    /// Samples are weighed by what their neighbours could have found.
    pub fn uses_mis(self) -> bool {
        !matches!(self, Self::Off | Self::Heuristics)
    }

    /// Rays say what a neighbour could have found.
    pub fn uses_mis_rays(self) -> bool {
        matches!(self, Self::UnbiasedMis | Self::HeuristicsAndUnbiasedMis)
    }
}

/// How the samples of a pixel and of its neighbours are weighed against each other, where [`BiasCorrection`] asks for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum Mis {
    /// By confidence among those that could have found a sample (1/|Z|, Wyman and Panteleev 2021, Eq. 22): noisy, and where neighbours
    /// or frames differ much with rare pixels a thousand times too bright, so that short means are dark.  k² + k evaluations for k
    /// neighbours.
    Valid,
    /// Generalised balance heuristic (Wyman and Panteleev 2021, Eq. 30): least noise in two of three scenes that were measured, and near
    /// it in the third (`docs/performance.md`).  k² + k evaluations: with the two taps of the defaults two more than the pairwise kinds,
    /// and their rays.
    #[default]
    Balance,
    /// Each neighbour against the pixel's own sample (Lanz 2025, 2.3.5): 2k evaluations.
    Pairwise,
    /// As `Pairwise`, with a share kept for the pixel's own sample by its confidence: safest where neighbours have long histories.
    DefensivePairwise,
    /// As `Pairwise`, with 1/(k + 1) kept for the pixel's own sample (Lanz 2025, Eqs. 28-29): for neighbours of like confidence.
    DefensivePairwiseGris,
}

/// When a pixel meets the samples of its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum ReuseOrder {
    /// All of them are of the last frame (Wyman and Panteleev 2021, 6.2): nothing waits for the whole of this frame.  Where a surface has
    /// just come into sight its neighbours help a frame later.
    #[default]
    Spatiotemporal,
    /// The surface's own of the last frame; then, in passes of their own, its neighbours' of this frame (Bitterli et al. 2020).
    TemporalThenSpatial,
}

/// What the rays between pixels and lights decide (Wyman and Panteleev 2021, 7.2 and Fig. 15).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum VisibilityReuse {
    /// No ray is traced to a light (a).  Biased: brighter, without shadows.
    Ignored,
    /// What is shaded, nothing that is kept (b).  Unbiased but for the [`Direct::bsdf_candidate`], which sees what it finds: with it a
    /// little darker where it counts and something stands before a light.  Noisy in shadows.
    Shading,
    /// What is kept of the candidates; the samples of others are taken to be seen (c).  Biased: brighter in shadows, darker beside them.
    Candidates,
    /// All; a sample that is not seen takes all that its neighbour found with it (d).  Biased: brighter, even with unbiased MIS; darker
    /// with MIS without rays.
    Discard,
    /// All.  Unbiased where [`BiasCorrection`] traces rays, too; otherwise darker near shadows (e).
    #[default]
    Resampled,
    /// What is kept of the candidates, and what is shaded (f: their pipeline).  The surface's own sample is as it was seen in the
    /// last frame, and so is that of a neighbour within [`Direct::visibility_radius`]: shadows lag.  Biased: darker near shadows, and
    /// within the radius brighter in them.
    Decoupled,
}

/// How reservoirs lie in memory (Lanz 2025, 4.5.3).  The picture is the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum ReservoirLayout {
    /// Row by row.
    #[default]
    Rows,
    /// Column by column.
    Columns,
    /// Tiles of 2 x 2 pixels, row by row in each.
    Tiles2,
    /// Tiles of 4 x 4 pixels.
    Tiles4,
    /// Tiles of 8 x 8 pixels: those of a workgroup.
    Tiles8,
    /// Tiles of 40 x 40 pixels.
    Tiles40,
}

impl ReservoirLayout {
    /// Pixels a side of a tile; 0: rows, `u32::MAX`: columns.
    pub(crate) fn tile(self) -> u32 {
        match self {
            Self::Rows => 0,
            Self::Columns => u32::MAX,
            Self::Tiles2 => 2,
            Self::Tiles4 => 4,
            Self::Tiles8 => 8,
            Self::Tiles40 => 40,
        }
    }
}

/// Resampled direct light.
///
/// With the defaults a pixel traces at most eight rays: for its BSDF candidate, for the candidate that it keeps, and three for each of
/// two taps.
#[derive(Clone, Debug, PartialEq, Reflect)]
pub struct Direct {
    /// Points of lights that a pixel draws, 1 to 64; cost grows with it, noise falls.
    pub candidates: u32,
    /// One candidate more of the BSDF, weighed against the others by MIS.  Without it (a ray less) what only it finds is missing: lights
    /// in mirrors, and lights beyond the table (darker).
    pub bsdf_candidate: bool,
    /// Chooses among candidates by the light that arrives, not by what is reflected of it (Wyman and Panteleev 2021, 9 and 3.3): no BSDF
    /// is evaluated for those that are not kept.  Noisier on glossy surfaces, no bias.
    pub simple_target: bool,
    /// Presampled subsets of lights, at most 4096; 0: every pixel draws from all lights, slower with many of them.  Pixels of a tile
    /// share a subset: correlated noise, no bias.
    pub subset_count: u32,
    /// Points of lights in a subset, 1 to 16384, and no more than 2^21 in all subsets (96 MiB).
    pub subset_size: u32,
    /// Pixels a side that share a subset, 1 to 16.
    pub tile: u32,
    /// When neighbours are met.
    pub order: ReuseOrder,
    /// Reuses the sample that the surface had in the last frame.
    pub temporal: bool,
    /// Takes that sample from one of the four pixels round the place that the surface had, by bilinear chance (Wyman and Panteleev 2021,
    /// 4.5); otherwise from the nearest.  Less correlation under motion, no bias.
    pub bilinear: bool,
    /// Neighbours whose samples are reused in a round, at most 5.
    pub spatial_taps: u32,
    /// The same where the surface was not seen in the last frame (Wyman and Panteleev 2021, 6.4), if more; at most 5.  Of
    /// [`ReuseOrder::Spatiotemporal`] with `temporal` only.
    pub disocclusion_taps: u32,
    /// Rounds of spatial reuse, 1 to 4: a pass each.
    pub rounds: u32,
    /// Places that are tried for a tap until one is of like geometry, 1 to 8 (greedy neighbour search, Lanz 2025, 4.5.4).
    pub tries: u32,
    /// How far away neighbours are: pixels of a picture 1080 lines high, and at least 2 of its own.
    pub radius: f32,
    /// Most that a neighbour counts, in frames' worth of candidates, at most 60.  Longer histories are smoother and more correlated.
    pub confidence_cap: f32,
    /// What keeps neighbours from falsifying the picture.
    pub bias_correction: BiasCorrection,
    /// How samples are weighed against each other.
    pub mis: Mis,
    /// What rays decide.
    pub visibility: VisibilityReuse,
    /// Pixels of a picture 1080 lines high within which a neighbour sees what this one sees, for [`VisibilityReuse::Decoupled`].
    pub visibility_radius: f32,
    /// Shades all samples that meet by their shares, not only the one that is kept (Wyman and Panteleev 2021, 7.1), as
    /// [`Paths::vector_weights`](crate::Paths::vector_weights) of paths: less noise, no bias.
    pub decoupled_shading: bool,
    /// Least cosine between the normals of pixels that reuse each other's samples, for the heuristics.
    pub normal_threshold: f32,
    /// Most distance of one from the other's tangent plane, relative to the distance from the camera, for the heuristics.
    pub depth_threshold: f32,
    /// Neighbours are of the same material, for the heuristics.
    pub same_material: bool,
    /// How reservoirs lie in memory.
    pub layout: ReservoirLayout,
}

impl Default for Direct {
    /// As Wyman and Panteleev 2021: 32 candidates from 128 subsets of 1024, tiles of 8 pixels, one temporal and one spatiotemporal tap
    /// within 30 pixels (two in disocclusions), history capped at 20; unbiased.
    fn default() -> Self {
        Self {
            candidates: 32,
            bsdf_candidate: true,
            simple_target: false,
            subset_count: 128,
            subset_size: 1024,
            tile: 8,
            order: ReuseOrder::default(),
            temporal: true,
            bilinear: false,
            spatial_taps: 1,
            disocclusion_taps: 2,
            rounds: 1,
            tries: 1,
            radius: 30.0,
            confidence_cap: 20.0,
            bias_correction: BiasCorrection::default(),
            mis: Mis::default(),
            visibility: VisibilityReuse::default(),
            visibility_radius: 0.0,
            decoupled_shading: true,
            normal_threshold: 0.9,
            depth_threshold: 0.02,
            same_material: false,
            layout: ReservoirLayout::default(),
        }
    }
}

impl Direct {
    /// Most points of lights in all subsets: what one binding of the portable tier holds.
    const MOST_PRESAMPLED: u32 = 1 << 21;

    /// Brings every field into its range and says what it changed.
    pub(super) fn validate(&mut self, warnings: &mut Vec<String>) {
        let mut ranges = Ranges { of: "direct.", warnings };
        ranges.count("candidates", &mut self.candidates, 1, 64);
        ranges.count("subset_count", &mut self.subset_count, 0, 4096);
        let most = Self::MOST_PRESAMPLED / self.subset_count.max(1);
        ranges.count("subset_size", &mut self.subset_size, 1, most.min(16384));
        ranges.count("tile", &mut self.tile, 1, 16);
        ranges.count("spatial_taps", &mut self.spatial_taps, 0, 5);
        ranges.count("disocclusion_taps", &mut self.disocclusion_taps, 0, 5);
        ranges.count("rounds", &mut self.rounds, 1, 4);
        ranges.count("tries", &mut self.tries, 1, 8);
        ranges.number("radius", &mut self.radius, 0.0, 1e5);
        ranges.number("confidence_cap", &mut self.confidence_cap, 0.0, 60.0);
        ranges.number("visibility_radius", &mut self.visibility_radius, 0.0, 1e6);
        ranges.number("normal_threshold", &mut self.normal_threshold, -1.0, 1.0);
        ranges.number("depth_threshold", &mut self.depth_threshold, 0.0, 1e6);
    }
}
