//! The visibility pass: rasterizes every instance that the camera sees, by vertex pulling (`shaders/pass/visibility.wgsl`).

use bevy::{
    asset::Handle,
    render::{diagnostic::RecordDiagnostics, render_resource::*},
    shader::{Shader, ShaderDefVal},
};

use super::{SPAN_PREFIX, pipelines::PassPipelines, recorder::Recorder};
use crate::{
    gpu_layout::NONE,
    scene::bindings::{SceneBindings, scene_layout},
    technique::frame::{PipelineKey, SHOWN_SURFACES},
    view::{DEPTH_FORMAT, RestirView, VISIBILITY_FORMAT, raster_view_layout},
};

pub(super) fn pipeline(
    shader: Handle<Shader>,
    defs: Vec<ShaderDefVal>,
    cull: Option<Face>,
    bindless_textures: Option<BindGroupLayoutDescriptor>,
) -> RenderPipelineDescriptor {
    let mut layout = vec![scene_layout(), raster_view_layout()];
    if let Some(bindless) = bindless_textures {
        // Shaders expect bindless textures in group 3.  Group 2 belongs to compute passes and is empty here.
        layout.extend([BindGroupLayoutDescriptor::new("restir nothing", &[]), bindless]);
    }
    RenderPipelineDescriptor {
        label: Some("restir visibility".into()),
        layout,
        vertex: VertexState {
            shader: shader.clone(),
            shader_defs: defs.clone(),
            entry_point: Some("vertex".into()),
            buffers: vec![],
        },
        primitive: PrimitiveState { cull_mode: cull, ..Default::default() },
        depth_stencil: Some(DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(CompareFunction::Greater),
            stencil: StencilState::default(),
            bias: DepthBiasState::default(),
        }),
        fragment: Some(FragmentState {
            shader,
            shader_defs: defs,
            entry_point: Some("fragment".into()),
            targets: vec![Some(VISIBILITY_FORMAT.into())],
        }),
        ..Default::default()
    }
}

/// Draws the surfaces of the traced pixels, and those of the shown ones if fewer are traced.
pub(super) fn draw(
    view: &RestirView,
    key: PipelineKey,
    scene: &SceneBindings,
    scene_group: &BindGroup,
    passes: &PassPipelines,
    pipelines: &PipelineCache,
    recorder: &mut Recorder,
) {
    let mut draw = |name, visibility, depth| {
        draw_into([visibility, depth], name, view, key, (scene, scene_group), (passes, pipelines), recorder);
    };
    draw("visibility", &view.visibility, &view.depth);
    if let Some(shown) = &view.shown {
        draw(SHOWN_SURFACES, &shown.visibility, &shown.depth);
    }
}

fn draw_into(
    [visibility, depth]: [&TextureView; 2],
    name: &str,
    view: &RestirView,
    key: PipelineKey,
    (scene, scene_group): (&SceneBindings, &BindGroup),
    (passes, pipelines): (&PassPipelines, &PipelineCache),
    recorder: &mut Recorder,
) {
    let diagnostics = recorder.diagnostics();
    let none = f64::from(NONE);
    let mut pass = recorder.encoder().begin_render_pass(&RenderPassDescriptor {
        label: Some("restir visibility"),
        color_attachments: &[Some(RenderPassColorAttachment {
            view: visibility,
            depth_slice: None,
            resolve_target: None,
            ops: Operations {
                load: LoadOp::Clear(wgpu_types::Color { r: none, g: none, b: 0.0, a: 0.0 }),
                store: StoreOp::Store,
            },
        })],
        depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(Operations { load: LoadOp::Clear(0.0), store: StoreOp::Store }),
            stencil_ops: None,
        }),
        ..Default::default()
    });
    let span = diagnostics.as_deref().map(|d| d.pass_span(&mut pass, format!("{SPAN_PREFIX}{name}")));
    pass.set_bind_group(0, &**scene_group, &[]);
    pass.set_bind_group(1, &*view.raster_bind_group, &[]);
    if let Some(bindless) = &scene.bound_textures {
        pass.set_bind_group(3, &**bindless, &[]);
    }
    let mut current_cull = None;
    for draw in &view.visible.draws {
        let cull = if view.inverts_culling { draw.cull.map(opposite) } else { draw.cull };
        if current_cull != Some(cull) {
            let Some(pipeline) = passes.visibility(cull, key, pipelines) else {
                continue;
            };
            pass.set_pipeline(pipeline);
            current_cull = Some(cull);
        }
        pass.draw(0..draw.triangles * 3, draw.instances.clone());
    }
    if let Some(span) = span {
        span.end(&mut pass);
    }
}

fn opposite(face: Face) -> Face {
    match face {
        Face::Front => Face::Back,
        Face::Back => Face::Front,
    }
}
