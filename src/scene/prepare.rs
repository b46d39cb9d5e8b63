//! Updates the GPU scene once a frame: materials and textures first, then instances and lights, which need them, then uploads and bind
//! groups.
//!
//! Every pool tracks its changes, so a scene that does not change uploads nothing.

use bevy::{
    asset::AssetServer,
    ecs::{prelude::*, system::SystemParam},
    render::{
        render_asset::RenderAssets,
        render_resource::PipelineCache,
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
        texture::GpuImage,
    },
};

use crate::{
    cpu_times::{CpuTimes, Stage},
    gpu_layout::*,
    shader_library::ShaderLibrary,
};

use super::{
    accel::ray_query::{self, AccelerationStructures},
    bindings::{PlaceholderTextures, SceneBindings},
    extract::{
        ExtractedScene,
        instances::{InstanceList, sorted},
    },
    features::SceneFeatures,
    geometry::{bodies::BodyPool, instance_record::InstanceSources, instances::InstancePool, meshes::MeshPool},
    light::lights::LightPool,
    material::{directional_albedo, materials::MaterialPool, subsurface::SubsurfacePool},
    storage::{growable_buffer::GrowableBuffer, uploads::Uploads},
    texture::textures::TexturePool,
};

/// The GPU copies of all parts of the scene.
#[derive(SystemParam)]
pub(super) struct Pools<'w> {
    meshes: ResMut<'w, MeshPool>,
    bodies: ResMut<'w, BodyPool>,
    textures: ResMut<'w, TexturePool>,
    materials: ResMut<'w, MaterialPool>,
    subsurface: ResMut<'w, SubsurfacePool>,
    instances: ResMut<'w, InstancePool>,
    lights: ResMut<'w, LightPool>,
}

/// The device, and Bevy's resources that the pools read.
#[derive(SystemParam)]
pub(super) struct Context<'w> {
    images: Res<'w, RenderAssets<GpuImage>>,
    assets: Res<'w, AssetServer>,
    pipelines: Res<'w, PipelineCache>,
    shaders: Res<'w, ShaderLibrary>,
    times: Res<'w, CpuTimes>,
    #[cfg(feature = "testing")]
    check: Option<Res<'w, super::extract::instances::CheckMirror>>,
    device: Res<'w, RenderDevice>,
    queue: Res<'w, RenderQueue>,
}

/// Brings the GPU scene up to date with the extracted scene.
pub(super) fn prepare_scene(
    mut scene: ResMut<ExtractedScene>,
    mut pools: Pools,
    mut bindings: ResMut<SceneBindings>,
    context: Context,
) {
    let (changed, moved) = (scene.instances.take_changed(), scene.instances.take_moved());
    update_materials(&mut scene, &mut pools, &context);
    update_instances_and_lights(&mut scene, changed, &moved, &mut pools, &context);
    let mut uploaded = upload(&mut pools, &context);
    let has_albedo = !scene.energy_compensation || bindings.prepare_specular_albedo(&context.device, &context.queue);
    let running = context.times.measure(Stage::Bindings);
    uploaded += bindings.write_uniforms(&uniforms(&pools), &context.device, &context.queue);
    update_bind_groups(&mut bindings, &mut pools, &context);
    bindings.lacks_memory |= !has_albedo;
    drop(running);
    let _running = context.times.measure(Stage::Summary);
    summarize(&mut bindings, &pools, &scene);
    let drawn = update_draws(&mut bindings, &pools);
    bindings.visited = visited(&mut scene, &pools, drawn);
    bindings.uploaded_bytes = uploaded;
}

/// Gives slots to the materials in use, copies their textures and packs the materials that changed.
fn update_materials(scene: &mut ExtractedScene, pools: &mut Pools, context: &Context) {
    let Context { images, assets, pipelines, shaders, times, device, queue, .. } = context;
    let Pools { meshes, textures, materials, instances, .. } = pools;
    let running = times.measure(Stage::Materials);
    materials.limit_to(device);
    meshes.warn_of_lines_and_points(&scene.instances);
    materials.update_sources(scene);
    let is_complete = meshes.shown_are_built(&scene.instances) && !instances.waiting;
    materials.make_room(&mut scene.instances, is_complete);
    drop(running);
    let running = times.measure(Stage::Textures);
    if scene.expected.contains(SceneFeatures::TEXTURES) {
        textures.prepare_pipeline(pipelines, shaders);
    }
    let used_changed = materials.has_changed();
    let slots_changed = textures.update(
        used_changed,
        materials.images(&scene.instances),
        images,
        pipelines,
        shaders,
        assets,
        device,
        queue,
    );
    drop(running);
    let _running = times.measure(Stage::Materials);
    materials.pack(textures, slots_changed);
}

/// Updates the records of instances and lights, and the trees over them.
fn update_instances_and_lights(
    scene: &mut ExtractedScene,
    changed: Vec<MainEntity>,
    moved: &[MainEntity],
    pools: &mut Pools,
    context: &Context,
) {
    let Context { assets, pipelines, shaders, times, device, queue, .. } = context;
    let running = times.measure(Stage::Bodies);
    let Pools { meshes, bodies, .. } = pools;
    bodies.update(scene, meshes, device, queue);
    if !bodies.is_empty() || scene.expected.contains(SceneFeatures::DEFORMATION) {
        bodies.prepare_pipelines(pipelines, shaders);
    }
    drop(running);
    let running = times.measure(Stage::Instances);
    let due = due_instances(changed, &scene.instances, pools, device);
    let Pools { meshes, bodies, materials, subsurface, instances, lights, .. } = pools;
    let mut limit = GrowableBuffer::<GpuInstance>::limit(device);
    if instances.top.structures.is_some() {
        limit = limit.min(ray_query::MAX_SLOTS).min(device.limits().max_tlas_instance_count);
    }
    let mut sources = InstanceSources { meshes, bodies, materials, subsurface, assets, limit };
    instances.update(due, moved, scene, &mut sources);
    #[cfg(feature = "testing")]
    if context.check.is_some() {
        instances.check(&scene.instances, &mut sources);
    }
    meshes.keep_substitutes(&mut instances.substitutes);
    drop(running);
    let _running = times.measure(Stage::Lights);
    // The buffer also holds the records that only the table of the last frame has, so each table gets half of it.
    let max_lights = GrowableBuffer::<GpuLight>::limit(device) / 2;
    lights.update(scene, instances, meshes, materials, max_lights);
    if lights.meshes_changed || meshes.has_more_copies() {
        meshes.update_copies(&lights.emissive_meshes(), device, queue);
    }
    #[cfg(feature = "testing")]
    if context.check.is_some() {
        lights.check(scene, instances, meshes, materials);
    }
}

/// The instances to visit besides those that have only moved: changed ones, instances of a changed mesh or material, posed ones and unsettled
/// ones.
fn due_instances(
    changed: Vec<MainEntity>,
    list: &InstanceList,
    pools: &mut Pools,
    device: &RenderDevice,
) -> Vec<MainEntity> {
    let Pools { meshes, materials, subsurface, instances, .. } = pools;
    subsurface.begin_frame(device);
    let mut due = changed;
    due.extend(instances.take_unsettled());
    due.extend(meshes.take_changed().into_iter().flat_map(|id| list.users_of_mesh(id)));
    due.extend(materials.take_changed().into_iter().flat_map(|id| list.users_of_material(id)));
    due.extend(list.posed());
    sorted(due)
}

/// Builds the trees over instances and lights, and uploads everything that changed.  Returns the number of bytes sent.
fn upload(pools: &mut Pools, context: &Context) -> u64 {
    let Context { pipelines, times, device, queue, .. } = context;
    let Pools { meshes, bodies, materials, subsurface, instances, lights, .. } = pools;
    // The device's own trees are built from posed triangles.
    let running = times.measure(Stage::Bodies);
    let uploaded_poses = bodies.deform(meshes, pipelines, device, queue);
    drop(running);
    // The buffer of nodes grows here, before parts of the top level are copied to it.
    let running = times.measure(Stage::Lights);
    let uploaded_shapes = lights.build_shapes(meshes, device, queue);
    drop(running);
    let mut uploads = Uploads::new(device, queue);
    let running = times.measure(Stage::TopLevel);
    instances.update_top_level(meshes, bodies, &mut uploads);
    #[cfg(feature = "testing")]
    if context.check.is_some() {
        instances.check_top_level();
    }
    drop(running);
    let _running = times.measure(Stage::Upload);
    let bytes = meshes.uploaded
        + uploaded_poses
        + instances.top.uploaded_nodes
        + uploaded_shapes
        + materials.upload(&mut uploads)
        + subsurface.upload(device, queue)
        + instances.upload(&mut uploads)
        + lights.upload(&mut uploads)
        + meshes.update_corner_textures(instances.totals.features(), bodies.sources(), device, queue);
    uploads.submit();
    bytes
}

fn uniforms(pools: &Pools) -> GpuSceneUniforms {
    let Pools { instances, lights, .. } = pools;
    let (bins, previous_bins) = (lights.bins(), lights.previous_bins());
    let [tlas_root, tlas_indices, previous_tlas_root, previous_tlas_indices] = instances.top.top_levels();
    let [shapes_root, shapes_indices] = lights.shapes();
    GpuSceneUniforms {
        tlas_root,
        tlas_indices,
        previous_tlas_root,
        previous_tlas_indices,
        lights_end: lights.end(),
        instance_count: instances.len(),
        light_power: lights.power().min(1e30) as f32,
        radius: instances.top.radius,
        center: instances.top.center,
        previous_first_bin: previous_bins.as_ref().map_or(NONE, |bins| bins.start),
        shapes_root,
        shapes_indices,
        sun_count: lights.sun_count(),
        environment_limit: lights.environment_limit(),
        previous_center: instances.top.previous_sphere.0,
        previous_radius: instances.top.previous_sphere.1,
        light_bins: bins.len() as u32,
        previous_light_bins: previous_bins.map_or(0, |bins| bins.len() as u32),
        first_bin: bins.start,
        first_mesh_bin: lights.first_mesh_bin(),
    }
}

/// Creates bind groups again whose buffers or textures were replaced.
fn update_bind_groups(bindings: &mut SceneBindings, pools: &mut Pools, context: &Context) {
    let Context { pipelines, device, queue, .. } = context;
    let Pools { meshes, bodies, textures, materials, subsurface, instances, lights } = pools;
    // A buffer cannot be bound before it exists, so that of a scene without lights or meshes holds one unused element.
    let reserved = meshes.nodes.reserve(1, device, queue)
        && meshes.triangles.reserve(1, device, queue)
        && meshes.vertices.reserve(1, device, queue)
        && instances.gpu.reserve(1, device, queue)
        && materials.gpu.reserve(1, device, queue)
        && lights.gpu.reserve(1, device, queue);
    let fits = bodies.fits && instances.fits && materials.fits && subsurface.fits && lights.fits;
    let has_trees = !instances.top.lacks_memory();
    bindings.lacks_memory = !(reserved && fits && has_trees);
    let placeholders = bindings.placeholders.get_or_insert_with(|| PlaceholderTextures::new(device)).clone();
    if reserved
        && let (Some(u), Some(n), Some(t), Some(v), Some(i), Some(m), Some(l)) = (
            bindings.uniforms.clone(),
            meshes.nodes.buffer(),
            meshes.triangles.buffer(),
            meshes.vertices.buffer(),
            instances.gpu.buffer(),
            materials.gpu.buffer(),
            lights.gpu.buffer(),
        )
    {
        let specular_albedo = bindings.specular_albedo.clone();
        let views = [
            textures.view().unwrap_or(&placeholders.page),
            specular_albedo.as_ref().unwrap_or(&placeholders.texel),
            materials.table.view().unwrap_or(&placeholders.integers),
            meshes.second_uvs.view().unwrap_or(&placeholders.texel),
            subsurface.gpu.view().unwrap_or(&placeholders.texel),
            meshes.colors.view().unwrap_or(&placeholders.texel),
        ];
        bindings.bind(device, pipelines, [&u, n, t, v, i, m, l], views);
    }
    if let Some(structures) = &instances.top.structures {
        bindings.bind_structures(device, pipelines, structures);
    }
    if let Some(bindless) = &textures.bindless {
        bindings.bind_textures(device, pipelines, bindless, &placeholders.texel);
    }
}

/// Records the facts about the scene that views, frames and the report read.
fn summarize(bindings: &mut SceneBindings, pools: &Pools, scene: &ExtractedScene) {
    let Pools { meshes, bodies, textures, materials, instances, lights, .. } = pools;
    let expected = scene.expected.difference(if textures.bindless.is_some() {
        SceneFeatures::empty()
    } else {
        // No texture is bound without a copy on this device.
        SceneFeatures::BOUND_TEXTURES
    });
    bindings.features = bindings.recent_features.features(instances.totals.features() | lights.features) | expected;
    bindings.features.set(SceneFeatures::RAY_QUERY, instances.top.structures.is_some());
    bindings.motion_revision = instances.motion_revision + lights.revision;
    let top = &instances.top;
    bindings.keeps_light_probabilities = lights.is_same() && top.radius == top.previous_sphere.1;
    bindings.edit_revision = materials.edit_revision + textures.edit_revision + instances.edit_revision;
    let poses_expected = bodies.is_ready() || !expected.contains(SceneFeatures::DEFORMATION);
    bindings.ready =
        meshes.shown_are_built(&scene.instances) && !instances.waiting && textures.complete && poses_expected;
    bindings.memory = memory(bindings, pools);
    bindings.triangles = instances.totals.triangles;
    bindings.instances = instances.totals.instances;
    bindings.lights = lights.selectable();
    bindings.has_camera_dependent_objects = instances.totals.has_camera_dependent_objects();
    bindings.hidden_from = bindings.recent_hidden_from.update(instances.totals.hidden_from() | lights.hidden_from);
}

/// Numbers of elements that were looked at in this frame.  All are 0 where nothing has changed.  `drawn`: instances that were looked at for
/// the draw calls.
fn visited(scene: &mut ExtractedScene, pools: &Pools, drawn: u64) -> Vec<(&'static str, u64)> {
    let Pools { textures, materials, instances, lights, .. } = pools;
    vec![
        ("extracted_instances", scene.instances.take_visited()),
        ("materials", materials.visited),
        ("images", textures.visited),
        ("instances", instances.visited),
        ("emitters", lights.visited),
        ("emissive_triangles", lights.visited_triangles),
        ("draws", drawn),
    ]
}

fn memory(bindings: &SceneBindings, pools: &Pools) -> Vec<(&'static str, u64)> {
    let Pools { meshes, bodies, textures, materials, subsurface, instances, lights } = pools;
    let [body_records, poses, boxes] = bodies.memory();
    let albedo_bytes = (directional_albedo::SIZE * directional_albedo::SIZE * 4) as u64;
    vec![
        meshes.nodes.memory(),
        meshes.triangles.memory(),
        meshes.vertices.memory(),
        meshes.rigs.memory(),
        body_records,
        poses,
        boxes,
        instances.gpu.memory(),
        materials.gpu.memory(),
        materials.table.memory(),
        subsurface.gpu.memory(),
        meshes.second_uvs.memory(),
        meshes.colors.memory(),
        lights.gpu.memory(),
        textures.memory(),
        instances.top.structures.as_ref().map_or(("", 0), AccelerationStructures::memory),
        ("specular albedo", if bindings.specular_albedo.is_some() { albedo_bytes } else { 0 }),
        ("scene uniforms", size_of::<GpuSceneUniforms>() as u64),
    ]
}

/// Makes the draw calls of the visibility pass again if instances were added, removed or edited.  Returns the number of instances that were
/// looked at.
fn update_draws(bindings: &mut SceneBindings, pools: &Pools) -> u64 {
    let Pools { instances, materials, .. } = pools;
    let key = [instances.membership_revision, instances.edit_revision + materials.edit_revision];
    if bindings.draws_key == key {
        return 0;
    }
    bindings.draw_list.update(instances, materials);
    bindings.draws_key = key;
    instances.totals.instances
}
