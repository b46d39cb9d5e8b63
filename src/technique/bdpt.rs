//! Bidirectional path tracing (`shaders/restir/bdpt`).  It keeps no reservoirs: the light of all techniques is added up.

use super::{
    TechniqueRow,
    domain::{Domain, DomainNames, LightPart},
    pass::{ComputePass, PassResource as R},
    reuse_schedule::{MAX_ITERATIONS, ReuseSchedule},
};
use crate::settings::Technique;

/// Paths from the camera, joined with light sub-paths.
const DOMAIN: &Domain = &Domain {
    names: DomainNames {
        domain: "bdpt",
        reuse: ["splats"; MAX_ITERATIONS],
        settings: "bdpt settings",
        reservoirs: "bdpt reservoirs",
        light: "bdpt light",
    },
    light_paths: Some(ComputePass::per_pixel("light_paths", &[R::Settings, R::LightVertices, R::LightMap])),
    candidates: ComputePass::per_pixel(
        "bdpt_candidates",
        &[R::Settings, R::SubsetsRead, R::LightVerticesRead, R::CandidateLight],
    ),
    reuse: ComputePass {
        specialized: false,
        ..ComputePass::per_pixel("splats", &[R::Settings, R::LightMapRead, R::LightBefore, R::LightAfter])
    },
    debug: None,
    has_debug_view: |_| false,
    reservoir_bytes: 0,
    carries_contribution: true,
    part: LightPart::Paths,
    schedule: ReuseSchedule::of_bidirectional_paths,
};

pub(super) const ROW: TechniqueRow =
    TechniqueRow { technique: Technique::Bdpt, domains: &[DOMAIN], light: None, rays: None, subsurface: None };
