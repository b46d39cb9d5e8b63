//! Runs the frame of each camera: compiles and selects pipelines, binds the resources of passes, and records the passes into Bevy's 3D
//! schedule before its opaque pass.

pub(crate) mod composite;
mod executor;
pub(crate) mod pipelines;
mod recorder;
pub(crate) mod resource;
mod visibility;

use bevy::{
    app::SubApp,
    core_pipeline::{
        core_3d::main_opaque_pass_3d,
        schedule::{Core3d, Core3dSystems},
    },
    ecs::prelude::*,
    pbr::{deferred::deferred_lighting, screen_space_reflections},
    render::{Render, RenderSystems},
};

use crate::system_sets::RestirSystems;

/// Prefix of the time spans of passes in Bevy's diagnostics.
pub const SPAN_PREFIX: &str = "restir/";

/// Adds the passes to the render world.
pub(crate) fn build(render_app: &mut SubApp) {
    render_app
        .add_systems(
            Render,
            pipelines::select_pipelines.in_set(RestirSystems::SelectPipelines).in_set(RenderSystems::PrepareResources),
        )
        .add_systems(
            Core3d,
            executor::run_passes
                .in_set(RestirSystems::RunPasses)
                // The first pass that is recorded clears the picture, so the order of recording must be that of submission.
                .after(deferred_lighting)
                .after(screen_space_reflections)
                .before(main_opaque_pass_3d)
                .in_set(Core3dSystems::MainPass),
        );
}
