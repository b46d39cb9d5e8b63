//! Prepares the view of each camera for the frame: resolution, buffers, uniforms and history.

use bevy::{
    camera::MainPassResolutionOverride,
    ecs::prelude::*,
    log::warn,
    math::UVec2,
    platform::collections::HashSet,
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::PipelineCache,
        renderer::{RenderDevice, RenderQueue},
        view::ExtractedView,
    },
};

use super::{
    RestirView, ViewPool,
    environment::EnvironmentPool,
    extract::{ExtractedRestir, ExtractedViews},
    resolution,
    selection::SelectedPipelines,
    uniforms::UniformInputs,
};
use crate::{
    scene::bindings::SceneBindings,
    settings::{Direct, Restir},
    technique::frame::Frame,
};

pub(super) fn prepare_views(
    mut pool: ResMut<ViewPool>,
    mut extracted: ResMut<ExtractedViews>,
    cameras: Query<(&ExtractedCamera, &ExtractedView, Option<&TemporalJitter>, Option<&MainPassResolutionOverride>)>,
    selected: Res<SelectedPipelines>,
    scene: Res<SceneBindings>,
    environments: Res<EnvironmentPool>,
    pipelines: Res<PipelineCache>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
    mut warned: Local<HashSet<(Entity, &'static str)>>,
) {
    let limit = resolution::binding_limit(&device);
    pool.views.retain(|entity, _| extracted.0.contains_key(entity));
    for (&entity, restir) in &mut extracted.0 {
        let (Some((camera, view, jitter, resolution_override)), Some(&selection)) =
            (cameras.get(entity).ok(), selected.0.get(&entity))
        else {
            // This camera renders nothing: an old frame of it must not be shown, captured or counted.
            pool.views.remove(&entity);
            continue;
        };
        if let (Some(key), Some(last)) = (selection.key, pool.views.get(&entity))
            && !key.serves_settings_of(selection.requested)
        {
            // The camera keeps its settings until the pipelines of the new ones are compiled.
            restir.settings = Restir { reset: restir.settings.reset, ..last.settings.clone() };
        }
        let viewport = UVec2::new(view.viewport.z, view.viewport.w);
        // An upscaler, such as DLSS, enlarges an image that fills only the corner of the viewport.
        let target_size = resolution_override.map_or(viewport, |size| size.0.min(viewport)).max(UVec2::ONE);
        let frame = selection.key.unwrap_or(selection.requested).frame;
        let size = fit_to_device(entity, restir, frame, target_size, limit, &mut warned);
        let Some((map, importance)) = environments.views_of(restir.environment.as_ref()) else {
            continue;
        };
        let state =
            pool.views.entry(entity).or_insert_with(|| RestirView::new(size, &device, &pipelines, map, importance));
        if state.size != size || state.bound_environment != (map.id(), importance.id()) {
            let new = RestirView::new(size, &device, &pipelines, map, importance);
            let old = core::mem::replace(state, new);
            if old.size == size {
                // Only the environment image has changed, and motion vectors still need the last camera.
                state.previous_camera = old.previous_camera;
                state.previous_jitter = old.previous_jitter;
            }
        }
        state.origin = UVec2::new(view.viewport.x, view.viewport.y);
        state.target_size = target_size;
        state.select(restir, &selection, &scene);
        if state.rendered {
            let (scene, environments) = (&*scene, &*environments);
            let inputs = UniformInputs { restir, camera, view, bevy_jitter: jitter, scene, environments };
            state.update_uniforms(&inputs, &queue);
            state.update_history(&device, &queue);
        }
    }
}

/// Reduces the traced resolution and the light subsets to what the device can bind, and warns once for each camera.  Returns the traced
/// resolution.
fn fit_to_device(
    entity: Entity,
    restir: &mut ExtractedRestir,
    frame: Frame,
    target_size: UVec2,
    limit: u64,
    warned: &mut HashSet<(Entity, &'static str)>,
) -> UVec2 {
    let domains = frame.domains();
    let size = resolution::traced_size(target_size, domains, &restir.settings, limit);
    if size != target_size && warned.insert((entity, "size")) {
        warn!(
            "restir: camera {entity} traces {} x {} pixels for its {} x {} viewport, because this device binds at most {limit} bytes",
            size.x, size.y, target_size.x, target_size.y
        );
    }
    if !domains.is_empty()
        && resolution::fit_subsets(&mut restir.settings.direct, limit)
        && warned.insert((entity, "subsets"))
    {
        let Direct { subset_count, subset_size, .. } = restir.settings.direct;
        warn!(
            "restir: camera {entity} uses {subset_count} subsets of {subset_size} lights, because this device binds at most {limit} bytes"
        );
    }
    size
}
