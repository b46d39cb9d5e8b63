//! Cameras: the state of each `Restir` camera that the render world keeps between frames, and the inputs of its passes.
//!
//! Each frame extracts the cameras, prepares environment images, selects pipelines and then prepares the views: resolution, uniforms, and
//! whether accumulation and history continue or restart.

pub(crate) mod bands;
pub(crate) mod bevy_handoff;
pub(crate) mod bind_groups;
pub(crate) mod capture;
pub(crate) mod capture_readback;
pub(crate) mod counters;
pub(crate) mod denoiser;
pub(crate) mod environment;
pub(crate) mod extract;
pub(crate) mod guards;
pub(crate) mod history;
pub(crate) mod image_state;
mod importance_map;
pub(crate) mod light_paths;
pub(crate) mod pairs;
mod prepare;
pub(crate) mod resolution;
mod restir_view;
pub(crate) mod selection;
pub(crate) mod shown_surfaces;
mod skybox;
mod uniforms;
mod visible_draws;

use bevy::{
    app::SubApp,
    core_pipeline::core_3d::prepare_prepass_textures,
    ecs::{entity::Entities, prelude::*},
    math::UVec2,
    platform::collections::{HashMap, HashSet},
    render::{
        Render, RenderSystems,
        render_resource::{binding_types::*, *},
        renderer::RenderDevice,
    },
};

use crate::{
    scene::geometry::render_layers, settings::Restir, system_sets::RestirSystems, technique::frame::PipelineKey,
};
use environment::EnvironmentPool;
use extract::{ExtractedEnvironment, ExtractedViews};
pub(crate) use restir_view::{PausedView, RestirView};
use selection::SelectedPipelines;

/// The views of all `Restir` cameras, by render entity.
#[derive(Resource, Default)]
pub(crate) struct ViewPool {
    pub views: HashMap<Entity, RestirView>,
    /// The state that is kept of cameras that are not rendered at present.
    pub paused: HashMap<Entity, PausedView>,
    /// Cameras that the device had no memory for in the last frame.
    pub without_memory: HashSet<Entity>,
    /// Cameras whose `Restir::reset` was set since they were last rendered.
    pub requested_resets: HashSet<Entity>,
}

impl ViewPool {
    /// Puts the views of cameras that are not rendered aside, and forgets cameras that are gone.
    fn begin_frame(&mut self, extracted: &ExtractedViews, entities: &Entities) {
        for (entity, view) in self.views.extract_if(|entity, _| !extracted.0.contains_key(entity)) {
            self.paused.insert(entity, view.into_paused());
        }
        self.paused.retain(|entity, _| entities.contains(*entity));
        self.requested_resets.retain(|entity| entities.contains(*entity));
        self.without_memory.clear();
    }

    /// Drops the view of a camera that is not rendered.
    fn pause(&mut self, camera: Entity) {
        if let Some(view) = self.views.remove(&camera) {
            self.paused.insert(camera, view.into_paused());
        }
    }

    /// Pipelines of the last frame of a camera.
    pub(crate) fn last_key(&self, camera: Entity) -> Option<PipelineKey> {
        match self.views.get(&camera) {
            Some(view) => view.key,
            None => self.paused.get(&camera)?.key,
        }
    }

    /// Settings of the last frame of a camera, and those that the app asked for then.
    fn last_settings(&self, camera: Entity) -> Option<[&Restir; 2]> {
        match self.views.get(&camera) {
            Some(view) => Some([&view.settings, &view.asked]),
            None => self.paused.get(&camera).map(|paused| [&paused.settings, &paused.asked]),
        }
    }

    /// The environment of the last frame of a camera.
    fn last_environment(&self, camera: Entity) -> Option<ExtractedEnvironment> {
        match self.views.get(&camera) {
            Some(view) => view.environment,
            None => self.paused.get(&camera)?.environment,
        }
    }
}

/// Inserts the resources of the views, without any view.
pub(crate) fn insert_resources(world: &mut World) {
    world.insert_resource(ExtractedViews::default());
    world.insert_resource(ViewPool::default());
    world.insert_resource(EnvironmentPool::default());
    world.insert_resource(SelectedPipelines::default());
}

/// Adds the systems of the views to the render world.
pub(crate) fn build(render_app: &mut SubApp) {
    render_app
        .init_resource::<counters::RunOfFrame>()
        .add_systems(
            bevy::render::ExtractSchedule,
            (
                (extract::extract_views.after(render_layers::extract_layers), extract::clear_reset).chain(),
                counters::extract_run,
            ),
        )
        .configure_sets(
            Render,
            (
                RestirSystems::MirrorScene,
                RestirSystems::PrepareEnvironments,
                RestirSystems::SelectPipelines.after(prepare_prepass_textures),
                RestirSystems::PrepareViews,
            )
                .chain()
                .in_set(RenderSystems::PrepareResources),
        )
        .add_systems(
            Render,
            (
                environment::prepare_environments.in_set(RestirSystems::PrepareEnvironments),
                prepare::prepare_views.in_set(RestirSystems::PrepareViews),
                skybox::hide_skyboxes.after(RenderSystems::PrepareBindGroups).before(RenderSystems::Render),
                capture_readback::capture_radiance.in_set(RenderSystems::Cleanup),
            ),
        );
}

/// Layout of group 1 for compute passes (`shaders/view/bindings.wgsl`).
pub(crate) fn view_layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir view",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                uniform_buffer_sized(false, None),
                texture_2d(TextureSampleType::Uint),
                texture_2d_array(TextureSampleType::Float { filterable: false }),
                texture_2d(TextureSampleType::Float { filterable: false }),
                texture_storage_2d_array(TextureFormat::R32Uint, StorageTextureAccess::ReadWrite),
            ),
        ),
    )
}

/// Layout of group 1 for raster passes.  They write the visibility buffer that compute passes bind, so they get only the uniforms.
pub(crate) fn raster_view_layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir raster view",
        &BindGroupLayoutEntries::sequential(ShaderStages::VERTEX_FRAGMENT, (uniform_buffer_sized(false, None),)),
    )
}

/// Format of the visibility buffer: (instance, triangle).
pub(crate) const VISIBILITY_FORMAT: TextureFormat = TextureFormat::Rg32Uint;
/// Format of its depth: reverse z.
pub(crate) const DEPTH_FORMAT: TextureFormat = TextureFormat::Depth32Float;

/// A visibility buffer.
fn visibility_buffer(device: &RenderDevice, label: &'static str, size: UVec2) -> TextureView {
    let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
    texture(device, label, size, 1, VISIBILITY_FORMAT, usage).create_view(&TextureViewDescriptor::default())
}

fn buffer(device: &RenderDevice, label: &'static str, size: u64, usage: BufferUsages) -> Buffer {
    device.create_buffer(&BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

/// A texture without mip levels.
fn texture(
    device: &RenderDevice,
    label: &'static str,
    size: UVec2,
    layers: u32,
    format: TextureFormat,
    usage: TextureUsages,
) -> Texture {
    let size = Extent3d { width: size.x, height: size.y, depth_or_array_layers: layers };
    mipmapped_texture(device, label, size, 1, format, usage)
}

/// A texture with mip levels.
fn mipmapped_texture(
    device: &RenderDevice,
    label: &'static str,
    size: Extent3d,
    mip_level_count: u32,
    format: TextureFormat,
    usage: TextureUsages,
) -> Texture {
    device.create_texture(&TextureDescriptor {
        label: Some(label),
        size,
        mip_level_count,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}

fn pixels(size: UVec2) -> u64 {
    size.x as u64 * size.y as u64
}
