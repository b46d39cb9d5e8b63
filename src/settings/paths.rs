//! Resampled paths (Lin et al. 2022, 2026).

use bevy::reflect::Reflect;

use super::{Mis, Ranges, ReservoirLayout, ReuseOrder};

/// Which vertices of a path other pixels may reconnect to; before the first of them they replay its random numbers (Lin et al. 2026,
/// supplement, 2-4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum Reconnection {
    /// Where the footprints of both densities are large against the pixel's, after a rough lobe (Eqs. 5 and 6).
    #[default]
    Footprints,
    /// The same for materials whose lobes are not known: a density stands for the roughness (Eq. 26, as p <= 1/roughness²).
    BlackBox,
    /// Between rough lobes that are far apart (Lin et al. 2022).  Needs a distance that suits the scene.
    Distance,
}

/// What becomes of the end of a path, after its reconnection vertex, where something moved since the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
pub enum Suffix {
    /// It is traced again in both frames, into this one and back.  Unbiased.  Up to twice the rays of a path for the temporal tap.
    #[default]
    Exact,
    /// It is traced again in this frame only.  Biased: darker where light comes into sight.  Half the rays.
    Forward,
    /// It stays as it was.  Biased: light that bounces lags behind what moves.  No ray.
    Kept,
}

/// Resampled paths, for [`Technique::Pt`](super::Technique::Pt) and, from the first bounce on, [`Technique::Gi`](super::Technique::Gi).
/// Unbiased but for [`Suffix`]'s cheaper settings and [`Paths::keeps_radiance`].
#[derive(Clone, Debug, PartialEq, Reflect)]
pub struct Paths {
    /// Points of lights that a path's first vertex draws to aim at one, 1 to 64; a later vertex B draws 1/B² of them, at least one.
    /// They come from the subsets of [`Direct`](super::Direct).
    pub candidates: u32,
    /// When neighbours are met.
    pub order: ReuseOrder,
    /// Reuses the path that the surface had in the last frame.
    pub temporal: bool,
    /// Takes that path from one of the four pixels round the place that the surface had; otherwise from the nearest.
    pub bilinear: bool,
    /// Neighbours whose paths are reused in a round, at most 5.
    pub spatial_taps: u32,
    /// The same where the surface was not seen in the last frame, if more; of [`ReuseOrder::Spatiotemporal`] with `temporal` only.
    pub disocclusion_taps: u32,
    /// Rounds of spatial reuse, 1 to 4: a pass each.
    pub rounds: u32,
    /// Places that are tried for a tap until one is of like geometry, 1 to 8.
    pub tries: u32,
    /// How far away neighbours are: pixels of a picture 1080 lines high, and at least 2 of its own.
    pub radius: f32,
    /// Most that a neighbour counts, in frames' worth of candidates, at most 30.
    pub confidence_cap: f32,
    /// MIS weights of spatial reuse; temporal reuse alone always takes the balance heuristic.
    pub mis: Mis,
    /// What becomes of the end of a path where something moved.
    pub suffix: Suffix,
    /// Takes the radiance that leaves the first bounce to be the same to all sides (Lanz 2025, 4.3.3: the second BSDF left out; always
    /// [`Suffix::Kept`]).  For `Gi`.  Biased where that surface is glossy: brighter and darker by place.  Cheaper.
    pub keeps_radiance: bool,
    /// Where paths are reconnected; `Gi` always reconnects to the first bounce, after every lobe but a mirror's.
    pub reconnection: Reconnection,
    /// Least perceptual roughness of a lobe that paths are reconnected after (Lin et al. 2022: 0.2).
    pub roughness: f32,
    /// c of the footprints (Lin et al. 2026, supplement: 0.02, in hundredths of the pixel's); larger: later reconnections, fewer samples
    /// are shared.
    pub footprint: f32,
    /// Least distance between the vertices, m; for [`Reconnection::Distance`] and `Gi` (Lanz 2025, Eq. 30).  Paths that are nearer are not
    /// shared: fewer bright pixels in corners, no bias.
    pub distance: f32,
    /// Most Jacobian of a shift, and 1 over the least: pixels between which a path would change more are no neighbours for it (Lanz 2025,
    /// 4.5.5, both ways alike; of the densities of all that is sampled at both ends of the connection).  No bias; fewer bright pixels
    /// where shapes differ, fewer shared samples.
    pub jacobian_limit: f32,
    /// Shades all paths that meet by their shares, as [`Direct::decoupled_shading`], not only the one that is kept (vector weights, Lin et
    /// al. 2026, supplement, 7): less colour noise, no bias.
    pub vector_weights: bool,
    /// Leaves out neighbours whose geometry differs.  No bias either way.
    pub heuristics: bool,
    /// Least cosine between the normals of pixels that reuse each other's paths, for the heuristics.
    pub normal_threshold: f32,
    /// Most distance of one from the other's tangent plane, relative to the distance from the camera, for the heuristics.
    pub depth_threshold: f32,
    /// Neighbours are of the same material, for the heuristics.
    pub same_material: bool,
    /// How reservoirs lie in memory.
    pub layout: ReservoirLayout,
}

impl Default for Paths {
    /// As Lin et al. 2022 and 2026: temporal, then one round of spatial reuse, history capped at 20.  Neighbours within 60 pixels, not
    /// their 20: where light is found rarely fewer pixels share what they find, which is seen as blotches.  One neighbour, not their
    /// three, and 16 points of lights, not 32: in equal time that is better (`docs/performance.md`).
    fn default() -> Self {
        Self {
            candidates: 16,
            order: ReuseOrder::TemporalThenSpatial,
            temporal: true,
            bilinear: false,
            spatial_taps: 1,
            disocclusion_taps: 0,
            rounds: 1,
            tries: 1,
            radius: 60.0,
            confidence_cap: 20.0,
            mis: Mis::DefensivePairwise,
            suffix: Suffix::default(),
            keeps_radiance: false,
            reconnection: Reconnection::default(),
            roughness: 0.2,
            footprint: 0.02,
            distance: 0.01,
            jacobian_limit: 10.0,
            vector_weights: true,
            heuristics: true,
            normal_threshold: 0.9,
            depth_threshold: 0.02,
            same_material: false,
            layout: ReservoirLayout::default(),
        }
    }
}

impl Paths {
    /// Brings every field into its range and says what it changed.
    pub(super) fn validate(&mut self, warnings: &mut Vec<String>) {
        let mut ranges = Ranges { of: "paths.", warnings };
        ranges.count("candidates", &mut self.candidates, 1, 64);
        ranges.count("spatial_taps", &mut self.spatial_taps, 0, 5);
        ranges.count("disocclusion_taps", &mut self.disocclusion_taps, 0, 5);
        ranges.count("rounds", &mut self.rounds, 1, 4);
        ranges.count("tries", &mut self.tries, 1, 8);
        ranges.number("radius", &mut self.radius, 0.0, 1e5);
        ranges.number("confidence_cap", &mut self.confidence_cap, 0.0, 30.0);
        ranges.number("roughness", &mut self.roughness, 0.0, 1.0);
        ranges.number("footprint", &mut self.footprint, 0.0, 1e6);
        ranges.number("distance", &mut self.distance, 0.0, 1e6);
        ranges.number("jacobian_limit", &mut self.jacobian_limit, 1.0, f32::MAX);
        ranges.number("normal_threshold", &mut self.normal_threshold, -1.0, 1.0);
        ranges.number("depth_threshold", &mut self.depth_threshold, 0.0, 1e6);
    }
}
