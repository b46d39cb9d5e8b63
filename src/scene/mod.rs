//! The ECS mirrored into GPU buffers, in the order of the files: extract → geometry → blas → meshes; places → textures → materials;
//! instances → tlas; lights → emission, alias; bindings.  A still scene uploads no byte.

pub mod accel;
mod asset_wait;
pub(crate) mod bindings;
pub(crate) mod extract;
mod features;
pub mod geometry;
pub mod light;
pub mod material;
pub mod storage;
pub(crate) mod texture;
mod unsupported;

use bevy::{
    app::SubApp,
    asset::AssetServer,
    ecs::prelude::*,
    render::{
        Render, RenderSystems,
        mesh::RenderMesh,
        render_asset::{RenderAssets, prepare_assets},
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
        texture::GpuImage,
    },
};
use core::num::NonZeroU32;

use crate::{gpu_layout::*, shader_library::ShaderLibrary, system_sets::RestirSystems};
use accel::ray_query::{self, AccelerationStructures};
use bindings::{NoTexture, SceneBindings};
use extract::ExtractedScene;
pub use features::SceneFeatures;
use geometry::{
    draw_list,
    instances::InstancePool,
    meshes::{self, MeshPool},
    render_layers::{self, EVERYONE, LayerSets},
};
use light::lights::LightPool;
use material::{directional_albedo, materials::MaterialPool};
use storage::growable_buffer::GpuArray;
use texture::textures::{self, TexturePool};

/// Adds the mirror to the render world.
pub(crate) fn build(render_app: &mut SubApp, ray_queries: bool, bound_textures: Option<NonZeroU32>) {
    if ray_queries {
        render_app.insert_resource(MeshPool::for_ray_queries()).insert_resource(InstancePool::for_ray_queries());
    }
    if let Some(capacity) = bound_textures {
        render_app.insert_resource(TexturePool::with_bindless(capacity));
    }
    render_app
        .init_resource::<ExtractedScene>()
        .init_resource::<LayerSets>()
        .init_resource::<MeshPool>()
        .init_resource::<TexturePool>()
        .init_resource::<MaterialPool>()
        .init_resource::<InstancePool>()
        .init_resource::<LightPool>()
        .init_resource::<SceneBindings>()
        .add_systems(
            bevy::render::ExtractSchedule,
            (
                (render_layers::extract_layers, extract::extract_scene, textures::extract_mean_colors).chain(),
                unsupported::warn_of_ignored,
            ),
        )
        .add_systems(
            Render,
            (
                meshes::queue_meshes.before(prepare_assets::<RenderMesh>),
                textures::record_images.before(prepare_assets::<GpuImage>),
            )
                .in_set(RenderSystems::PrepareAssets),
        )
        .add_systems(Render, (meshes::finish_meshes, mirror_scene).chain().in_set(RestirSystems::MirrorScene));
}

fn mirror_scene(
    mut scene: ResMut<ExtractedScene>,
    mut meshes: ResMut<MeshPool>,
    mut textures: ResMut<TexturePool>,
    mut materials: ResMut<MaterialPool>,
    mut instances: ResMut<InstancePool>,
    mut lights: ResMut<LightPool>,
    mut bindings: ResMut<SceneBindings>,
    images: Res<RenderAssets<GpuImage>>,
    assets: Res<AssetServer>,
    pipelines: Res<PipelineCache>,
    shaders: Res<ShaderLibrary>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    materials.limit_to(&device);
    meshes.tell_of_unlit(&scene.instances);
    materials.update_sources(&mut scene);
    materials.make_room(&scene.instances, meshes.idle() && !instances.waiting);
    let moved = textures.update(materials.images(), &images, &pipelines, &shaders, &assets, &device, &queue);
    materials.pack(&textures, moved);
    let mut most_instances = GpuArray::<GpuInstance>::limit(&device);
    if instances.structures.is_some() {
        most_instances = most_instances.min(ray_query::MAX_SLOTS).min(device.limits().max_tlas_instance_count);
    }
    instances.update(&scene, &meshes, &mut materials, &assets, most_instances);
    // The last frame's table lies behind this frame's.
    lights.update(&scene, &mut instances, &meshes, &materials, GpuArray::<GpuLight>::limit(&device) / 2);
    instances.build_top_level(&mut meshes, &device, &queue);
    let uploaded_shapes = lights.build_shapes(&mut meshes, &device, &queue);

    let mut uploaded = meshes.uploaded + instances.uploaded_nodes + uploaded_shapes;
    uploaded += materials.upload(&device, &queue);
    uploaded += instances.upload(&device, &queue);
    uploaded += lights.upload(&device, &queue);
    uploaded += meshes.update_second_uvs(instances.features.contains(SceneFeatures::SECOND_UVS), &device, &queue);

    let bindings = &mut *bindings;
    if bindings.albedo.is_none() && scene.energy_compensation {
        bindings.albedo = Some(directional_albedo::texture(&device, &queue));
    }
    let [tlas_root, tlas_indices, previous_tlas_root, previous_tlas_indices] = instances.top_levels();
    let [shapes_root, shapes_indices] = lights.shapes();
    let uniforms = GpuSceneUniforms {
        tlas_root,
        tlas_indices,
        previous_tlas_root,
        previous_tlas_indices,
        light_count: lights.count(),
        instance_count: instances.len(),
        light_power: lights.power.min(1e30) as f32,
        radius: instances.radius,
        center: instances.center,
        previous_lights: lights.previous_at,
        shapes_root,
        shapes_indices,
        sun_count: lights.sun_count(),
        pad: 0,
    };
    uploaded += bindings.write_uniforms(&uniforms, &device, &queue);

    // Buffers exist from the first use on; a scene without lights or meshes binds one element of nothing.
    let reserved = meshes.nodes.reserve(1, &device, &queue)
        && meshes.triangles.reserve(1, &device, &queue)
        && meshes.attributes.reserve(1, &device, &queue)
        && instances.gpu.reserve(1, &device, &queue)
        && materials.gpu.reserve(1, &device, &queue)
        && lights.gpu.reserve(1, &device, &queue);
    let no_texture = bindings.no_texture.get_or_insert_with(|| NoTexture::new(&device)).clone();
    if reserved
        && let (Some(u), Some(n), Some(t), Some(a), Some(i), Some(m), Some(l)) = (
            bindings.uniforms.clone(),
            meshes.nodes.buffer(),
            meshes.triangles.buffer(),
            meshes.attributes.buffer(),
            instances.gpu.buffer(),
            materials.gpu.buffer(),
            lights.gpu.buffer(),
        )
    {
        let albedo = bindings.albedo.clone();
        let views = [
            textures.view().unwrap_or(&no_texture.page),
            albedo.as_ref().unwrap_or(&no_texture.texel),
            materials.table.view().unwrap_or(&no_texture.integers),
            meshes.second_uvs.view().unwrap_or(&no_texture.texel),
        ];
        bindings.bind(&device, &pipelines, [&u, n, t, a, i, m, l], views);
    }
    if let Some(structures) = &instances.structures {
        bindings.bind_structures(&device, &pipelines, structures);
    }
    if let Some(bound) = &textures.bindless {
        bindings.bind_textures(&device, &pipelines, bound, &no_texture.texel);
    }

    bindings.features = instances.features | lights.features;
    bindings.features.set(SceneFeatures::RAY_QUERY, instances.structures.is_some());
    bindings.motion_revision = instances.motion_revision + lights.revision;
    bindings.edit_revision = materials.revision + textures.revision + instances.edit_revision;
    bindings.ready = meshes.idle() && !instances.waiting && textures.complete;
    bindings.uploaded_bytes = uploaded;
    bindings.memory = vec![
        meshes.nodes.memory(),
        meshes.triangles.memory(),
        meshes.attributes.memory(),
        instances.gpu.memory(),
        materials.gpu.memory(),
        materials.table.memory(),
        meshes.second_uvs.memory(),
        lights.gpu.memory(),
        textures.memory(),
        instances.structures.as_ref().map_or(("", 0), AccelerationStructures::memory),
        (
            "specular albedo",
            bindings.albedo.as_ref().map_or(0, |_| (directional_albedo::SIZE * directional_albedo::SIZE * 4) as u64),
        ),
        ("scene uniforms", size_of::<GpuSceneUniforms>() as u64),
    ];
    bindings.triangles = instances.triangles;
    bindings.instances = instances.live.len() as u64;
    bindings.lights = lights.count() as u64;
    // What no ray meets is in no tree: nobody asks for it.
    let met = instances.live.iter().filter(|live| live.met_by != 0).map(|live| EVERYONE & !live.met_by);
    bindings.hidden_from = met.chain(lights.hidden.values().copied()).fold(0, |all, bits| all | bits);
    let drawn = (bindings.edit_revision, instances.live.len());
    if bindings.drawn != drawn {
        bindings.draws = draw_list::draws(&instances, &materials);
        bindings.drawn = drawn;
    }
}
