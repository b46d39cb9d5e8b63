//! ReSTIR BDPT: whole paths as in ReSTIR PT, weighted against light sub-paths (`shaders/restir/bdpt`, which extends `shaders/restir/pt`);
//! and light sub-paths that the camera sees (`shaders/restir/splats`, and `shaders/restir/reconnected` for those that can be reconnected).

use super::{
    TechniqueRow,
    domain::{self, DebugPass, Domain, LightPart, PairPasses, domain_names, pair_passes},
    pass::{ComputePass, PassResource as R, Rays},
    reuse_schedule::ReuseSchedule,
};
use crate::{
    gpu_layout::{BIDIRECTIONAL_RESERVOIR_SIZE, RECONNECTED_RESERVOIR_SIZE, SPLAT_RESERVOIR_SIZE},
    settings::{DebugView, Technique},
};

const ROOMS: &[&str] = &["restir/bdpt", "restir/pt"];
/// Weights take light sub-paths into account.
const DEFS: &[&str] = &["LIGHT_PATHS"];

/// Rays between the camera and light sub-paths pass sides of surfaces that it does not draw.
const DRAWN_SIDES: &[&str] = &["DRAWN_SIDES"];

/// Resources of debug views that count light sub-paths (`shaders/restir/bdpt/light_counts.wgsl`).
const DEBUG_LIGHT_COUNTS: &[R] = &[R::Settings, R::LightVerticesRead, R::LightMapRead, R::Radiance];

/// Whole paths.
const DOMAIN: &Domain = &Domain {
    names: domain_names!("bdpt"),
    light_paths: Some(ComputePass {
        defs: DRAWN_SIDES,
        rays: Rays::LightPaths,
        ..ComputePass::per_pixel("light_paths", &[R::Settings, R::LightVertices, R::LightMap])
    }),
    candidates: ComputePass {
        defs: DEFS,
        resources: &[R::Settings, R::SubsetsRead, R::CandidateReservoirs, R::CandidateLight, R::LightVerticesRead],
        ..domain::candidates("bdpt_candidates", "path_candidates", ROOMS)
    },
    reuse: ComputePass { defs: DEFS, ..domain::reuse("bdpt_reuse", ROOMS) },
    pairs: Some(pair_passes!("bdpt", ROOMS, "LIGHT_PATHS")),
    forward: &[],
    debug: &[
        DebugPass {
            shows: DebugView::is_of_bidirectional_paths,
            pass: ComputePass { defs: DEFS, ..domain::debug("bdpt_debug", "debug_paths", ROOMS) },
        },
        DebugPass {
            shows: |view| view == DebugView::LightVertices,
            pass: ComputePass::per_pixel("debug_light_vertices", DEBUG_LIGHT_COUNTS),
        },
    ],
    reservoir_bytes: BIDIRECTIONAL_RESERVOIR_SIZE,
    part: LightPart::Paths,
    schedule: ReuseSchedule::of_bidirectional_paths,
};

/// Light sub-paths that the camera sees, without those of `RECONNECTED_DOMAIN` where the technique has it.
const SPLATS: &Domain = &Domain {
    names: domain_names!("splats"),
    light_paths: None,
    candidates: ComputePass::per_pixel(
        "splats",
        &[R::Settings, R::LightMapRead, R::CandidateReservoirs, R::CandidateLight],
    ),
    reuse: ComputePass { defs: DRAWN_SIDES, ..domain::reuse("splats_reuse", &["restir/splats"]) },
    pairs: None,
    forward: &[
        ComputePass {
            defs: DRAWN_SIDES,
            rays: Rays::Shift,
            ..ComputePass::per_pixel("splats_forward", &[R::Settings, R::LastReservoirs])
        },
        ComputePass::per_pixel("splats_gather", &[R::Settings, R::LastReservoirsRead, R::ForwardedReservoirs]),
    ],
    debug: &[
        DebugPass { shows: DebugView::is_of_light_paths, pass: domain::debug("splats_debug", "debug_splats", &[]) },
        DebugPass {
            shows: |view| view == DebugView::LightPathCounts,
            pass: ComputePass::per_pixel("debug_light_map", DEBUG_LIGHT_COUNTS),
        },
    ],
    reservoir_bytes: SPLAT_RESERVOIR_SIZE,
    part: LightPart::Splats,
    schedule: ReuseSchedule::of_splats,
};

const RECONNECTED_ROOMS: &[&str] = &["restir/reconnected"];

/// Light sub-paths that the camera sees, and that can be reconnected.
const RECONNECTED_DOMAIN: &Domain = &Domain {
    names: domain_names!("reconnected"),
    light_paths: None,
    candidates: ComputePass {
        defs: &["DRAWN_SIDES", "WITHIN_FRAME"],
        rays: Rays::Candidates,
        ..ComputePass::per_pixel(
            "reconnected",
            &[R::Settings, R::LightMapRead, R::CandidateReservoirs, R::CandidateLight],
        )
    },
    reuse: ComputePass { defs: DRAWN_SIDES, ..domain::reuse("reconnected_reuse", RECONNECTED_ROOMS) },
    // A shift within a frame replays nothing.
    pairs: Some(PairPasses { compaction: None, ..pair_passes!("reconnected", RECONNECTED_ROOMS, "DRAWN_SIDES") }),
    forward: &[],
    debug: &[],
    reservoir_bytes: RECONNECTED_RESERVOIR_SIZE,
    part: LightPart::Reconnected,
    schedule: ReuseSchedule::of_reconnected_light_paths,
};

pub(super) const ROW: TechniqueRow = TechniqueRow {
    technique: Technique::Bdpt,
    domains: &[DOMAIN, SPLATS],
    domains_with_subsurface: &[DOMAIN, SPLATS],
    light_pass: None,
    rays_pass: None,
};

/// With `LightTechniques::NoLightTracing`.
pub(super) const WITHOUT_SPLATS: TechniqueRow =
    TechniqueRow { domains: &[DOMAIN], domains_with_subsurface: &[DOMAIN], ..ROW };

/// With `Bdpt::reconnect_light_paths`.
pub(super) const RECONNECTED: TechniqueRow = TechniqueRow {
    domains: &[DOMAIN, SPLATS, RECONNECTED_DOMAIN],
    domains_with_subsurface: &[DOMAIN, SPLATS, RECONNECTED_DOMAIN],
    ..ROW
};
