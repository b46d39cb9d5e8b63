//! The reference path tracer (`shaders/pass/reference.wgsl`): no domains, no history.

use super::{
    TechniqueRow,
    pass::{ComputePass, PassResource as R, Rays},
};
use crate::settings::Technique;

const LIGHT: ComputePass =
    ComputePass { rays: Rays::Path, ..ComputePass::per_pixel("reference", &[R::Radiance, R::Counters]) };
const RAYS: ComputePass = ComputePass { name: "reference_rays", defs: &["SHOWS_RAYS"], ..LIGHT };

/// Scattering events of its paths, which every technique shows in [`DebugView::Bounces`](crate::DebugView::Bounces).
pub(super) const BOUNCES: ComputePass = ComputePass { name: "reference_bounces", defs: &["SHOWS_BOUNCES"], ..LIGHT };

pub(super) const ROW: TechniqueRow = TechniqueRow {
    technique: Technique::Reference,
    domains: &[],
    domains_with_subsurface: &[],
    light_pass: Some(&LIGHT),
    rays_pass: Some(&RAYS),
};
