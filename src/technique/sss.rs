//! ReSTIR SSS: light that enters translucent objects, beside ReSTIR DI (`shaders/restir/sss`).

use super::{
    domain::{self, DebugPass, Domain, LightPart, domain_names},
    reuse_schedule::ReuseSchedule,
};
use crate::{gpu_layout::SUBSURFACE_RESERVOIR_SIZE, settings::DebugView};

const ROOMS: &[&str] = &["restir/sss"];

/// Direct light that scatters below the surface of a pixel.
pub(super) const DOMAIN: &Domain = &Domain {
    names: domain_names!("sss"),
    light_paths: None,
    candidates: domain::candidates("sss_candidates", "sss_candidates", &[]),
    reuse: domain::reuse("sss_reuse", ROOMS),
    pairs: None,
    forward: &[],
    debug: &[DebugPass { shows: DebugView::is_of_subsurface, pass: domain::debug("sss_debug", "debug_sss", &[]) }],
    reservoir_bytes: SUBSURFACE_RESERVOIR_SIZE,
    part: LightPart::Subsurface,
    schedule: ReuseSchedule::of_subsurface,
};
