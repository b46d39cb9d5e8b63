//! The frame: what each technique runs, in order, as data; and the one system that runs it.

mod composite;
pub(crate) mod pipelines;
mod visibility;

use bevy::{
    app::SubApp,
    core_pipeline::{
        core_3d::main_opaque_pass_3d,
        schedule::{Core3d, Core3dSystems},
    },
    ecs::prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::*,
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::{ViewDepthTexture, ViewTarget},
    },
};

use crate::{
    scene::bindings::SceneBindings,
    settings::{DebugView, Restir, Technique},
    view::{RestirView, ViewPool},
};
use pipelines::PassPipelines;

/// What a compute pass binds in group 2, in the order of its bindings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PassResource {
    /// Sum of radiance and number of samples of every pixel, read and written.
    Radiance,
    /// What the frame counted, read and written.
    Counters,
}

/// A compute pass over the pixels of a view, 8 x 8 a workgroup: one file in `shaders/pass/` of the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ComputePass {
    /// Name of the file, of its entry point and of its time span.
    pub name: &'static str,
    pub resources: &'static [PassResource],
    /// Asks for the features of the scene; otherwise there is one pipeline for all scenes.
    pub specialised: bool,
}

/// A step of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pass {
    /// Rasterises (instance, triangle).
    Visibility,
    Compute(&'static ComputePass),
    /// Writes radiance and depth to Bevy's view target.
    Composite,
}

const REFERENCE: ComputePass =
    ComputePass { name: "reference", resources: &[PassResource::Radiance], specialised: true };
const DEBUG: ComputePass = ComputePass { name: "debug", resources: &[PassResource::Radiance], specialised: true };
const STATISTICS: ComputePass =
    ComputePass { name: "statistics", resources: &[PassResource::Counters], specialised: false };

/// Which frame a camera runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Frame {
    #[default]
    Reference,
    Debug,
}

impl Frame {
    /// The frame that some settings ask for.
    pub(crate) fn of(settings: &Restir) -> Self {
        match (settings.debug_view, settings.technique) {
            (DebugView::Off, Technique::Reference) => Self::Reference,
            _ => Self::Debug,
        }
    }

    /// Its passes, in order.
    pub(crate) fn passes(self) -> &'static [Pass] {
        match self {
            Self::Reference => {
                &[Pass::Visibility, Pass::Compute(&REFERENCE), Pass::Compute(&STATISTICS), Pass::Composite]
            }
            Self::Debug => &[Pass::Visibility, Pass::Compute(&DEBUG), Pass::Compute(&STATISTICS), Pass::Composite],
        }
    }
}

/// Names of the passes that some settings run, as time spans have them.
pub fn pass_names(settings: &Restir) -> Vec<&'static str> {
    let name = |pass: &Pass| match pass {
        Pass::Visibility => "visibility",
        Pass::Compute(pass) => pass.name,
        Pass::Composite => "composite",
    };
    Frame::of(settings).passes().iter().map(name).collect()
}

/// Prefix of the time spans.
pub const SPAN_PREFIX: &str = "restir/";

/// Adds the passes to the render world.
pub(crate) fn build(render_app: &mut SubApp) {
    render_app
        .init_resource::<PassPipelines>()
        .add_systems(Core3d, run_passes.before(main_opaque_pass_3d).in_set(Core3dSystems::MainPass));
}

fn run_passes(
    view: ViewQuery<(&ViewTarget, &ViewDepthTexture)>,
    views: Res<ViewPool>,
    scene: Res<SceneBindings>,
    passes: Res<PassPipelines>,
    pipelines: Res<PipelineCache>,
    device: Res<RenderDevice>,
    mut context: RenderContext,
) {
    let Some(state) = views.views.get(&view.entity()).filter(|v| v.rendered) else {
        return;
    };
    let (target, depth) = view.into_inner();
    let (Some(key), Some(scene_group)) = (state.key, scene.bind_group.as_ref()) else {
        return;
    };
    context.command_encoder().clear_buffer(&state.counters.buffer, 0, None);
    for pass in key.frame.passes() {
        match pass {
            Pass::Visibility => visibility::draw(state, key, &scene, scene_group, &passes, &pipelines, &mut context),
            Pass::Compute(pass) => {
                let Some(pipeline) = passes.compute(pass, key, &pipelines) else {
                    continue;
                };
                let group = resources(pass, state, &device, &pipelines);
                let diagnostics = context.diagnostic_recorder();
                let mut encoder = context
                    .command_encoder()
                    .begin_compute_pass(&ComputePassDescriptor { label: Some(pass.name), ..Default::default() });
                let span =
                    diagnostics.as_deref().map(|d| d.time_span(&mut encoder, format!("{SPAN_PREFIX}{}", pass.name)));
                encoder.set_pipeline(pipeline);
                encoder.set_bind_group(0, scene_group, &[]);
                encoder.set_bind_group(1, &state.bind_group, &[]);
                encoder.set_bind_group(2, &group, &[]);
                encoder.dispatch_workgroups(state.size.x.div_ceil(8), state.size.y.div_ceil(8), 1);
                if let Some(span) = span {
                    span.end(&mut encoder);
                }
            }
            Pass::Composite => {
                composite::draw(state, scene_group, target, depth, &passes, &pipelines, &device, &mut context)
            }
        }
    }
    state.counters.copy(&mut context);
}

/// Layout of a compute pass's group 2.
pub(crate) fn resource_layout(pass: &ComputePass) -> BindGroupLayoutDescriptor {
    let entries: Vec<_> = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| BindGroupLayoutEntry {
            binding: binding as u32,
            visibility: ShaderStages::COMPUTE,
            ty: match resource {
                PassResource::Radiance | PassResource::Counters => BindingType::Buffer {
                    ty: BufferBindingType::Storage { read_only: false },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
            },
            count: None,
        })
        .collect();
    BindGroupLayoutDescriptor::new(format!("restir {}", pass.name), &entries)
}

fn resources(pass: &ComputePass, state: &RestirView, device: &RenderDevice, pipelines: &PipelineCache) -> BindGroup {
    let entries: Vec<_> = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| BindGroupEntry {
            binding: binding as u32,
            resource: match resource {
                PassResource::Radiance => state.radiance.as_entire_binding(),
                PassResource::Counters => state.counters.buffer.as_entire_binding(),
            },
        })
        .collect();
    device.create_bind_group(pass.name, &pipelines.get_bind_group_layout(&resource_layout(pass)), &entries)
}
