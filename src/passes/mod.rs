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
        history::{LIGHT_FORMAT, MOST_ROUNDS, presample_workgroups, rounds},
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
    /// Uniforms of a round of direct lighting.
    DirectSettings,
    /// Presampled points of lights.
    Subsets,
    /// The same, to be read.
    SubsetsRead,
    /// Reservoirs of this frame's candidates, written.
    CandidateReservoirs,
    /// Reservoirs that a round of reuse takes neighbours from, to be read.
    NeighbourReservoirs,
    /// Reservoirs that a round of reuse leaves, read and written.
    RoundReservoirs,
    /// Reservoirs that the frame keeps, to be read.
    KeptReservoirs,
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
    /// One invocation an entry of the light subsets, 64 a workgroup along x, a subset along y.
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

/// What a step of the frame does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pass {
    /// Rasterises (instance, triangle).
    Visibility,
    Compute(&'static ComputePass),
    /// Writes radiance and depth to Bevy's view target.
    Composite,
}

/// A step of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Step {
    pub pass: Pass,
    /// Name of its time span.
    pub name: &'static str,
    /// Of reuse, from 0; 0 where there are no rounds.
    pub round: usize,
}

use PassResource as R;

const fn per_pixel(name: &'static str, resources: &'static [R]) -> ComputePass {
    ComputePass { name, resources, dispatch: Dispatch::Pixels, specialised: true }
}

const REFERENCE: ComputePass = per_pixel("reference", &[R::Radiance]);
const PATH_CANDIDATES: ComputePass = per_pixel("path_candidates", &[R::Radiance]);
const DEBUG: ComputePass = per_pixel("debug", &[R::Radiance]);
const PRESAMPLE: ComputePass =
    ComputePass { dispatch: Dispatch::Subsets, ..per_pixel("presample", &[R::DirectSettings, R::Subsets]) };
const DIRECT_CANDIDATES: ComputePass =
    per_pixel("direct_candidates", &[R::DirectSettings, R::SubsetsRead, R::CandidateReservoirs, R::Unresampled]);
const DIRECT_REUSE: ComputePass = per_pixel(
    "direct_reuse",
    &[R::DirectSettings, R::NeighbourReservoirs, R::RoundReservoirs, R::PreviousVisibility, R::Resampled],
);
/// Time spans of the rounds of reuse.
const REUSE_NAMES: [&str; MOST_ROUNDS] =
    ["direct_reuse", "direct_reuse_2", "direct_reuse_3", "direct_reuse_4", "direct_reuse_5"];
const DEBUG_RESERVOIRS: ComputePass = ComputePass {
    specialised: false,
    ..per_pixel("debug_reservoirs", &[R::DirectSettings, R::KeptReservoirs, R::Radiance])
};
const RESOLVE: ComputePass = per_pixel("resolve", &[R::UnresampledRead, R::ResampledRead, R::Radiance]);
const STATISTICS: ComputePass = ComputePass { specialised: false, ..per_pixel("statistics", &[R::Counters]) };

/// Which frame a camera runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Frame {
    #[default]
    Reference,
    Direct,
    DirectDebug,
    Paths,
    Debug,
}

impl Frame {
    /// The frame that some settings ask for.
    pub(crate) fn of(settings: &Restir) -> Self {
        match (settings.debug_view, settings.technique) {
            (DebugView::Off, Technique::Reference) => Self::Reference,
            (DebugView::Off, Technique::Di) => Self::Direct,
            (DebugView::Off, Technique::Pt) => Self::Paths,
            (view, Technique::Di) if view.is_of_reservoirs() => Self::DirectDebug,
            _ => Self::Debug,
        }
    }

    /// It resamples direct light, and keeps a history of it.
    pub(crate) fn is_direct(self) -> bool {
        matches!(self, Self::Direct | Self::DirectDebug)
    }

    /// Its compute passes, in order; reuse stands for all of its rounds.
    fn compute(self) -> &'static [&'static ComputePass] {
        match self {
            Self::Reference => &[&REFERENCE, &STATISTICS],
            Self::Direct => &[&PRESAMPLE, &DIRECT_CANDIDATES, &DIRECT_REUSE, &RESOLVE, &STATISTICS],
            Self::DirectDebug => &[&PRESAMPLE, &DIRECT_CANDIDATES, &DIRECT_REUSE, &DEBUG_RESERVOIRS, &STATISTICS],
            Self::Paths => &[&PATH_CANDIDATES, &STATISTICS],
            Self::Debug => &[&DEBUG, &STATISTICS],
        }
    }

    /// Its steps, in order, with so many rounds of reuse.
    pub(crate) fn steps(self, rounds: usize) -> impl Iterator<Item = Step> {
        let compute = self.compute().iter().flat_map(move |&pass| {
            let is_reuse = pass.name == DIRECT_REUSE.name;
            (0..if is_reuse { rounds } else { 1 }).map(move |round| Step {
                pass: Pass::Compute(pass),
                name: if is_reuse { REUSE_NAMES[round] } else { pass.name },
                round,
            })
        });
        let once = |pass, name| core::iter::once(Step { pass, name, round: 0 });
        once(Pass::Visibility, "visibility").chain(compute).chain(once(Pass::Composite, "composite"))
    }

    /// Its passes.
    pub(crate) fn passes(self) -> impl Iterator<Item = Pass> {
        self.steps(1).map(|step| step.pass)
    }
}

/// Names of the passes that some settings run, as time spans have them.
pub fn pass_names(settings: &Restir) -> Vec<&'static str> {
    Frame::of(settings).steps(rounds(&settings.direct).len()).map(|step| step.name).collect()
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
    let rounds = state.direct.as_ref().map_or(1, |history| history.rounds());
    for step in key.frame.steps(rounds) {
        match step.pass {
            Pass::Visibility => visibility::draw(state, key, &scene, scene_group, &passes, &pipelines, &mut context),
            Pass::Compute(pass) => {
                let Some(pipeline) = passes.compute(pass, key, &pipelines) else {
                    continue;
                };
                let Some(group) = resources(pass, step.round, state, &device, &pipelines) else { continue };
                let [x, y] = workgroups(pass, state);
                if x == 0 || y == 0 {
                    continue;
                }
                let diagnostics = context.diagnostic_recorder();
                let mut encoder = context
                    .command_encoder()
                    .begin_compute_pass(&ComputePassDescriptor { label: Some(step.name), ..Default::default() });
                let span =
                    diagnostics.as_deref().map(|d| d.time_span(&mut encoder, format!("{SPAN_PREFIX}{}", step.name)));
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
        Dispatch::Subsets => presample_workgroups(&state.settings.direct),
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
                R::Radiance | R::Counters | R::Subsets | R::CandidateReservoirs | R::RoundReservoirs => storage(false),
                R::SubsetsRead | R::NeighbourReservoirs | R::KeptReservoirs => storage(true),
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
    round: usize,
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
                R::DirectSettings => direct?.settings_of(round),
                R::Subsets | R::SubsetsRead => direct?.subsets.as_entire_binding(),
                R::CandidateReservoirs => direct?.candidates().as_entire_binding(),
                R::NeighbourReservoirs => direct?.neighbours_of(round).as_entire_binding(),
                R::RoundReservoirs => direct?.output_of(round).as_entire_binding(),
                R::KeptReservoirs => direct?.kept().as_entire_binding(),
                R::PreviousVisibility => BindingResource::TextureView(&direct?.previous_visibility_view),
                R::Unresampled | R::UnresampledRead => BindingResource::TextureView(&direct?.unresampled),
                R::Resampled | R::ResampledRead => BindingResource::TextureView(&direct?.resampled),
            };
            Some(BindGroupEntry { binding: binding as u32, resource })
        })
        .collect::<Option<Vec<_>>>()?;
    Some(device.create_bind_group(pass.name, &pipelines.get_bind_group_layout(&resource_layout(pass)), &entries))
}
