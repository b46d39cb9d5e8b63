//! ReSTIR GI: paths of at least two scattering events, reconnected at their secondary vertex, beside ReSTIR DI (`shaders/restir/gi`, which
//! extends `shaders/restir/pt`).

use super::{
    TechniqueRow, di,
    domain::{self, DebugPass, Domain, LightPart, domain_names, pair_passes},
    reuse_schedule::ReuseSchedule,
    sss,
};
use crate::{
    gpu_layout::INDIRECT_RESERVOIR_SIZE,
    settings::{DebugView, Technique},
};

const ROOMS: &[&str] = &["restir/gi", "restir/pt"];

/// Indirect light.
const DOMAIN: &Domain = &Domain {
    names: domain_names!("gi"),
    light_paths: None,
    candidates: domain::candidates("gi_candidates", "path_candidates", ROOMS),
    reuse: domain::reuse("gi_reuse", ROOMS),
    pairs: Some(pair_passes!("gi", ROOMS)),
    forward: &[],
    debug: &[DebugPass { shows: DebugView::is_of_paths, pass: domain::debug("gi_debug", "debug_paths", ROOMS) }],
    reservoir_bytes: INDIRECT_RESERVOIR_SIZE,
    part: LightPart::Paths,
    schedule: ReuseSchedule::of_indirect_light,
};

pub(super) const ROW: TechniqueRow = TechniqueRow {
    technique: Technique::Gi,
    domains: &[di::DOMAIN, DOMAIN],
    domains_with_subsurface: &[di::DOMAIN, sss::DOMAIN, DOMAIN],
    light_pass: None,
    rays_pass: None,
};
