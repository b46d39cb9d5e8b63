//! The scene on the GPU: mirrors the ECS into buffers, textures and acceleration structures that shaders read.
//!
//! | module | task |
//! |---|---|
//! | `extract` | copies instances, lights and materials from the main world |
//! | `geometry` | meshes, instances, deforming bodies, render layers, visibility ranges and draw calls |
//! | `accel` | bottom-level and top-level trees |
//! | `material`, `texture` | packed materials, the texture atlas and bindless textures |
//! | `light` | the table of all emitters, from which shaders sample |
//! | `prepare` | runs the pools of these modules in order, once a frame |
//! | `features`, `bindings` | features that shaders are specialized for, and the bind groups |
//! | `asset_wait`, `unsupported` | assets that are still loading, and warnings about components of Bevy that have no effect here |
//! | `lengths` | lengths of the tables, for tests |
//! | `storage` | growable buffers and their allocators |

pub mod accel;
mod asset_wait;
pub(crate) mod bindings;
pub(crate) mod extract;
mod features;
pub mod geometry;
#[cfg(feature = "testing")]
pub mod lengths;
pub mod light;
pub mod material;
mod prepare;
pub mod storage;
pub(crate) mod texture;
mod unsupported;

use bevy::{
    app::SubApp,
    ecs::{entity::Entities, prelude::*},
    render::{
        Extract, ExtractSchedule, Render, RenderSystems, mesh::RenderMesh, render_asset::prepare_assets,
        sync_world::MainEntity, texture::GpuImage,
    },
};
use core::num::NonZeroU32;

use crate::system_sets::{RestirSystems, is_on};
use bindings::SceneBindings;
use extract::ExtractedScene;
pub use features::SceneFeatures;
use geometry::{
    bodies::BodyPool,
    instances::InstancePool,
    meshes::{self, MeshPool},
    render_layers::{self, LayerSets},
    top_level::TopLevel,
};
use light::lights::LightPool;
use material::{materials::MaterialPool, subsurface::SubsurfacePool};
use texture::textures::{self, TexturePool};

/// Inserts the resources of the scene, without any contents.  `max_textures` is the length of texture arrays, if the device has them;
/// `repeatable`: pictures must not depend on the time that work in the background takes.
pub(crate) fn insert_resources(
    world: &mut World,
    ray_queries: bool,
    max_textures: Option<NonZeroU32>,
    repeatable: bool,
) {
    let (meshes, top) = match ray_queries {
        true => (MeshPool::for_ray_queries(), TopLevel::for_ray_queries()),
        false => (MeshPool::default(), TopLevel::for_software_rays(repeatable)),
    };
    world.insert_resource(meshes.that_may_wait(repeatable));
    world.insert_resource(InstancePool::new(top));
    world.insert_resource(max_textures.map(TexturePool::with_bindless).unwrap_or_default());
    world.insert_resource(ExtractedScene { is_new: true, ..Default::default() });
    world.insert_resource(LayerSets::default());
    world.insert_resource(BodyPool::default());
    world.insert_resource(MaterialPool::default());
    world.insert_resource(SubsurfacePool::default());
    world.insert_resource(LightPool::default());
    world.insert_resource(SceneBindings::default());
}

/// Adds the systems of the scene to the render world.
pub(crate) fn build(render_app: &mut SubApp) {
    render_app
        .add_systems(
            ExtractSchedule,
            (
                (
                    render_layers::extract_layers,
                    extract::extract_settings,
                    extract::instances::extract_instances,
                    extract::lights::extract_lights,
                    extract::extract_materials,
                    textures::extract_mean_colors,
                )
                    .chain(),
                unsupported::warn_of_unsupported,
                forget_warnings,
            )
                .run_if(is_on),
        )
        .add_systems(
            Render,
            (
                meshes::queue_meshes.before(prepare_assets::<RenderMesh>),
                textures::record_images.before(prepare_assets::<GpuImage>),
            )
                .in_set(RenderSystems::PrepareAssets)
                .run_if(is_on),
        )
        .add_systems(
            Render,
            (meshes::finish_meshes, prepare::prepare_scene).chain().in_set(RestirSystems::MirrorScene),
        );
    #[cfg(feature = "testing")]
    render_app.add_systems(
        ExtractSchedule,
        (
            extract::instances::check_instances.after(extract::instances::extract_instances),
            extract::lights::check_lights.after(extract::lights::extract_lights),
        )
            .run_if(is_on),
    );
}

/// Compares the mirror of instances and lights with the main world in each frame from now on, and panics where they differ, if `wanted`;
/// otherwise stops comparing.
#[cfg(feature = "testing")]
pub fn check_mirror(app: &mut bevy::app::App, wanted: bool) {
    let Some(render_app) = app.get_sub_app_mut(bevy::render::RenderApp) else { return };
    match wanted {
        true => _ = render_app.insert_resource(extract::instances::CheckMirror),
        false => _ = render_app.world_mut().remove_resource::<extract::instances::CheckMirror>(),
    }
}

/// Drops the pools' records of warnings about entities that are gone.
fn forget_warnings(
    mut instances: ResMut<InstancePool>,
    mut lights: ResMut<LightPool>,
    mut subsurface: ResMut<SubsurfacePool>,
    mut bodies: ResMut<BodyPool>,
    entities: Extract<&Entities>,
) {
    let exists = |entity: MainEntity| entities.contains(*entity);
    instances.forget_warnings(exists);
    lights.forget_warnings(exists);
    subsurface.forget_warnings(exists);
    bodies.forget_warnings(exists);
}
