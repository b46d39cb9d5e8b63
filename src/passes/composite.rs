//! Radiance and depth into Bevy's view target (`shaders/pass/composite.wgsl`).

use bevy::{
    asset::Handle,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice},
        view::{ViewDepthTexture, ViewTarget},
    },
    shader::Shader,
};

use super::{SPAN_PREFIX, pipelines::PassPipelines};
use crate::{
    scene::bindings::scene_layout,
    view::{DEPTH_FORMAT, RestirView, raster_view_layout},
};

fn layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir composite",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::FRAGMENT,
            (storage_buffer_read_only_sized(false, None), texture_depth_2d()),
        ),
    )
}

pub(super) fn pipeline(shader: Handle<Shader>, format: TextureFormat) -> RenderPipelineDescriptor {
    RenderPipelineDescriptor {
        label: Some("restir composite".into()),
        layout: vec![scene_layout(), raster_view_layout(), layout()],
        vertex: VertexState { shader: shader.clone(), entry_point: Some("vertex".into()), ..Default::default() },
        depth_stencil: Some(DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(CompareFunction::Always),
            stencil: StencilState::default(),
            bias: DepthBiasState::default(),
        }),
        fragment: Some(FragmentState {
            shader,
            entry_point: Some("fragment".into()),
            targets: vec![Some(format.into())],
            ..Default::default()
        }),
        ..Default::default()
    }
}

pub(super) fn draw(
    view: &RestirView,
    scene_group: &BindGroup,
    target: &ViewTarget,
    depth: &ViewDepthTexture,
    passes: &PassPipelines,
    pipelines: &PipelineCache,
    device: &RenderDevice,
    context: &mut RenderContext,
) {
    let Some(pipeline) = passes.composite(target.main_texture_format(), pipelines) else {
        return;
    };
    let group = device.create_bind_group(
        "restir composite",
        &pipelines.get_bind_group_layout(&layout()),
        &BindGroupEntries::sequential((view.radiance.as_entire_binding(), &view.depth)),
    );
    let diagnostics = context.diagnostic_recorder();
    let mut pass = context.command_encoder().begin_render_pass(&RenderPassDescriptor {
        label: Some("restir composite"),
        color_attachments: &[Some(target.get_color_attachment())],
        depth_stencil_attachment: Some(depth.get_attachment(StoreOp::Store)),
        ..Default::default()
    });
    let span = diagnostics.as_deref().map(|d| d.time_span(&mut pass, format!("{SPAN_PREFIX}composite")));
    let (origin, size) = (view.origin.as_vec2(), view.size.as_vec2());
    pass.set_viewport(origin.x, origin.y, size.x, size.y, 0.0, 1.0);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &**scene_group, &[]);
    pass.set_bind_group(1, &*view.raster_bind_group, &[]);
    pass.set_bind_group(2, &*group, &[]);
    pass.draw(0..3, 0..1);
    if let Some(span) = span {
        span.end(&mut pass);
    }
}
