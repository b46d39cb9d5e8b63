//! Group 0 of every pass: the scene (`shaders/scene/bindings.wgsl`), and what was uploaded to it.

use bevy::{
    ecs::resource::Resource,
    render::{
        render_resource::{binding_types::*, *},
        renderer::{RenderDevice, RenderQueue},
    },
};

use crate::gpu_layout::GpuSceneUniforms;
use crate::scene::{
    accel::ray_query::{self, AccelerationStructures},
    features::SceneFeatures,
    geometry::draw_list::Draw,
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
            ),
        ),
    )
}

/// The scene as passes take it.
#[derive(Resource, Default)]
pub(crate) struct SceneBindings {
    pub bind_group: Option<BindGroup>,
    /// Group 3, where rays are traced by ray queries.
    pub structures: Option<BindGroup>,
    structures_revision: u64,
    /// The group behind those, where images are bound as they are.
    pub bound_textures: Option<BindGroup>,
    bound_textures_revision: u64,
    pub uniforms: Option<Buffer>,
    written: GpuSceneUniforms,
    /// Buffers and views that the bind group was made of.
    made_of: Vec<BufferId>,
    made_with: [Option<TextureViewId>; 4],
    pub no_texture: Option<NoTexture>,
    /// What energy compensation reads, once a camera asks for it.
    pub albedo: Option<TextureView>,
    pub features: SceneFeatures,
    /// Counts moves of instances and changes of lights: temporal reuse knows both frames of them.
    pub motion_revision: u64,
    /// Counts every other change of anything that can be seen.
    pub edit_revision: u64,
    /// Nothing is still being loaded, built or copied.
    pub ready: bool,
    /// Scene bytes sent in this frame.
    pub uploaded_bytes: u64,
    pub memory: Vec<(&'static str, u64)>,
    pub triangles: u64,
    pub instances: u64,
    pub lights: u64,
    /// What to draw, and the `edit_revision` and number of instances that it was made for.
    pub draws: Vec<Draw>,
    pub drawn: (u64, usize),
    /// Bits of the cameras from which a thing or a light is hidden that others have.
    pub hidden_from: u32,
}

/// Bound where a scene has no texture: an array of one page, one texel, and one of integers.
#[derive(Clone)]
pub(crate) struct NoTexture {
    pub page: TextureView,
    pub texel: TextureView,
    pub integers: TextureView,
}

impl NoTexture {
    pub(crate) fn new(device: &RenderDevice) -> Self {
        let view = |dimension, format| {
            let texture = device.create_texture(&TextureDescriptor {
                label: Some("restir no texture"),
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
    /// Sends the uniforms where they changed.  Returns the bytes sent.
    pub(crate) fn write_uniforms(
        &mut self,
        uniforms: &GpuSceneUniforms,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        if self.uniforms.is_some() && self.written == *uniforms {
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
        self.written = *uniforms;
        size_of::<GpuSceneUniforms>() as u64
    }

    /// Makes the bind group again where a buffer or the atlas is another one.
    pub(crate) fn bind(
        &mut self,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        buffers: [&Buffer; 7],
        textures: [&TextureView; 4],
    ) {
        let ids: Vec<_> = buffers.iter().map(|b| b.id()).collect();
        let made_with = textures.map(|texture| Some(texture.id()));
        if self.bind_group.is_some() && ids == self.made_of && made_with == self.made_with {
            return;
        }
        let [a, b, c, d, e, f, g] = buffers.map(|b| b.as_entire_binding());
        let [atlas, albedo, table, second_uvs] = textures;
        self.bind_group = Some(device.create_bind_group(
            "restir scene",
            &pipelines.get_bind_group_layout(&scene_layout()),
            &BindGroupEntries::sequential((a, b, c, d, e, f, g, atlas, albedo, table, second_uvs)),
        ));
        self.made_of = ids;
        self.made_with = made_with;
    }

    /// Makes group 3 again where a top level is another one.
    pub(crate) fn bind_structures(
        &mut self,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        structures: &AccelerationStructures,
    ) {
        let Some([current, previous]) = structures.top_levels() else { return };
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

    /// Makes the group of images that are bound as they are, once there is one, and again where they are others.
    pub(crate) fn bind_textures(
        &mut self,
        device: &RenderDevice,
        pipelines: &PipelineCache,
        textures: &BindlessTextures,
        none: &TextureView,
    ) {
        if self.bound_textures_revision == textures.revision {
            return;
        }
        self.bound_textures = Some(textures.bind_group(none, device, pipelines));
        self.bound_textures_revision = textures.revision;
    }
}
