//! Names of the steps that other plugins may order their systems against.

use bevy::ecs::schedule::SystemSet;

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
