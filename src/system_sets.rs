//! Names of the steps that other plugins may order their systems against, and the condition under which they run.

use bevy::ecs::{resource::Resource, schedule::SystemSet, system::Res};

/// Steps of the plugin in the render world.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum RestirSystems {
    /// Brings the mirror of the scene up to date, in `Render`, within `RenderSystems::PrepareResources`.
    MirrorScene,
    /// Prepares environment maps, in the same schedule, after `MirrorScene`.
    PrepareEnvironments,
    /// Chooses and requests the pipelines of each camera, in the same schedule, after `PrepareEnvironments`.
    SelectPipelines,
    /// Prepares the uniforms and the history of each camera, in the same schedule, after `SelectPipelines`.
    PrepareViews,
    /// Records the passes of each camera, in `Core3d`, before the main opaque pass.
    RunPasses,
}

/// Whether the present device meets all requirements.
#[derive(Resource)]
pub(crate) struct IsOn(pub bool);

pub(crate) fn is_on(on: Res<IsOn>) -> bool {
    on.0
}
