//! ReSTIR DI: points of lights, seen from the pixels' surfaces (`shaders/restir/di`).

use super::{
    TechniqueRow,
    domain::{self, DebugPass, Domain, LightPart, domain_names},
    pass::ComputePass,
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
    candidates: domain::candidates("di_candidates", "di_candidates", &[]),
    reuse: domain::reuse("di_reuse", ROOMS),
    pairs: None,
    forward: &[],
    debug: &[DebugPass {
        shows: DebugView::is_of_direct_light,
        pass: ComputePass { specialized: false, ..domain::debug("di_debug", "debug_di", &[]) },
    }],
    reservoir_bytes: DIRECT_RESERVOIR_SIZE,
    carries_contribution: false,
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
