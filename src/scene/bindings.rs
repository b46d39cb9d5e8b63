//! Bind groups of the scene for all passes (`shaders/scene/bindings.wgsl`), and the facts about the scene that views, frames and the report
//! read.

use bevy::{
    ecs::resource::Resource,
    log::warn_once,
    render::{
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
    },
};

use crate::gpu_layout::GpuSceneUniforms;
use crate::scene::{
    accel::ray_query::{self, AccelerationStructures},
    features::{RecentBits, SceneFeatures},
    geometry::draw_list::DrawList,
    material::directional_albedo,
    storage::allocation,
    texture::bindless::BindlessTextures,
};

/// The layout of group 0.
pub(crate) fn scene_layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir scene",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE | ShaderStages::VERTEX_FRAGMENT,
            (
                uniform_buffer_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_read_only_sized(false, None),
                texture_2d_array(TextureSampleType::Float { filterable: false }),
                texture_2d(TextureSampleType::Float { filterable: false }),
                texture_2d(TextureSampleType::Uint),
                texture_2d(TextureSampleType::Float { filterable: false }),
                texture_2d(TextureSampleType::Float { filterable: false }),
                texture_2d(TextureSampleType::Float { filterable: false }),
            ),
        ),
    )
}

/// The bind groups of the scene, and a summary of its contents.
#[derive(Resource, Default)]
pub(crate) struct SceneBindings {
    /// Group 0; `None` until the first buffers exist.
    pub bind_group: Option<BindGroup>,
    /// Group 3 with ray queries: the acceleration structures.
    pub structures: Option<BindGroup>,
    structures_revision: u64,
    /// The last group, on devices with arrays of textures: the bindless textures.
    pub bound_textures: Option<BindGroup>,
    bound_textures_revision: u64,
    pub uniforms: Option<Buffer>,
    uploaded_uniforms: GpuSceneUniforms,
    /// Buffers and views of `bind_group`.
    bound_buffers: Vec<BufferId>,
    bound_views: [Option<TextureViewId>; 6],
    pub placeholders: Option<PlaceholderTextures>,
    /// The table for energy compensation; `None` until a camera uses it.
    pub specular_albedo: Option<TextureView>,
    pub features: SceneFeatures,
    pub(super) recent_features: RecentBits<SceneFeatures>,
    pub(super) recent_hidden_from: RecentBits<u32>,
    /// Counts the frames in which instances moved, appeared, disappeared or were edited, and those in which lights changed.  Temporal reuse
    /// tolerates all this, because the scene of the last frame is kept.
    pub motion_revision: u64,
    /// Lights are chosen with the probabilities of the last frame: neither their table nor the radius that weighs the environment changed.
    pub keeps_light_probabilities: bool,
    /// Counts all other visible changes, which reset histories.
    pub edit_revision: u64,
    /// Whether all assets of the scene are loaded, built and copied.
    pub ready: bool,
    /// The device has no memory for the scene as it is in this frame, so that no camera renders it.
    pub lacks_memory: bool,
    /// Scene bytes sent in this frame.
    pub uploaded_bytes: u64,
    /// Names and sizes in bytes, for the report.
    pub memory: Vec<(&'static str, u64)>,
    /// Numbers of elements that the pools looked at in this frame, for the report.
    pub visited: Vec<(&'static str, u64)>,
    pub triangles: u64,
    pub instances: u64,
    pub lights: u64,
    /// Draw calls of the visibility pass, and the revisions of instances and materials that they are made for.
    pub draw_list: DrawList,
    pub draws_key: [u64; 2],
    /// Bits of the cameras that do not see some instance or light which another camera sees, or did not see one a short time ago.
    pub hidden_from: u32,
    /// Whether there is an object that only cameras see (`NotShadowCaster`), or that only other rays hit (`RestirMaterial`).
    pub has_camera_dependent_objects: bool,
}

/// Textures of one texel, bound in place of missing ones.
#[derive(Clone)]
pub(crate) struct PlaceholderTextures {
    /// Array of float textures.
    pub page: TextureView,
    /// Float texture.
    pub texel: TextureView,
    /// Integer texture.
    pub integers: TextureView,
}

impl PlaceholderTextures {
    pub(crate) fn new(device: &RenderDevice) -> Self {
        let view = |dimension, format| {
            let texture = device.create_texture(&TextureDescriptor {
                label: Some("restir placeholder texture"),
                size: Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&TextureViewDescriptor { dimension: Some(dimension), ..Default::default() })
        };
        Self {
            page: view(TextureViewDimension::D2Array, TextureFormat::Rgba8Unorm),
            texel: view(TextureViewDimension::D2, TextureFormat::Rgba8Unorm),
            integers: view(TextureViewDimension::D2, TextureFormat::Rgba32Uint),
        }
    }
}

impl SceneBindings {
    /// Uploads the uniforms if they changed.  Returns the number of bytes sent.
    pub(crate) fn write_uniforms(
        &mut self,
        uniforms: &GpuSceneUniforms,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        if self.uniforms.is_some() && self.uploaded_uniforms == *uniforms {
            return 0;
        }
        let buffer = self.uniforms.get_or_insert_with(|| {
            device.create_buffer(&BufferDescriptor {
                label: Some("scene uniforms"),
                size: size_of::<GpuSceneUniforms>() as u64,
                usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        });
        queue.write_buffer(buffer, 0, bytemuck::bytes_of(uniforms));
        self.uploaded_uniforms = *uniforms;
        size_of::<GpuSceneUniforms>() as u64
    }

    /// Creates the table for energy compensation if it is missing.  Returns false if the device has no memory for it.
    pub(crate) fn prepare_specular_albedo(&mut self, device: &RenderDevice, queue: &RenderQueue) -> bool {
        if self.specular_albedo.is_none() {
            let create = || directional_albedo::texture(device, queue);
            match allocation::attempt(device, "specular albedo", create) {
                Ok(table) => self.specular_albedo = Some(table),
                Err(error) => warn_once!(
                    "restir: no memory for the table of energy compensation; Bevy lights all cameras until there is some: {error}"
                ),
            }
        }
        self.specular_albedo.is_some()
    }

    /// Creates the bind group again if a buffer or a texture was replaced.
    pub(crate) fn bind(
        &mut self,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        buffers: [&Buffer; 7],
        textures: [&TextureView; 6],
    ) {
        let ids: Vec<_> = buffers.iter().map(|b| b.id()).collect();
        let views = textures.map(|texture| Some(texture.id()));
        if self.bind_group.is_some() && ids == self.bound_buffers && views == self.bound_views {
            return;
        }
        let [a, b, c, d, e, f, g] = buffers.map(|b| b.as_entire_binding());
        let [atlas, albedo, table, second_uvs, subsurface, colors] = textures;
        self.bind_group = Some(device.create_bind_group(
            "restir scene",
            &pipelines.get_bind_group_layout(&scene_layout()),
            &BindGroupEntries::sequential((a, b, c, d, e, f, g, atlas, albedo, table, second_uvs, subsurface, colors)),
        ));
        self.bound_buffers = ids;
        self.bound_views = views;
    }

    /// Creates the group of acceleration structures again if a top level was replaced.
    pub(crate) fn bind_structures(
        &mut self,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        structures: &AccelerationStructures,
    ) {
        let Some([current, previous]) = structures.top_levels() else {
            // The group would keep structures alive that were dropped.
            self.structures = None;
            return;
        };
        if self.structures.is_some() && self.structures_revision == structures.revision {
            return;
        }
        self.structures = Some(device.create_bind_group(
            "restir acceleration structures",
            &pipelines.get_bind_group_layout(&ray_query::layout()),
            &BindGroupEntries::sequential((current.as_binding(), previous.as_binding())),
        ));
        self.structures_revision = structures.revision;
    }

    /// Creates the group of bindless textures again if their array changed.
    pub(crate) fn bind_textures(
        &mut self,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        textures: &BindlessTextures,
        none: &TextureView,
    ) {
        // Expected textures need the group before the first image, while both revisions are 0.
        if self.bound_textures.is_some() && self.bound_textures_revision == textures.revision {
            return;
        }
        self.bound_textures = Some(textures.bind_group(none, device, pipelines));
        self.bound_textures_revision = textures.revision;
    }
}
