//! What the settings of a technique come to: rounds of reuse, and their uniforms.

use crate::{
    gpu_types::*,
    settings::{BiasCorrection, Direct, Mis, Paths, Reconnection, Restir, ReuseOrder, Suffix, VisibilityReuse},
};

/// Inputs of a step of reuse that shaders without `MANY_TAPS` have room for (`MAX_INPUTS` in `shaders/restir/mis.wgsl`).
pub(crate) const FEW_INPUTS: u32 = 3;
/// Neighbours are at least as far away, pixels: nearer, a tap would mostly find the pixel itself.
const LEAST_RADIUS: f32 = 2.0;
/// Most rounds of reuse in a frame: one of the last frame, and four of this one.
pub(crate) const MOST_ROUNDS: usize = 5;

/// What is resampled: one domain, one set of reservoirs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Domain {
    /// Points of lights, seen from the pixels' surfaces.
    Direct,
    /// Whole paths.
    Paths,
    /// Paths from their first bounce on.
    Indirect,
}

/// A round of reuse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Round {
    /// Neighbours are of the last frame; otherwise of this one's last round.
    pub from_previous: bool,
    temporal_taps: u32,
    spatial_taps: u32,
}

/// The rounds of reuse of a frame, in order: at least one, which shades.
fn rounds(order: ReuseOrder, temporal: bool, spatial_taps: u32, rounds: u32) -> Vec<Round> {
    let temporal_taps = temporal as u32;
    let spatial_rounds = if spatial_taps > 0 { rounds as usize } else { 0 };
    let spatial = Round { from_previous: true, temporal_taps: 0, spatial_taps };
    match order {
        ReuseOrder::Spatiotemporal => {
            let mut rounds = vec![spatial; spatial_rounds.max(1)];
            rounds[0].temporal_taps = temporal_taps;
            rounds
        }
        ReuseOrder::TemporalThenSpatial => {
            let first = (temporal_taps > 0 || spatial_rounds == 0).then_some(Round {
                from_previous: true,
                temporal_taps,
                spatial_taps: 0,
            });
            first
                .into_iter()
                .chain(core::iter::repeat_n(Round { from_previous: false, ..spatial }, spatial_rounds))
                .collect()
        }
    }
}

/// How a domain is resampled.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Plan {
    pub rounds: Vec<Round>,
    /// What all rounds have in common.
    common: GpuResampleSettings,
    /// Flags of the first round only.
    first_flags: u32,
    /// Flags of rounds of the last frame where something moved.
    moved_flags: u32,
    /// MIS weights where there is one tap.
    single_mis: u32,
}

impl Plan {
    /// What some settings ask for.
    pub(crate) fn of(domain: Domain, settings: &Restir) -> Self {
        match domain {
            Domain::Direct => Self::direct(&settings.direct),
            Domain::Paths => Self::paths(&settings.paths, &settings.direct),
            Domain::Indirect => Self::indirect(&settings.paths, &settings.direct),
        }
    }

    fn direct(direct: &Direct) -> Self {
        let mis = mis_constant(direct.bias_correction, direct.mis);
        let of_candidates = !matches!(direct.visibility, VisibilityReuse::Ignored | VisibilityReuse::Shading);
        Self {
            rounds: rounds(direct.order, direct.temporal, direct.spatial_taps, direct.rounds),
            common: GpuResampleSettings {
                candidates: direct.candidates,
                disocclusion_taps: disocclusion_taps(direct.order, direct.disocclusion_taps),
                tries: direct.tries,
                radius: direct.radius,
                confidence_cap: direct.confidence_cap,
                mis,
                flags: direct_flags(direct),
                normal_threshold: direct.normal_threshold,
                depth_threshold: direct.depth_threshold,
                visibility_radius: direct.visibility_radius,
                tiling: direct.layout.tile(),
                ..light_subsets(direct)
            },
            first_flags: if of_candidates { RESAMPLE_SEEN } else { 0 },
            moved_flags: 0,
            single_mis: mis,
        }
    }

    fn paths(paths: &Paths, direct: &Direct) -> Self {
        let mis = mis_constant(BiasCorrection::UnbiasedMis, paths.mis);
        let flags = [
            (true, RESAMPLE_TARGET_RAYS | RESAMPLE_MIS_RAYS),
            (paths.heuristics, RESAMPLE_HEURISTICS),
            (paths.vector_weights, RESAMPLE_DECOUPLED),
            (paths.bilinear, RESAMPLE_BILINEAR),
            (paths.same_material, RESAMPLE_SAME_MATERIAL),
        ];
        Self {
            rounds: rounds(paths.order, paths.temporal, paths.spatial_taps, paths.rounds),
            common: GpuResampleSettings {
                candidates: paths.candidates,
                disocclusion_taps: disocclusion_taps(paths.order, paths.disocclusion_taps),
                tries: paths.tries,
                radius: paths.radius,
                confidence_cap: paths.confidence_cap,
                mis,
                flags: flags_of(flags),
                normal_threshold: paths.normal_threshold,
                depth_threshold: paths.depth_threshold,
                tiling: paths.layout.tile(),
                reconnection: match paths.reconnection {
                    Reconnection::Footprints => RECONNECT_FOOTPRINTS,
                    Reconnection::BlackBox => RECONNECT_BLACK_BOX,
                    Reconnection::Distance => RECONNECT_DISTANCE,
                },
                roughness: paths.roughness,
                separation: match paths.reconnection {
                    Reconnection::Distance => paths.distance,
                    _ => paths.footprint,
                },
                jacobian_limit: paths.jacobian_limit,
                ..light_subsets(direct)
            },
            first_flags: 0,
            moved_flags: RESAMPLE_MOVED
                | match paths.suffix {
                    Suffix::Exact => RESAMPLE_TRACE_FORTH | RESAMPLE_TRACE_BACK,
                    Suffix::Forward => RESAMPLE_TRACE_FORTH,
                    Suffix::Kept => 0,
                },
            single_mis: MIS_BALANCE,
        }
    }

    fn indirect(paths: &Paths, direct: &Direct) -> Self {
        let plan = Self::paths(paths, direct);
        let flags = flags_of([(true, RESAMPLE_INDIRECT), (paths.keeps_radiance, RESAMPLE_KEEPS_RADIANCE)]);
        Self {
            common: GpuResampleSettings {
                flags: plan.common.flags | flags,
                reconnection: RECONNECT_FIRST,
                roughness: 0.0,
                separation: paths.distance,
                ..plan.common
            },
            moved_flags: if paths.keeps_radiance { 0 } else { plan.moved_flags },
            ..plan
        }
    }

    /// Most inputs of one resampling step: the pixel's own and its taps.
    pub(crate) fn most_inputs(&self) -> u32 {
        let taps = self.rounds.iter().map(|round| {
            let disocclusion = if round.temporal_taps > 0 { self.common.disocclusion_taps } else { 0 };
            (round.temporal_taps + round.spatial_taps).max(disocclusion)
        });
        1 + taps.max().unwrap_or(0)
    }

    /// How reservoirs lie in memory: `TILING_*`, or pixels a side of a tile.
    pub(crate) fn tiling(&self) -> u32 {
        self.common.tiling
    }

    /// Uniforms of a round.  `moved`: something did since the last frame.
    /// `height`: of the picture, pixels.
    pub(crate) fn uniforms(&self, index: usize, height: u32, has_history: bool, moved: bool) -> GpuResampleSettings {
        let round = self.rounds[index];
        let taps = |count| if !round.from_previous || has_history { count } else { 0 };
        let flags = flags_of([
            (round.from_previous, RESAMPLE_FROM_PREVIOUS),
            (index + 1 == self.rounds.len(), RESAMPLE_SHADE),
            (index == 0, self.first_flags),
            (round.from_previous && moved, self.moved_flags),
        ]);
        GpuResampleSettings {
            temporal_taps: taps(round.temporal_taps),
            spatial_taps: taps(round.spatial_taps),
            mis: if round.spatial_taps == 0 { self.single_mis } else { self.common.mis },
            flags: self.common.flags | flags,
            round: index as u32,
            radius: pixels(self.common.radius, height).max(LEAST_RADIUS.min(self.common.radius)),
            visibility_radius: pixels(self.common.visibility_radius, height),
            ..self.common
        }
    }
}

/// Pixels of a picture that is so high, of a length in those of one of 1080 lines: samples are alike as far as surfaces are, which is a share of
/// the picture.
fn pixels(radius: f32, height: u32) -> f32 {
    radius * height as f32 / 1080.0
}

fn disocclusion_taps(order: ReuseOrder, taps: u32) -> u32 {
    if order == ReuseOrder::Spatiotemporal { taps } else { 0 }
}

/// The subsets that all techniques draw lights from.
fn light_subsets(direct: &Direct) -> GpuResampleSettings {
    GpuResampleSettings {
        subset_count: direct.subset_count,
        subset_size: direct.subset_size,
        tile: direct.tile,
        ..GpuResampleSettings::default()
    }
}

/// What rays may decide (Wyman and Panteleev 2021, Fig. 15), and how bias is held off.
fn direct_flags(direct: &Direct) -> u32 {
    use VisibilityReuse::*;
    let kind = direct.visibility;
    let of_target = matches!(kind, Discard | Resampled);
    flags_of([
        (direct.bsdf_candidate, RESAMPLE_BSDF_CANDIDATE),
        (!matches!(kind, Ignored | Shading), RESAMPLE_CANDIDATE_RAYS),
        (of_target, RESAMPLE_TARGET_RAYS),
        (kind == Discard, RESAMPLE_DISCARD),
        (of_target && direct.bias_correction.uses_mis_rays(), RESAMPLE_MIS_RAYS),
        (matches!(kind, Shading | Decoupled), RESAMPLE_SHADING_RAYS),
        (kind == Decoupled, RESAMPLE_REUSE_VISIBILITY),
        (direct.bias_correction.uses_heuristics(), RESAMPLE_HEURISTICS),
        (direct.decoupled_shading, RESAMPLE_DECOUPLED),
        (direct.simple_target, RESAMPLE_SIMPLE_TARGET),
        (direct.bilinear, RESAMPLE_BILINEAR),
        (direct.same_material, RESAMPLE_SAME_MATERIAL),
    ])
}

fn flags_of<const N: usize>(flags: [(bool, u32); N]) -> u32 {
    flags.into_iter().filter(|(condition, _)| *condition).fold(0, |all, (_, flag)| all | flag)
}

fn mis_constant(correction: BiasCorrection, mis: Mis) -> u32 {
    if !correction.uses_mis() {
        return MIS_UNIFORM;
    }
    match mis {
        Mis::Valid => MIS_VALID,
        Mis::Balance => MIS_BALANCE,
        Mis::Pairwise => MIS_PAIRWISE,
        Mis::DefensivePairwise => MIS_DEFENSIVE_PAIRWISE,
        Mis::DefensivePairwiseGris => MIS_DEFENSIVE_PAIRWISE_GRIS,
    }
}
