//! The composite pass (`shaders/pass/composite.wgsl`): writes radiance and depth to Bevy's view target.  If the camera has a prepass, it
//! also writes depth and motion vectors to the prepass textures, where Bevy's effects read them.

use bevy::{
    asset::Handle,
    core_pipeline::prepass::{MOTION_VECTOR_PREPASS_FORMAT, ViewPrepassTextures},
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::RenderDevice,
        view::{ViewDepthTexture, ViewTarget},
    },
    shader::Shader,
};

use super::{SPAN_PREFIX, pipelines::PassPipelines, recorder::Recorder};
use crate::{
    scene::{SceneFeatures, bindings::scene_layout},
    view::{DEPTH_FORMAT, RestirView, bind_groups::Bound, raster_view_layout, selection::CompositeKey},
};

fn layout() -> BindGroupLayoutDescriptor {
    BindGroupLayoutDescriptor::new(
        "restir composite",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::FRAGMENT,
            (
                storage_buffer_read_only_sized(false, None),
                texture_depth_2d(),
                texture_2d(TextureSampleType::Uint),
                texture_2d(TextureSampleType::Uint),
            ),
        ),
    )
}

pub(super) fn pipeline(shader: Handle<Shader>, key: CompositeKey) -> RenderPipelineDescriptor {
    let mut targets = vec![Some(key.format.into())];
    let mut entry_point = "fragment";
    let mut shader_defs = Vec::new();
    if key.motion {
        // Motion vectors follow meshes that bend.  The definition costs a test of a flag where there are none.
        shader_defs = SceneFeatures::DEFORMATION.shader_defs();
        targets.push(Some(MOTION_VECTOR_PREPASS_FORMAT.into()));
        entry_point = "fragment_with_motion";
    }
    RenderPipelineDescriptor {
        label: Some("restir composite".into()),
        layout: vec![scene_layout(), raster_view_layout(), layout()],
        vertex: VertexState { shader: shader.clone(), entry_point: Some("vertex".into()), ..Default::default() },
        depth_stencil: Some(DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            // Keeps nearer surfaces that Bevy's prepass or an earlier camera has drawn.
            depth_compare: Some(CompareFunction::GreaterEqual),
            stencil: StencilState::default(),
            bias: DepthBiasState::default(),
        }),
        fragment: Some(FragmentState { shader, shader_defs, entry_point: Some(entry_point.into()), targets }),
        ..Default::default()
    }
}

pub(super) fn draw(
    view: &RestirView,
    scene_group: &BindGroup,
    (target, depth, prepass): (&ViewTarget, &ViewDepthTexture, Option<&ViewPrepassTextures>),
    passes: &PassPipelines,
    pipelines: &PipelineCache,
    device: &RenderDevice,
    recorder: &mut Recorder,
) {
    let Some(key) = view.composite else { return };
    let Some(pipeline) = passes.composite(key, pipelines) else { return };
    let (depth_view, surfaces) =
        view.shown.as_ref().map_or((&view.depth, &view.visibility), |shown| (&shown.depth, &shown.visibility));
    let views = [depth_view, surfaces, &view.visibility].map(Bound::View);
    let bound = [Bound::Buffer(&view.radiance), views[0], views[1], views[2]];
    let group = view.bind_groups.get("composite", &bound, || {
        let [radiance, depth, shown, traced] = bound.map(Bound::resource);
        device.create_bind_group(
            "restir composite",
            &pipelines.get_bind_group_layout(&layout()),
            &BindGroupEntries::sequential((radiance, depth, shown, traced)),
        )
    });
    let mut attachments = vec![Some(target.get_color_attachment())];
    if key.motion {
        let Some(motion) = prepass.and_then(|textures| textures.motion_vectors.as_ref()) else { return };
        attachments.push(Some(motion.get_attachment()));
    }
    draw_fullscreen(view, pipeline, [scene_group, &group], &attachments, depth, recorder);
    // Bevy's prepass copied the depth texture before our depth was written.
    if let Some((textures, copy)) = prepass.and_then(|textures| Some((textures, textures.depth.as_ref()?))) {
        let (from, to) = (depth.texture.as_image_copy(), copy.texture.texture.as_image_copy());
        recorder.encoder().copy_texture_to_texture(from, to, textures.size);
    }
}

fn draw_fullscreen(
    view: &RestirView,
    pipeline: &RenderPipeline,
    [scene, own]: [&BindGroup; 2],
    attachments: &[Option<RenderPassColorAttachment>],
    depth: &ViewDepthTexture,
    recorder: &mut Recorder,
) {
    let diagnostics = recorder.diagnostics();
    let mut pass = recorder.encoder().begin_render_pass(&RenderPassDescriptor {
        label: Some("restir composite"),
        color_attachments: attachments,
        depth_stencil_attachment: Some(depth.get_attachment(StoreOp::Store)),
        ..Default::default()
    });
    let span = diagnostics.as_deref().map(|d| d.pass_span(&mut pass, format!("{SPAN_PREFIX}composite")));
    let (origin, size) = (view.origin.as_vec2(), view.target_size.as_vec2());
    pass.set_viewport(origin.x, origin.y, size.x, size.y, 0.0, 1.0);
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, &**scene, &[]);
    pass.set_bind_group(1, &*view.raster_bind_group, &[]);
    pass.set_bind_group(2, &**own, &[]);
    pass.draw(0..3, 0..1);
    if let Some(span) = span {
        span.end(&mut pass);
    }
}
