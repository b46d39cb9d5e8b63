//! ReSTIR PT and GI (Lin et al. 2022, 2026; Ouyang et al. 2021).

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

use super::{
    Reuse,
    validate::{Problem, Ranges},
};

/// Choice of the vertex at which other pixels reconnect to a path; up to the vertex before it they replay the path's random numbers (Lin et
/// al. 2026, supplement, 2-4).  No bias; noise and cost differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum Reconnection {
    /// After a rough lobe, where the footprints of the densities on both sides are large compared with the pixel's (Eqs. 5 and 6).
    #[default]
    Footprints,
    /// The same for materials whose lobes are unknown: a density stands for the roughness (Eq. 26, as p <= 1/roughness²: a GGX lobe of
    /// width α peaks near 1/α²).
    BlackBox,
    /// [`Reconnection::BlackBox`] with Eq. 26 as it is printed: p <= 1/√roughness.  At the default roughness of 0.2 that is p <= 2.2 instead
    /// of p <= 25: glossy lobes reconnect later.
    BlackBoxPrinted,
    /// After a rough lobe, where the product of both densities is small enough (Eq. 27).  It seldom reconnects between two glossy surfaces:
    /// more noise in glossy reflections.  For comparison.
    JacobianBound,
    /// After a rough lobe, where the path has spread beyond the pixel's footprint (Müller et al. 2021, as in the supplement of Lin et al. 2026,
    /// 11).  It does not look at the surface that it reconnects to, so that paths through glass and mirrors are not reused: caustics and
    /// reflections have more noise.  [`Paths::footprint`] from 2 on helps them, with less reuse on diffuse surfaces.  For comparison.
    PathFootprint,
    /// Between rough lobes that are a distance apart (Lin et al. 2022).  The distance must suit the scene.
    Distance,
}

/// Replay of the rest of a path, after its reconnection vertex, where something moved since the last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum SuffixRetrace {
    /// In both frames, from the last into this one and back.  Up to twice the rays of a path for temporal reuse.  Unbiased.
    #[default]
    BothWays,
    /// In this frame only: half of these rays.  Biased: darker where light comes into view.
    ForwardOnly,
    /// Not at all.  Biased: bounced light lags behind motion.
    Off,
}

/// Resampled paths, for [`Technique::Pt`](super::Technique::Pt), [`Technique::Bdpt`](super::Technique::Bdpt) and, after the first vertex,
/// [`Technique::Gi`](super::Technique::Gi).  Unbiased except with [`SuffixRetrace::ForwardOnly`], [`SuffixRetrace::Off`],
/// [`Paths::assume_diffuse_secondary`] and [`Paths::decorrelation`].
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default)]
pub struct Paths {
    /// Light candidates at the first vertex of a path, 1 to 64; the n-th vertex has 1/n² as many, but at least one (other counts have not
    /// been measured).  They come from the subsets of [`Direct`](super::Direct).  More give less noise at higher cost.  No bias.  Default 16.
    pub candidates: u32,
    /// Resamples direct light apart from paths in [`Technique::Pt`](super::Technique::Pt), by [`Restir::direct`](super::Restir::direct)
    /// and, for translucent objects, [`Restir::subsurface`](super::Restir::subsurface): less noise where direct and bounced light meet, for
    /// more time and rays (`docs/performance.md`, "One frame").  Without it one reservoir holds both (Lin et al. 2026, 7).  No bias.
    /// Default: on; off in `Performance`.
    pub separate_direct_light: bool,
    /// Reuse of paths; default [`Reuse::PATHS`].  [`Reuse::mis`] applies to iterations with spatial reuse; purely temporal ones always use the
    /// balance heuristic.
    pub reuse: Reuse,
    /// Replay of the rest of a path, after its reconnection vertex, where something moved.  Default: [`SuffixRetrace::BothWays`].
    pub suffix_retrace: SuffixRetrace,
    /// Treats the secondary vertex as diffuse, as the paper of ReSTIR GI does: the same radiance leaves it in all directions.  For
    /// [`Technique::Gi`](super::Technique::Gi).  Faster.  Biased: reflections in glossy secondary surfaces are wrong, brighter or darker; and
    /// bounced light lags behind lights that change, whatever [`Paths::suffix_retrace`] is.  Default: off.
    pub assume_diffuse_secondary: bool,
    /// Choice of the reconnection vertex.  `Gi` always reconnects at the secondary vertex, unless a mirror comes first.  Default:
    /// [`Reconnection::Footprints`].
    pub reconnection: Reconnection,
    /// Least perceptual roughness of a lobe before a reconnection (Lin et al. 2022); no effect in `Gi`.  Larger values reconnect later:
    /// fewer bright pixels, less reuse.  No bias.  0 to 1; default 0.2.
    pub roughness: f32,
    /// Least footprint of both vertices of a reconnection, in percent of the pixel's own (c in Lin et al. 2026, supplement), for all kinds
    /// of [`Reconnection`] but [`Reconnection::Distance`]; no effect in `Gi`.  Larger values reconnect later: fewer bright pixels, less
    /// reuse.  No bias.  0 to 1e6; default 0.02.
    pub footprint: f32,
    /// Least distance between reconnected vertices, m; for [`Reconnection::Distance`] and `Gi` (Lanz 2025, Eq. 30).  Larger values give
    /// fewer bright pixels in corners and less reuse.  No bias.  0 to 1e6; default 0.01.
    pub distance: f32,
    /// A shift fails if its Jacobian is above this value or below its reciprocal (Lanz 2025, 4.5.5, here in both directions, with the
    /// densities at both ends of the reconnection).  Smaller values give fewer bright pixels where geometry differs, and less reuse.  No
    /// bias.  From 1; default 10.
    pub jacobian_limit: f32,
    /// Trusts a sample of the last frame less where the pixels around it hold the same sample.  Such a sample makes room for new ones sooner,
    /// so that a rare bright path does not become a blotch that stays for many frames.  The value is the share of its confidence that a sample
    /// loses where all pixels around hold it.  Cost: each pixel compares the reservoir of the sample with eight others.  Biased: slightly
    /// darker, because bright samples are copied most (`docs/experiments.md`).  0 to 1; default 0, which is off and unbiased.  (The duplication
    /// map of Lin et al. 2026 has the same purpose, another definition, and is on by default there.)
    pub decorrelation: f32,
    /// Skips neighbors of dissimilar geometry: less noise at edges.  No bias.  Default: on.
    pub heuristics: bool,
}

impl Default for Paths {
    /// Two defaults differ from those of Lin et al. 2026: 16 light candidates instead of 32 have less error at equal time, and direct light
    /// has reservoirs of its own, for less noise in a frame (`docs/experiments.md`).
    fn default() -> Self {
        Self {
            candidates: 16,
            separate_direct_light: true,
            reuse: Reuse::PATHS,
            suffix_retrace: SuffixRetrace::default(),
            assume_diffuse_secondary: false,
            reconnection: Reconnection::default(),
            roughness: 0.2,
            footprint: 0.02,
            distance: 0.01,
            jacobian_limit: 10.0,
            decorrelation: 0.0,
            heuristics: true,
        }
    }
}

impl Paths {
    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        let mut ranges = Ranges { path: "paths.", report };
        ranges.count("candidates", &mut self.candidates, 1, 64);
        ranges.number("roughness", &mut self.roughness, 0.0, 1.0);
        ranges.number("footprint", &mut self.footprint, 0.0, 1e6);
        ranges.number("distance", &mut self.distance, 0.0, 1e6);
        ranges.number("jacobian_limit", &mut self.jacobian_limit, 1.0, f32::MAX);
        ranges.number("decorrelation", &mut self.decorrelation, 0.0, 1.0);
        self.reuse.clamp("paths.reuse.", 30.0, report);
    }
}
