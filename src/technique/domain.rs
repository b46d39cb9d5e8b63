//! Domains: sets of samples that are resampled together.  A technique consists of some of them.

use core::hash::{Hash, Hasher};

use super::{
    pass::{ComputePass, Dispatch, PassResource as R, Rays},
    reuse_schedule::{MAX_ITERATIONS, ReuseSchedule},
};
use crate::settings::{DebugView, Restir};

/// A set of samples that are resampled together, with reservoirs of its own.
pub(crate) struct Domain {
    /// Prefix of the names of its passes and buffers.
    pub names: DomainNames,
    /// The pass that traces light sub-paths, before the candidates.
    pub light_paths: Option<ComputePass>,
    /// The pass of the initial candidates.
    pub candidates: ComputePass,
    /// The pass of reuse, which runs once for each iteration.
    pub reuse: ComputePass,
    /// Passes of paired spatial reuse, if the domain has it.
    pub pairs: Option<PairPasses>,
    /// Passes before reuse that move the samples of the last frame to the pixels that they land in, where reuse finds them as neighbors.
    pub forward: &'static [ComputePass],
    /// Passes of its debug views.
    pub debug: &'static [DebugPass],
    /// Bytes of a reservoir.
    pub reservoir_bytes: u64,
    /// The part of a frame's light that it computes.
    pub part: LightPart,
    /// Iterations of reuse for some settings.
    pub schedule: fn(&Restir) -> ReuseSchedule,
}

/// A pass that shows reservoirs, or other samples of a domain, in place of light.  Besides the six storage buffers of the scene, a pass
/// can bind two of the eight that WebGPU guarantees, so that views of other buffers have passes of their own.
pub(crate) struct DebugPass {
    /// Whether it shows a debug view.
    pub shows: fn(DebugView) -> bool,
    pub pass: ComputePass,
}

/// Passes of an iteration of paired spatial reuse, in order.
pub(crate) struct PairPasses {
    /// Finds similar partners of each pixel.
    pub neighbors: ComputePass,
    /// Shifts the samples of partners to each pixel.
    pub shifts: ComputePass,
    /// Takes the place of `shifts` with replay compaction, if shifts may replay paths.
    pub compaction: Option<CompactionPasses>,
    /// Resamples by these shifts.
    pub reuse: ComputePass,
}

impl PairPasses {
    /// Its passes, each once.
    fn passes(&self) -> impl Iterator<Item = &ComputePass> {
        let of_compaction = self.compaction.iter().flat_map(|passes| [&passes.short_shifts, &passes.replays]);
        [&self.neighbors, &self.shifts, &self.reuse].into_iter().chain(of_compaction)
    }
}

/// Passes of replay compaction, in order.
pub(crate) struct CompactionPasses {
    /// Does the shifts that need no replay, and puts the pixels of the others into the replay queue.
    pub short_shifts: ComputePass,
    /// Does the shifts of the replay queue.
    pub replays: ComputePass,
}

/// Parts of the light of a frame, which `resolve` adds up; a frame has at most one domain for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LightPart {
    /// Direct light on surfaces.
    Direct,
    /// Direct light that enters translucent objects.
    Subsurface,
    /// Light of paths: bounced light, and direct light unless `Direct` has it.
    Paths,
    /// Light of light sub-paths that the camera sees, without those of `Reconnected`.
    Splats,
    /// Light of light sub-paths that the camera sees, and that can be reconnected.
    Reconnected,
}

impl LightPart {
    /// Number of parts: those up to the last one.
    pub(crate) const COUNT: usize = Self::Reconnected as usize + 1;
}

/// Names that appear in statistics and time spans.
pub(crate) struct DomainNames {
    pub domain: &'static str,
    pub reuse: [&'static str; MAX_ITERATIONS],
    pub pair_neighbors: [&'static str; MAX_ITERATIONS],
    pub pair_shifts: [&'static str; MAX_ITERATIONS],
    pub pair_replays: [&'static str; MAX_ITERATIONS],
    pub settings: &'static str,
    pub reservoirs: &'static str,
    pub light: &'static str,
}

/// The names of a pass in every iteration of reuse.
macro_rules! iteration_names {
    ($name:literal, $pass:literal) => {
        [
            concat!($name, $pass),
            concat!($name, $pass, "_2"),
            concat!($name, $pass, "_3"),
            concat!($name, $pass, "_4"),
            concat!($name, $pass, "_5"),
        ]
    };
}
pub(crate) use iteration_names;

/// The names of a domain, all with its own name as their prefix.
macro_rules! domain_names {
    ($name:literal) => {
        $crate::technique::domain::DomainNames {
            domain: $name,
            reuse: $crate::technique::domain::iteration_names!($name, "_reuse"),
            pair_neighbors: $crate::technique::domain::iteration_names!($name, "_pair_neighbors"),
            pair_shifts: $crate::technique::domain::iteration_names!($name, "_pair_shifts"),
            pair_replays: $crate::technique::domain::iteration_names!($name, "_pair_replays"),
            settings: concat!($name, " settings"),
            reservoirs: concat!($name, " reservoirs"),
            light: concat!($name, " light"),
        }
    };
}
pub(crate) use domain_names;

/// Fills the light subsets; once a frame, with the settings of the frame's first domain.
pub(crate) const PRESAMPLE: ComputePass =
    ComputePass { dispatch: Dispatch::Subsets, ..ComputePass::per_pixel("presample", &[R::Settings, R::Subsets]) };

/// Initial candidates of a domain.
pub(crate) const fn candidates(
    name: &'static str,
    file: &'static str,
    domain_rooms: &'static [&'static str],
) -> ComputePass {
    let resources = &[R::Settings, R::SubsetsRead, R::CandidateReservoirs, R::CandidateLight];
    ComputePass { file, domain_rooms, rays: Rays::Candidates, ..ComputePass::per_pixel(name, resources) }
}

/// The resampling routine for a domain.
pub(crate) const fn reuse(name: &'static str, domain_rooms: &'static [&'static str]) -> ComputePass {
    let resources = &[
        R::Settings,
        R::NeighborReservoirs,
        R::OutputReservoirs,
        R::PreviousVisibility,
        R::LightBefore,
        R::LightAfter,
    ];
    ComputePass { file: "reuse", domain_rooms, rays: Rays::Shifts, ..ComputePass::per_pixel(name, resources) }
}

/// The resources of the passes of paired spatial reuse.
pub(crate) const PAIR_NEIGHBORS: &[R] = &[R::Settings, R::NeighborReservoirs, R::PairMasks];
pub(crate) const PAIR_SHIFTS: &[R] = &[R::Settings, R::NeighborReservoirs, R::PairShifts, R::PairMasksRead];
pub(crate) const PAIR_SHORT_SHIFTS: &[R] =
    &[R::Settings, R::NeighborReservoirs, R::PairShifts, R::PairMasksRead, R::ReplayQueue];
pub(crate) const PAIR_REPLAYS: &[R] =
    &[R::Settings, R::NeighborReservoirs, R::PairShifts, R::PairMasksRead, R::ReplayQueueRead];
pub(crate) const PAIRED_REUSE: &[R] = &[
    R::Settings,
    R::NeighborReservoirs,
    R::OutputReservoirs,
    R::PairMasksRead,
    R::LightBefore,
    R::LightAfter,
    R::PairShiftsRead,
];

/// A pass of paired spatial reuse.
pub(crate) const fn pair_pass(
    name: &'static str,
    file: &'static str,
    domain_rooms: &'static [&'static str],
    defs: &'static [&'static str],
    resources: &'static [R],
) -> ComputePass {
    ComputePass { file, domain_rooms, defs, ..ComputePass::per_pixel(name, resources) }
}

/// Paired spatial reuse in a domain: the prefix of the names of its passes, the rooms of its technique, and its shader definitions.
macro_rules! pair_passes {
    ($name:literal, $rooms:expr $(, $def:literal)*) => {{
        use $crate::technique::{domain::*, pass::{ComputePass, Dispatch, Rays}};
        // Pairs are within a frame, so that nothing moves between their pixels.
        let within = &["WITHIN_FRAME" $(, $def)*];
        let defers = &["DEFERS_REPLAYS", "WITHIN_FRAME" $(, $def)*];
        let from_queue = &["FROM_QUEUE", "WITHIN_FRAME" $(, $def)*];
        // A pixel may have more pairs than other passes have neighbors.
        let reuse = &["PAIRED", "MANY_NEIGHBORS" $(, $def)*];
        let shifts = "pair_shifts";
        PairPasses {
            neighbors: pair_pass(concat!($name, "_pair_neighbors"), "pair_neighbors", $rooms, &[$($def)*], PAIR_NEIGHBORS),
            shifts: ComputePass {
                rays: Rays::PairShifts,
                ..pair_pass(concat!($name, "_pair_shifts"), shifts, $rooms, within, PAIR_SHIFTS)
            },
            compaction: Some(CompactionPasses {
                short_shifts: ComputePass {
                    rays: Rays::ShortPairShifts,
                    ..pair_pass(concat!($name, "_pair_short_shifts"), shifts, $rooms, defers, PAIR_SHORT_SHIFTS)
                },
                replays: ComputePass {
                    dispatch: Dispatch::ReplayQueue,
                    rays: Rays::PairShifts,
                    ..pair_pass(concat!($name, "_pair_replays"), shifts, $rooms, from_queue, PAIR_REPLAYS)
                },
            }),
            reuse: pair_pass(concat!($name, "_paired_reuse"), "reuse", $rooms, reuse, PAIRED_REUSE),
        }
    }};
}
pub(crate) use pair_passes;

/// Debug views of the reservoirs of a domain.
pub(crate) const fn debug(
    name: &'static str,
    file: &'static str,
    domain_rooms: &'static [&'static str],
) -> ComputePass {
    let resources = &[R::Settings, R::FinalReservoirs, R::Radiance];
    ComputePass { file, domain_rooms, ..ComputePass::per_pixel(name, resources) }
}

impl Domain {
    /// Its passes, each once.
    pub(crate) fn passes(&self) -> impl Iterator<Item = &ComputePass> {
        let of_pairs = self.pairs.iter().flat_map(PairPasses::passes);
        let of_debug_views = self.debug.iter().map(|debug| &debug.pass);
        self.light_paths
            .iter()
            .chain([&self.candidates, &self.reuse])
            .chain(of_pairs)
            .chain(self.forward)
            .chain(of_debug_views)
    }

    /// Index of the pass that shows a debug view, if it has one.
    pub(crate) fn debug_pass_of(&self, view: DebugView) -> Option<usize> {
        self.debug.iter().position(|debug| (debug.shows)(view))
    }
}

impl PartialEq for Domain {
    fn eq(&self, other: &Self) -> bool {
        self.names.domain == other.names.domain
    }
}

impl Eq for Domain {}

impl Hash for Domain {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.names.domain.hash(state);
    }
}

impl core::fmt::Debug for Domain {
    fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
        f.write_str(self.names.domain)
    }
}
