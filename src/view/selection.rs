//! The pipelines that each camera requests, and those that it renders with until the requested ones are compiled.

use bevy::{
    core_pipeline::prepass::ViewPrepassTextures,
    ecs::{entity::Entity, resource::Resource},
    platform::collections::HashMap,
    render::{render_resource::TextureFormat, view::ViewTarget},
};

use super::{environment::EnvironmentPool, extract::ExtractedRestir};
use crate::{
    scene::{SceneFeatures, bindings::SceneBindings},
    technique::{
        frame::{Frame, PipelineKey},
        reuse_schedule::FEW_INPUTS,
    },
};

/// Targets of the composite pass: the format of the view target, and whether there is a texture of motion vectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct CompositeKey {
    pub format: TextureFormat,
    pub motion: bool,
}

impl CompositeKey {
    /// The key for the textures of a camera.
    pub(crate) fn of(target: &ViewTarget, prepass: Option<&ViewPrepassTextures>) -> Self {
        let motion = prepass.is_some_and(|textures| textures.motion_vectors.is_some());
        Self { format: target.main_texture_format(), motion }
    }
}

/// Pipelines of one camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Selection {
    pub requested: PipelineKey,
    /// Pipelines to render with: the requested ones, or those of the last frame until they are compiled.  `None` until the first ones are
    /// compiled.
    pub key: Option<PipelineKey>,
    /// Pipeline of the composite pass, if it is compiled.
    pub composite: Option<CompositeKey>,
    /// Bevy has an image to draw into.  A window sometimes gives none for a frame, for example while it is resized.
    pub has_target: bool,
}

/// Pipelines of all cameras, by render entity.
#[derive(Resource, Default)]
pub(crate) struct SelectedPipelines(pub HashMap<Entity, Selection>);

/// The pipelines that settings and scene request for a camera.  `last`: those of the last frame; `counts_rays`: the app wants to know rays.
pub(crate) fn requested_key(
    restir: &ExtractedRestir,
    scene: &SceneBindings,
    environments: &EnvironmentPool,
    last: Option<PipelineKey>,
    counts_rays: bool,
) -> PipelineKey {
    let environment = restir.environment.as_ref();
    let mut features = scene.features
        | match last {
            // The environment of the last frame stays.
            Some(last) if environment.is_some_and(|e| environments.is_pending(e)) => {
                last.features & SceneFeatures::OF_ENVIRONMENT
            }
            _ => environments.features(environment),
        };
    if scene.hidden_from & restir.layers != 0 {
        features |= SceneFeatures::RENDER_LAYERS;
    }
    features.set(SceneFeatures::ENERGY_COMPENSATION, restir.settings.energy_compensation);
    let splits_light = restir.settings.debug_view.is_part_of_light() || restir.settings.filter_iterations() > 0;
    features.set(SceneFeatures::SPLIT_LIGHT, splits_light);
    features.set(SceneFeatures::CONNECTIONS, restir.settings.connects_light_paths());
    features.set(SceneFeatures::COPIED_MIS, restir.settings.copies_mis_weights());
    features.set(SceneFeatures::COUNT_RAYS, counts_rays || restir.settings.debug_view.shows_counts());
    let frame = Frame::of(&restir.settings).of_scene(features);
    // No shader depends on it.
    features.remove(SceneFeatures::SMOOTH);
    let inputs = frame.domains().iter().map(|domain| (domain.schedule)(&restir.settings).max_searched_inputs());
    features.set(SceneFeatures::MANY_NEIGHBORS, inputs.max().unwrap_or(0) > FEW_INPUTS);
    PipelineKey { frame, features }
}
