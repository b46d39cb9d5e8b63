//! Keeps Bevy from drawing a camera's `Skybox` where our picture shows something else behind all objects.

use bevy::{core_pipeline::skybox::SkyboxBindGroup, ecs::prelude::*};

use super::{
    RestirView, ViewPool,
    bevy_handoff::HiddenFromBevy,
    extract::{EnvironmentKind, ExtractedViews},
};
use crate::{scene::SceneFeatures, settings::DebugView};

/// Bevy draws the skybox after our picture, wherever the last sample shows no object.  It would cover our own backdrop there, which may be the
/// mean of many samples, or a debug view.  Bevy makes the bind group again in each frame.  A frame that Bevy still draws, because our pipelines have
/// just become ready, keeps its skybox.
pub(super) fn hide_skyboxes(
    pool: Res<ViewPool>,
    extracted: Res<ExtractedViews>,
    hidden: Res<HiddenFromBevy>,
    mut commands: Commands,
) {
    for (entity, restir) in &extracted.0 {
        let is_shown = |view: &&RestirView| view.rendered && !hidden.bevy_draws(*entity);
        let Some(view) = pool.views.get(entity).filter(is_shown) else { continue };
        let shines = view.key.is_some_and(|key| key.features.contains(SceneFeatures::ENVIRONMENT));
        let has_own = restir
            .environment
            .is_some_and(|e| e.kind == EnvironmentKind::RestirEnvironment || shines && e.is_backdrop());
        if (has_own || view.settings.debug_view != DebugView::Off)
            && let Ok(mut camera) = commands.get_entity(*entity)
        {
            camera.remove::<SkyboxBindGroup>();
        }
    }
}
