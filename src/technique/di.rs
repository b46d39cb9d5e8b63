//! ReSTIR DI: points of lights, seen from the pixels' surfaces (`shaders/restir/di`).

use super::{
    TechniqueRow,
    domain::{self, DebugPass, Domain, LightPart, PairPasses, domain_names, pair_passes},
    pass::{ComputePass, PassResource as R},
    reuse_schedule::ReuseSchedule,
    sss,
};
use crate::{
    gpu_layout::DIRECT_RESERVOIR_SIZE,
    settings::{DebugView, Technique},
};

const ROOMS: &[&str] = &["restir/di"];

/// Direct light.
pub(super) const DOMAIN: &Domain = &Domain {
    names: domain_names!("di"),
    light_paths: None,
    candidates: ComputePass {
        resources: &[R::Settings, R::SubsetsRead, R::CandidateReservoirs, R::CandidateLight, R::UnresampledLight],
        ..domain::candidates("di_candidates", "di_candidates", &[])
    },
    reuse: domain::reuse("di_reuse", ROOMS),
    // A shift of direct light replays nothing.
    pairs: Some(PairPasses { compaction: None, ..pair_passes!("di", ROOMS) }),
    forward: &[],
    debug: &[DebugPass { shows: DebugView::is_of_direct_light, pass: domain::debug("di_debug", "debug_di", &[]) }],
    reservoir_bytes: DIRECT_RESERVOIR_SIZE,
    part: LightPart::Direct,
    schedule: ReuseSchedule::of_direct_light,
};

pub(super) const ROW: TechniqueRow = TechniqueRow {
    technique: Technique::Di,
    domains: &[DOMAIN],
    domains_with_subsurface: &[DOMAIN, sss::DOMAIN],
    light_pass: None,
    rays_pass: None,
};
