//! ReSTIR PT: whole paths, direct light among them (`shaders/restir/pt`).

use super::{
    TechniqueRow,
    domain::{self, Domain, LightPart, domain_names},
    reuse_schedule::ReuseSchedule,
};
use crate::{
    gpu_layout::PATH_RESERVOIR_SIZE,
    settings::{DebugView, Technique},
};

const ROOMS: &[&str] = &["restir/pt"];

/// Whole paths.
const DOMAIN: &Domain = &Domain {
    names: domain_names!("pt"),
    light_paths: None,
    candidates: domain::candidates("pt_candidates", "path_candidates", ROOMS),
    reuse: domain::reuse("pt_reuse", ROOMS),
    forward: &[],
    debug: Some(domain::debug("pt_debug", "debug_paths", ROOMS)),
    has_debug_view: DebugView::is_of_paths,
    reservoir_bytes: PATH_RESERVOIR_SIZE,
    carries_contribution: true,
    part: LightPart::Paths,
    schedule: ReuseSchedule::of_paths,
};

pub(super) const ROW: TechniqueRow =
    TechniqueRow { technique: Technique::Pt, domains: &[DOMAIN], light: None, rays: None, subsurface: Some(&[DOMAIN]) };
