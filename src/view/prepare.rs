//! Prepares the view of each camera for the frame: resolution, buffers, uniforms and history.

use bevy::{
    camera::MainPassResolutionOverride,
    ecs::{entity::Entities, prelude::*},
    log::warn,
    math::UVec2,
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::{PipelineCache, TextureView},
        renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
        sync_world::MainEntity,
        view::ExtractedView,
    },
};

use super::{
    RestirView, ViewPool, bands,
    environment::EnvironmentPool,
    extract::{ExtractedRestir, ExtractedViews},
    image_state::Reset,
    resolution,
    selection::{SelectedPipelines, Selection},
    uniforms::{UniformInputs, camera_of, is_finite},
};
use crate::{
    cpu_times::{CpuTimes, Stage},
    device::binding_limit,
    scene::{bindings::SceneBindings, geometry::instances::InstancePool, storage::allocation},
    settings::{Direct, Restir},
    technique::frame::Frame,
    warned::Warned,
};

type CameraData<'a> = (
    &'a MainEntity,
    &'a ExtractedCamera,
    &'a ExtractedView,
    Option<&'a TemporalJitter>,
    Option<&'a MainPassResolutionOverride>,
);

pub(super) fn prepare_views(
    mut pool: ResMut<ViewPool>,
    mut extracted: ResMut<ExtractedViews>,
    cameras: Query<CameraData>,
    entities: &Entities,
    selected: Res<SelectedPipelines>,
    scene: Res<SceneBindings>,
    instances: Res<InstancePool>,
    environments: Res<EnvironmentPool>,
    pipelines: Res<PipelineCache>,
    device: Res<RenderDevice>,
    adapter: Res<RenderAdapterInfo>,
    queue: Res<RenderQueue>,
    times: Res<CpuTimes>,
    mut warned: Local<Warned<(Entity, &'static str)>>,
) {
    let _running = times.measure(Stage::Views);
    let limit = binding_limit(&device.limits());
    warned.begin_frame();
    warned.retain(|(entity, _)| entities.contains(*entity));
    let pool = &mut *pool;
    pool.begin_frame(&extracted, entities);
    for (&entity, restir) in &mut extracted.0 {
        let (Some((name, camera, view, jitter, resolution_override)), Some(&selection)) =
            (cameras.get(entity).ok(), selected.0.get(&entity))
        else {
            // This camera renders nothing: an old frame of it must not be shown, captured or counted.
            pool.pause(entity);
            continue;
        };
        let ids = CameraIds { view: entity, main: **name };
        let current = camera_of(view);
        if !is_finite(&current) {
            warn_of_matrices(ids, &mut warned);
            pool.pause(entity);
            continue;
        }
        keep_last_state(restir, selection, &environments, pool, entity);
        let target_size = target_size_of(view, resolution_override);
        let frame = selection.key.unwrap_or(selection.requested).frame;
        let size = fit_to_device(ids, restir, frame, target_size, limit, &mut warned);
        let environment = environments.views_of(restir.environment.as_ref()).map_err(|error| ("environment", error));
        let view_or_error = environment.and_then(|environment| {
            view_of(pool, entity, [size, target_size], environment, &device, &pipelines)
                .map_err(|error| ("view", error))
        });
        let mut state = match view_or_error {
            Ok(state) => state,
            Err((resource, error)) => {
                warn_of_memory(ids, resource, &error, &mut warned);
                pool.pause(entity);
                pool.without_memory.insert(entity);
                continue;
            }
        };
        state.origin = UVec2::new(view.viewport.x, view.viewport.y);
        state.inverts_culling = view.invert_culling;
        state.select(restir, &selection, &scene);
        if scene.lacks_memory {
            pool.without_memory.insert(entity);
        }
        if state.rendered {
            let (scene, environments) = (&*scene, &*environments);
            let rays_per_dispatch = bands::limit_on(adapter.device_type);
            let bevy_jitter = jitter;
            let inputs =
                UniformInputs { restir, camera, view, current, bevy_jitter, scene, environments, rays_per_dispatch };
            state.update_uniforms(&inputs, &device, &queue);
            state.update_draws(scene, &instances, current);
            pool.requested_resets.remove(&entity);
            if let Err(error) = state.update_history(scene, limit, &device, &queue) {
                warn_of_memory(ids, "history", &error, &mut warned);
                pool.without_memory.insert(entity);
            }
            warn_of_light_paths(ids, &state, scene, limit, &mut warned);
        }
        pool.views.insert(entity, state);
    }
}

/// The size of the shown image, pixels.  An upscaler, such as DLSS, enlarges an image that fills only the corner of the viewport.
fn target_size_of(view: &ExtractedView, resolution_override: Option<&MainPassResolutionOverride>) -> UVec2 {
    let viewport = UVec2::new(view.viewport.z, view.viewport.w);
    resolution_override.map_or(viewport, |size| size.0.min(viewport)).max(UVec2::ONE)
}

/// A camera keeps its settings and its environment until the pipelines of the new ones are compiled and the image is there.
fn keep_last_state(
    restir: &mut ExtractedRestir,
    selection: Selection,
    environments: &EnvironmentPool,
    pool: &ViewPool,
    entity: Entity,
) {
    if let (Some(key), Some([settings, asked])) = (selection.key, pool.last_settings(entity))
        && !key.serves_settings_of(selection.requested)
    {
        restir.settings = Restir { reset: restir.settings.reset, ..settings.clone() };
        restir.asked = asked.clone();
    }
    let is_pending = restir.environment.is_some_and(|e| environments.is_pending(&e));
    if is_pending || selection.key.is_some_and(|key| !key.serves_environment_of(selection.requested)) {
        restir.environment = pool.last_environment(entity);
    }
}

/// The entities of a camera.
#[derive(Clone, Copy)]
struct CameraIds {
    /// In the render world.
    view: Entity,
    /// In the main world, for warnings.
    main: Entity,
}

fn warn_of_matrices(ids: CameraIds, warned: &mut Warned<(Entity, &'static str)>) {
    if warned.is_due((ids.view, "matrices")) {
        warn!(
            "restir: camera {} has a transform or a projection that is not finite or has no inverse; it is not rendered",
            ids.main
        );
    }
}

/// Warns that there is no memory for a resource of a camera.
fn warn_of_memory(
    ids: CameraIds,
    resource: &'static str,
    error: &impl core::fmt::Display,
    warned: &mut Warned<(Entity, &'static str)>,
) {
    if warned.is_due((ids.view, resource)) {
        warn!("restir: Bevy lights camera {}, because there is no memory for its {resource}: {error}", ids.main);
    }
}

/// Takes the view of the last frame out of the pool, or makes a new one if the traced or the shown size has changed.
fn view_of(
    pool: &mut ViewPool,
    camera: Entity,
    [size, target_size]: [UVec2; 2],
    environment: [&TextureView; 2],
    device: &RenderDevice,
    pipelines: &PipelineCache,
) -> Result<RestirView, String> {
    let mut beginning = Reset::Start;
    match pool.views.remove(&camera) {
        Some(mut view) if [view.size, view.target_size] == [size, target_size] => {
            view.set_environment(environment);
            return Ok(view);
        }
        // Drops the view of the old size first, because the memory may not hold both.
        Some(view) => {
            pool.paused.insert(camera, view.into_paused());
            beginning = Reset::Size;
        }
        None => {}
    }
    let new =
        allocation::attempt(device, "view", || RestirView::new(size, target_size, environment, device, pipelines))?;
    Ok(match pool.paused.remove(&camera) {
        Some(paused) => new.resumed_from(paused, beginning),
        None => new,
    })
}

/// Warns once for each camera about light sub-paths that its settings ask for and that are left out.
fn warn_of_light_paths(
    ids: CameraIds,
    state: &RestirView,
    scene: &SceneBindings,
    limit: u64,
    warned: &mut Warned<(Entity, &'static str)>,
) {
    if !state.traces_light() {
        return;
    }
    let counts = state.light_path_counts(scene, limit);
    if counts.is_reduced(&state.settings.bdpt, state.size) && warned.is_due((ids.view, "light paths")) {
        warn!(
            "restir: camera {} traces {} light paths instead of bdpt.light_paths = {} for each pixel, because a storage \
             binding of this device holds at most {limit} bytes",
            ids.main, counts.light_paths, state.settings.bdpt.light_paths
        );
    }
    let loses_splats = scene.has_camera_dependent_objects && state.settings.bdpt.splats();
    if loses_splats && warned.is_due((ids.view, "camera-dependent objects")) {
        warn!(
            "restir: camera {} finds caustics from the camera only (noisier; those of lights without a size are missing), because an object \
             of the scene has NotShadowCaster or RestirMaterial",
            ids.main
        );
    }
}

/// Reduces the traced resolution and the light subsets to what the device can bind, and warns once for each camera.  Returns the traced
/// resolution.
fn fit_to_device(
    ids: CameraIds,
    restir: &mut ExtractedRestir,
    frame: Frame,
    target_size: UVec2,
    limit: u64,
    warned: &mut Warned<(Entity, &'static str)>,
) -> UVec2 {
    let domains = frame.domains();
    let wanted = resolution::wanted_size(target_size, restir.settings.resolution_scale);
    let size = resolution::traced_size(wanted, domains, &restir.settings, limit);
    if size != wanted && warned.is_due((ids.view, "size")) {
        warn!(
            "restir: camera {} traces {} x {} pixels instead of {} x {}, because a storage binding of this device holds at \
             most {limit} bytes",
            ids.main, size.x, size.y, wanted.x, wanted.y
        );
    }
    if !domains.is_empty()
        && resolution::fit_subsets(&mut restir.settings.direct, limit)
        && warned.is_due((ids.view, "subsets"))
    {
        let Direct { subset_count, subset_size, .. } = restir.settings.direct;
        warn!(
            "restir: camera {} uses {subset_count} subsets of {subset_size} lights, because a storage binding of this device \
             holds at most {limit} bytes",
            ids.main
        );
    }
    size
}
