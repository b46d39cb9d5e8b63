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
    view::{
        RestirView, ViewPool,
        history::{LIGHT_FORMAT, presample_workgroups},
    },
};
use pipelines::PassPipelines;

/// What a compute pass binds in group 2, in the order of its bindings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PassResource {
    /// Sum of radiance and number of samples of every pixel, read and written.
    Radiance,
    /// What the frame counted, read and written.
    Counters,
    /// Uniforms of direct lighting.
    DirectSettings,
    /// Presampled points of lights.
    Subsets,
    /// The same, to be read.
    SubsetsRead,
    /// Reservoirs of this frame, read and written.
    Reservoirs,
    /// Reservoirs of the last frame, to be read.
    PreviousReservoirs,
    /// The visibility buffer of the last frame.
    PreviousVisibility,
    /// Light that only the BSDF finds, to be written.
    Unresampled,
    /// The same, to be read.
    UnresampledRead,
    /// Light that was resampled, to be written.
    Resampled,
    /// The same, to be read.
    ResampledRead,
}

/// How many workgroups a pass has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dispatch {
    /// One invocation a pixel, 8 x 8 a workgroup.
    Pixels,
    /// One invocation an entry of the light subsets, 64 a workgroup.
    Subsets,
}

/// A compute pass: one file in `shaders/pass/` of the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ComputePass {
    /// Name of the file, of its entry point and of its time span.
    pub name: &'static str,
    pub resources: &'static [PassResource],
    pub(crate) dispatch: Dispatch,
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

use PassResource as R;

const fn per_pixel(name: &'static str, resources: &'static [R]) -> ComputePass {
    ComputePass { name, resources, dispatch: Dispatch::Pixels, specialised: true }
}

const REFERENCE: ComputePass = per_pixel("reference", &[R::Radiance]);
const DEBUG: ComputePass = per_pixel("debug", &[R::Radiance]);
const PRESAMPLE: ComputePass =
    ComputePass { dispatch: Dispatch::Subsets, ..per_pixel("presample", &[R::DirectSettings, R::Subsets]) };
const DIRECT_CANDIDATES: ComputePass =
    per_pixel("direct_candidates", &[R::DirectSettings, R::SubsetsRead, R::Reservoirs, R::Unresampled]);
const DIRECT_REUSE: ComputePass = per_pixel(
    "direct_reuse",
    &[R::DirectSettings, R::PreviousReservoirs, R::Reservoirs, R::PreviousVisibility, R::Resampled],
);
const RESOLVE: ComputePass = per_pixel("resolve", &[R::UnresampledRead, R::ResampledRead, R::Radiance]);
const STATISTICS: ComputePass = ComputePass { specialised: false, ..per_pixel("statistics", &[R::Counters]) };

/// Which frame a camera runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Frame {
    #[default]
    Reference,
    Direct,
    Debug,
}

impl Frame {
    /// The frame that some settings ask for.
    pub(crate) fn of(settings: &Restir) -> Self {
        match (settings.debug_view, settings.technique) {
            (DebugView::Off, Technique::Reference) => Self::Reference,
            (DebugView::Off, Technique::Di) => Self::Direct,
            _ => Self::Debug,
        }
    }

    /// Its passes, in order.
    pub(crate) fn passes(self) -> &'static [Pass] {
        match self {
            Self::Reference => {
                &[Pass::Visibility, Pass::Compute(&REFERENCE), Pass::Compute(&STATISTICS), Pass::Composite]
            }
            Self::Direct => &[
                Pass::Visibility,
                Pass::Compute(&PRESAMPLE),
                Pass::Compute(&DIRECT_CANDIDATES),
                Pass::Compute(&DIRECT_REUSE),
                Pass::Compute(&RESOLVE),
                Pass::Compute(&STATISTICS),
                Pass::Composite,
            ],
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
    let encoder = context.command_encoder();
    encoder.clear_buffer(&state.counters.buffer, 0, None);
    if let Some(history) = &state.direct {
        // What was drawn a frame ago is about to be overwritten.
        encoder.copy_texture_to_texture(
            state.visibility_texture.as_image_copy(),
            history.previous_visibility.as_image_copy(),
            state.visibility_texture.size(),
        );
    }
    for pass in key.frame.passes() {
        match pass {
            Pass::Visibility => visibility::draw(state, key, &scene, scene_group, &passes, &pipelines, &mut context),
            Pass::Compute(pass) => {
                let Some(pipeline) = passes.compute(pass, key, &pipelines) else {
                    continue;
                };
                let Some(group) = resources(pass, state, &device, &pipelines) else { continue };
                let [x, y] = workgroups(pass, state);
                if x == 0 {
                    continue;
                }
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
                encoder.dispatch_workgroups(x, y, 1);
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

fn workgroups(pass: &ComputePass, state: &RestirView) -> [u32; 2] {
    match pass.dispatch {
        Dispatch::Pixels => [state.size.x.div_ceil(8), state.size.y.div_ceil(8)],
        Dispatch::Subsets => [presample_workgroups(&state.settings.direct), 1],
    }
}

/// Layout of a compute pass's group 2.
pub(crate) fn resource_layout(pass: &ComputePass) -> BindGroupLayoutDescriptor {
    let storage = |read_only| BindingType::Buffer {
        ty: BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let texture = |sample_type| BindingType::Texture {
        sample_type,
        view_dimension: TextureViewDimension::D2,
        multisampled: false,
    };
    let entries: Vec<_> = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| BindGroupLayoutEntry {
            binding: binding as u32,
            visibility: ShaderStages::COMPUTE,
            ty: match resource {
                R::Radiance | R::Counters | R::Subsets | R::Reservoirs => storage(false),
                R::SubsetsRead | R::PreviousReservoirs => storage(true),
                R::DirectSettings => BindingType::Buffer {
                    ty: BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                R::PreviousVisibility => texture(TextureSampleType::Uint),
                R::UnresampledRead | R::ResampledRead => texture(TextureSampleType::Float { filterable: false }),
                R::Unresampled | R::Resampled => BindingType::StorageTexture {
                    access: StorageTextureAccess::WriteOnly,
                    format: LIGHT_FORMAT,
                    view_dimension: TextureViewDimension::D2,
                },
            },
            count: None,
        })
        .collect();
    BindGroupLayoutDescriptor::new(format!("restir {}", pass.name), &entries)
}

/// What a pass binds; `None` where something of it does not exist yet.
fn resources(
    pass: &ComputePass,
    state: &RestirView,
    device: &RenderDevice,
    pipelines: &PipelineCache,
) -> Option<BindGroup> {
    let direct = state.direct.as_ref();
    let entries = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| {
            let resource = match resource {
                R::Radiance => state.radiance.as_entire_binding(),
                R::Counters => state.counters.buffer.as_entire_binding(),
                R::DirectSettings => direct?.settings.as_entire_binding(),
                R::Subsets | R::SubsetsRead => direct?.subsets.as_entire_binding(),
                R::Reservoirs => direct?.reservoirs().as_entire_binding(),
                R::PreviousReservoirs => direct?.previous_reservoirs().as_entire_binding(),
                R::PreviousVisibility => BindingResource::TextureView(&direct?.previous_visibility_view),
                R::Unresampled | R::UnresampledRead => BindingResource::TextureView(&direct?.unresampled),
                R::Resampled | R::ResampledRead => BindingResource::TextureView(&direct?.resampled),
            };
            Some(BindGroupEntry { binding: binding as u32, resource })
        })
        .collect::<Option<Vec<_>>>()?;
    Some(device.create_bind_group(pass.name, &pipelines.get_bind_group_layout(&resource_layout(pass)), &entries))
}
