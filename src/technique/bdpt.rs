//! ReSTIR BDPT: whole paths as in ReSTIR PT, weighted against light sub-paths, which add their own light (`shaders/restir/bdpt`, which
//! extends `shaders/restir/pt`).

use super::{
    TechniqueRow,
    domain::{self, Domain, LightPart, LightPathPasses, domain_names},
    pass::{ComputePass, PassResource as R},
    reuse_schedule::ReuseSchedule,
};
use crate::{
    gpu_layout::BIDIRECTIONAL_RESERVOIR_SIZE,
    settings::{DebugView, Technique},
};

const ROOMS: &[&str] = &["restir/bdpt", "restir/pt", "restir"];
/// Weights take light sub-paths into account.
const DEF: Option<&str> = Some("LIGHT_PATHS");

/// Whole paths.
const DOMAIN: &Domain = &Domain {
    names: domain_names!("bdpt"),
    light_paths: Some(LightPathPasses {
        trace: ComputePass::per_pixel("light_paths", &[R::Settings, R::LightVertices, R::LightMap]),
        connect: ComputePass::per_pixel("connections", &[R::Settings, R::LightVerticesRead, R::Connections]),
        gather: ComputePass {
            specialized: false,
            ..ComputePass::per_pixel("splats", &[R::Settings, R::LightMapRead, R::ConnectionsRead, R::LightPathLight])
        },
    }),
    candidates: ComputePass { def: DEF, ..domain::candidates("bdpt_candidates", "path_candidates", ROOMS) },
    reuse: ComputePass { def: DEF, ..domain::reuse("bdpt_reuse", ROOMS) },
    debug: Some(ComputePass { def: DEF, ..domain::debug("bdpt_debug", "debug_paths", ROOMS) }),
    has_debug_view: DebugView::is_of_paths,
    reservoir_bytes: BIDIRECTIONAL_RESERVOIR_SIZE,
    carries_contribution: true,
    part: LightPart::Paths,
    schedule: ReuseSchedule::of_bidirectional_paths,
};

pub(super) const ROW: TechniqueRow =
    TechniqueRow { technique: Technique::Bdpt, domains: &[DOMAIN], light: None, rays: None, subsurface: None };
