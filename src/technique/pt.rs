//! ReSTIR PT: whole paths (`shaders/restir/pt`).  Direct light is among them, or has reservoirs of its own (`shaders/restir/pt_indirect`).

use super::{
    TechniqueRow, di,
    domain::{self, DebugPass, Domain, DomainNames, LightPart, PairPasses, domain_names, pair_passes},
    pass::ComputePass,
    reuse_schedule::ReuseSchedule,
    sss,
};
use crate::{
    gpu_layout::PATH_RESERVOIR_SIZE,
    settings::{DebugView, Technique},
};

const ROOMS: &[&str] = &["restir/pt"];
const INDIRECT_ROOMS: &[&str] = &["restir/pt_indirect", "restir/pt"];

/// Whole paths.
const DOMAIN: &Domain = &domain(
    domain_names!("pt"),
    domain::candidates("pt_candidates", "path_candidates", ROOMS),
    domain::reuse("pt_reuse", ROOMS),
    pair_passes!("pt", ROOMS),
    DEBUG,
);
/// Debug views of whole paths.
const DEBUG: &[DebugPass] =
    &[DebugPass { shows: DebugView::is_of_paths, pass: domain::debug("pt_debug", "debug_paths", ROOMS) }];

/// Paths of at least two scattering events.
const INDIRECT: &Domain = &domain(
    domain_names!("pt_indirect"),
    domain::candidates("pt_indirect_candidates", "path_candidates", INDIRECT_ROOMS),
    domain::reuse("pt_indirect_reuse", INDIRECT_ROOMS),
    pair_passes!("pt_indirect", INDIRECT_ROOMS),
    INDIRECT_DEBUG,
);
/// Debug views of paths of at least two scattering events.
const INDIRECT_DEBUG: &[DebugPass] = &[DebugPass {
    shows: DebugView::is_of_paths,
    pass: domain::debug("pt_indirect_debug", "debug_paths", INDIRECT_ROOMS),
}];

const fn domain(
    names: DomainNames,
    candidates: ComputePass,
    reuse: ComputePass,
    pairs: PairPasses,
    debug: &'static [DebugPass],
) -> Domain {
    Domain {
        names,
        light_paths: None,
        candidates,
        reuse,
        pairs: Some(pairs),
        forward: &[],
        debug,
        reservoir_bytes: PATH_RESERVOIR_SIZE,
        part: LightPart::Paths,
        schedule: ReuseSchedule::of_paths,
    }
}

pub(super) const ROW: TechniqueRow = TechniqueRow {
    technique: Technique::Pt,
    domains: &[DOMAIN],
    domains_with_subsurface: &[DOMAIN],
    light_pass: None,
    rays_pass: None,
};

/// With `Paths::separate_direct_light`.
pub(super) const SEPARATE: TechniqueRow = TechniqueRow {
    domains: &[di::DOMAIN, INDIRECT],
    domains_with_subsurface: &[di::DOMAIN, sss::DOMAIN, INDIRECT],
    ..ROW
};
