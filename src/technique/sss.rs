//! ReSTIR SSS: light that enters translucent objects, beside ReSTIR DI (`shaders/restir/sss`).

use super::{
    domain::{self, Domain, LightPart, domain_names},
    reuse_schedule::ReuseSchedule,
};
use crate::gpu_layout::SUBSURFACE_RESERVOIR_SIZE;

const ROOMS: &[&str] = &["restir/sss"];

/// Direct light that scatters below the surface of a pixel.
pub(super) const DOMAIN: &Domain = &Domain {
    names: domain_names!("sss"),
    light_paths: None,
    candidates: domain::candidates("sss_candidates", "sss_candidates", &[]),
    reuse: domain::reuse("sss_reuse", ROOMS),
    pairs: None,
    forward: &[],
    debug: None,
    has_debug_view: |_| false,
    reservoir_bytes: SUBSURFACE_RESERVOIR_SIZE,
    carries_contribution: true,
    part: LightPart::Subsurface,
    schedule: ReuseSchedule::of_subsurface,
};
