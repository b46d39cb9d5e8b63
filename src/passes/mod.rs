//! The frame: what each technique runs, in order, as data; and the one system that runs it.

pub(crate) mod composite;
pub(crate) mod pipelines;
mod visibility;

use bevy::{
    app::SubApp,
    core_pipeline::{
        core_3d::main_opaque_pass_3d,
        prepass::ViewPrepassTextures,
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
    scene::{SceneFeatures, bindings::SceneBindings},
    settings::{DebugView, Restir, Technique},
    view::{
        RestirView, ViewPool,
        history::{LIGHT_FORMAT, Reservoirs, presample_workgroups},
        plan::{Domain, MOST_ROUNDS, Plan},
    },
};
use pipelines::PassPipelines;

/// What a compute pass binds in group 2, in the order of its bindings; of its domain where there are several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PassResource {
    /// Sum of radiance and number of samples of every pixel, read and written.
    Radiance,
    /// What the frame counted, read and written.
    Counters,
    /// Uniforms of a round of reuse.
    Settings,
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
    /// Light of this frame's candidates, to be written.
    CandidateLight,
    /// What the samples carry that a round of reuse finds, to be read.
    LightBefore,
    /// Light that a round of reuse leaves, to be written.
    LightAfter,
    /// Direct light that only the BSDF finds, to be read.
    UnresampledLight,
    /// Direct light that was resampled, to be read.
    ResampledLight,
    /// Light of resampled paths, to be read.
    PathLight,
}

/// How many workgroups a pass has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dispatch {
    /// One invocation a pixel, 8 x 8 a workgroup.
    Pixels,
    /// One invocation an entry of the light subsets, 64 a workgroup along x, a subset along y.
    Subsets,
}

/// A compute pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ComputePass {
    /// Name of its pipelines and of its time span.
    pub name: &'static str,
    /// Name of its file in `shaders/pass/` and of its entry point.
    pub file: &'static str,
    /// Shader definition of its domain.
    pub def: Option<&'static str>,
    pub domain: Domain,
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
    let domain = Domain::Direct;
    ComputePass { name, file: name, def: None, domain, resources, dispatch: Dispatch::Pixels, specialised: true }
}

/// Choose the domain of a shader; without them it is direct lighting in `pass/reuse.wgsl`, whole paths in `pass/path_candidates.wgsl`.
const RESAMPLES_PATHS: Option<&str> = Some("RESAMPLES_PATHS");
const RESAMPLES_INDIRECT: Option<&str> = Some("RESAMPLES_INDIRECT");

const REFERENCE: ComputePass = per_pixel("reference", &[R::Radiance]);
/// The same, what its paths cost in place of light.
const REFERENCE_RAYS: ComputePass = ComputePass { name: "reference_rays", def: Some("SHOWS_RAYS"), ..REFERENCE };
const REFERENCE_BOUNCES: ComputePass =
    ComputePass { name: "reference_bounces", def: Some("SHOWS_BOUNCES"), ..REFERENCE };
const DEBUG: ComputePass = per_pixel("debug", &[R::Radiance]);
const PRESAMPLE: ComputePass =
    ComputePass { dispatch: Dispatch::Subsets, ..per_pixel("presample", &[R::Settings, R::Subsets]) };
const PATH_PRESAMPLE: ComputePass = ComputePass { domain: Domain::Paths, ..PRESAMPLE };
const INDIRECT_PRESAMPLE: ComputePass = ComputePass { domain: Domain::Indirect, ..PRESAMPLE };
const DIRECT_CANDIDATES: ComputePass =
    per_pixel("direct_candidates", &[R::Settings, R::SubsetsRead, R::CandidateReservoirs, R::CandidateLight]);
const PATH_CANDIDATES: ComputePass = ComputePass {
    domain: Domain::Paths,
    ..per_pixel("path_candidates", &[R::Settings, R::SubsetsRead, R::CandidateReservoirs, R::CandidateLight])
};
const DIRECT_REUSE: ComputePass = ComputePass {
    name: "direct_reuse",
    ..per_pixel(
        "reuse",
        &[
            R::Settings,
            R::NeighbourReservoirs,
            R::RoundReservoirs,
            R::PreviousVisibility,
            R::LightBefore,
            R::LightAfter,
        ],
    )
};
const PATH_REUSE: ComputePass =
    ComputePass { name: "path_reuse", def: RESAMPLES_PATHS, domain: Domain::Paths, ..DIRECT_REUSE };
const INDIRECT_CANDIDATES: ComputePass =
    ComputePass { name: "indirect_candidates", def: RESAMPLES_INDIRECT, domain: Domain::Indirect, ..PATH_CANDIDATES };
const INDIRECT_REUSE: ComputePass =
    ComputePass { name: "indirect_reuse", def: RESAMPLES_INDIRECT, domain: Domain::Indirect, ..DIRECT_REUSE };
/// Time spans of the rounds of reuse.
const DIRECT_ROUNDS: [&str; MOST_ROUNDS] =
    ["direct_reuse", "direct_reuse_2", "direct_reuse_3", "direct_reuse_4", "direct_reuse_5"];
const PATH_ROUNDS: [&str; MOST_ROUNDS] = ["path_reuse", "path_reuse_2", "path_reuse_3", "path_reuse_4", "path_reuse_5"];
const INDIRECT_ROUNDS: [&str; MOST_ROUNDS] =
    ["indirect_reuse", "indirect_reuse_2", "indirect_reuse_3", "indirect_reuse_4", "indirect_reuse_5"];
const DEBUG_RESERVOIRS: ComputePass =
    ComputePass { specialised: false, ..per_pixel("debug_reservoirs", &[R::Settings, R::KeptReservoirs, R::Radiance]) };
const DEBUG_PATHS: ComputePass =
    ComputePass { domain: Domain::Paths, ..per_pixel("debug_paths", &[R::Settings, R::KeptReservoirs, R::Radiance]) };
const DEBUG_INDIRECT: ComputePass =
    ComputePass { name: "debug_indirect", def: RESAMPLES_INDIRECT, domain: Domain::Indirect, ..DEBUG_PATHS };
const DEBUG_RAYS: ComputePass = ComputePass { specialised: false, ..per_pixel("debug_rays", &[R::Radiance]) };
const RESOLVE: ComputePass = per_pixel("resolve", &[R::UnresampledLight, R::ResampledLight, R::PathLight, R::Radiance]);
const STATISTICS: ComputePass = ComputePass { specialised: false, ..per_pixel("statistics", &[R::Counters]) };

/// Which frame a camera runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) enum Frame {
    #[default]
    Reference,
    ReferenceRays,
    ReferenceBounces,
    Direct,
    DirectDebug,
    DirectRays,
    Indirect,
    IndirectDebug,
    IndirectRays,
    Paths,
    PathsDebug,
    PathsRays,
    Debug,
}

impl Frame {
    /// The frame that some settings ask for.
    pub(crate) fn of(settings: &Restir) -> Self {
        match (settings.debug_view, settings.technique) {
            (DebugView::Off, Technique::Reference) => Self::Reference,
            (DebugView::Off, Technique::Di) => Self::Direct,
            (DebugView::Off, Technique::Gi) => Self::Indirect,
            (DebugView::Off, Technique::Pt) => Self::Paths,
            (DebugView::Rays, Technique::Reference) => Self::ReferenceRays,
            (DebugView::Rays, Technique::Di) => Self::DirectRays,
            (DebugView::Rays, Technique::Gi) => Self::IndirectRays,
            (DebugView::Rays, Technique::Pt) => Self::PathsRays,
            (DebugView::Bounces, _) => Self::ReferenceBounces,
            (view, Technique::Di | Technique::Gi) if view.is_of_reservoirs() => Self::DirectDebug,
            (view, Technique::Gi) if view.is_of_paths() => Self::IndirectDebug,
            (view, Technique::Pt) if view.is_of_paths() => Self::PathsDebug,
            _ => Self::Debug,
        }
    }

    /// What it resamples, and keeps a history of.
    pub(crate) fn domains(self) -> &'static [Domain] {
        match self {
            Self::Direct | Self::DirectDebug | Self::DirectRays => &[Domain::Direct],
            Self::Indirect | Self::IndirectRays => &[Domain::Direct, Domain::Indirect],
            Self::IndirectDebug => &[Domain::Indirect],
            Self::Paths | Self::PathsDebug | Self::PathsRays => &[Domain::Paths],
            Self::Reference | Self::ReferenceRays | Self::ReferenceBounces | Self::Debug => &[],
        }
    }

    /// Its compute passes, in order; reuse stands for all of its rounds.
    fn compute(self) -> &'static [&'static ComputePass] {
        match self {
            Self::Reference => &[&REFERENCE, &STATISTICS],
            Self::ReferenceRays => &[&REFERENCE_RAYS, &STATISTICS],
            Self::ReferenceBounces => &[&REFERENCE_BOUNCES, &STATISTICS],
            Self::Direct => &[&PRESAMPLE, &DIRECT_CANDIDATES, &DIRECT_REUSE, &RESOLVE, &STATISTICS],
            Self::DirectDebug => &[&PRESAMPLE, &DIRECT_CANDIDATES, &DIRECT_REUSE, &DEBUG_RESERVOIRS, &STATISTICS],
            Self::Indirect => &[
                &PRESAMPLE,
                &DIRECT_CANDIDATES,
                &DIRECT_REUSE,
                &INDIRECT_CANDIDATES,
                &INDIRECT_REUSE,
                &RESOLVE,
                &STATISTICS,
            ],
            Self::DirectRays => &[&PRESAMPLE, &DIRECT_CANDIDATES, &DIRECT_REUSE, &DEBUG_RAYS, &STATISTICS],
            Self::IndirectRays => &[
                &PRESAMPLE,
                &DIRECT_CANDIDATES,
                &DIRECT_REUSE,
                &INDIRECT_CANDIDATES,
                &INDIRECT_REUSE,
                &DEBUG_RAYS,
                &STATISTICS,
            ],
            Self::PathsRays => &[&PATH_PRESAMPLE, &PATH_CANDIDATES, &PATH_REUSE, &DEBUG_RAYS, &STATISTICS],
            Self::IndirectDebug => {
                &[&INDIRECT_PRESAMPLE, &INDIRECT_CANDIDATES, &INDIRECT_REUSE, &DEBUG_INDIRECT, &STATISTICS]
            }
            Self::PathsDebug => &[&PATH_PRESAMPLE, &PATH_CANDIDATES, &PATH_REUSE, &DEBUG_PATHS, &STATISTICS],
            Self::Paths => &[&PATH_PRESAMPLE, &PATH_CANDIDATES, &PATH_REUSE, &RESOLVE, &STATISTICS],
            Self::Debug => &[&DEBUG, &STATISTICS],
        }
    }

    /// Its steps, in order, with so many rounds of reuse in each domain.
    pub(crate) fn steps(self, rounds: impl Fn(Domain) -> usize) -> Vec<Step> {
        let mut steps = vec![Step { pass: Pass::Visibility, name: "visibility", round: 0 }];
        for &pass in self.compute() {
            let names = match pass.name {
                "direct_reuse" => &DIRECT_ROUNDS[..rounds(Domain::Direct)],
                "indirect_reuse" => &INDIRECT_ROUNDS[..rounds(Domain::Indirect)],
                "path_reuse" => &PATH_ROUNDS[..rounds(Domain::Paths)],
                _ => core::slice::from_ref(&pass.name),
            };
            steps.extend(names.iter().enumerate().map(|(round, name)| Step { pass: Pass::Compute(pass), name, round }));
        }
        steps.push(Step { pass: Pass::Composite, name: "composite", round: 0 });
        steps
    }

    /// Its passes.
    pub(crate) fn passes(self) -> impl Iterator<Item = Pass> {
        self.steps(|_| 1).into_iter().map(|step| step.pass)
    }
}

/// Names of the passes that some settings run, as time spans have them.
pub fn pass_names(settings: &Restir) -> Vec<&'static str> {
    let rounds = |domain| Plan::of(domain, settings).rounds.len();
    Frame::of(settings).steps(rounds).into_iter().map(|step| step.name).collect()
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
    view: ViewQuery<(&ViewTarget, &ViewDepthTexture, Option<&ViewPrepassTextures>)>,
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
    let targets = view.into_inner();
    let (Some(key), Some(scene_group)) = (state.key, scene.bind_group.as_ref()) else {
        return;
    };
    if key.features.contains(SceneFeatures::RAY_QUERY) && scene.structures.is_none() {
        return;
    }
    let encoder = context.command_encoder();
    encoder.clear_buffer(&state.counters.buffer, 0, None);
    if let Some(history) = &state.history {
        // What was drawn a frame ago is about to be overwritten.
        encoder.copy_texture_to_texture(
            state.visibility_texture.as_image_copy(),
            history.previous_visibility.as_image_copy(),
            state.visibility_texture.size(),
        );
    }
    let rounds = |domain| state.history.as_ref().and_then(|h| h.of(domain)).map_or(1, Reservoirs::rounds);
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
                let beyond = scene.structures.iter().chain(&scene.bound_textures);
                for (group, index) in beyond.zip(3..) {
                    encoder.set_bind_group(index, group, &[]);
                }
                encoder.dispatch_workgroups(x, y, 1);
                if let Some(span) = span {
                    span.end(&mut encoder);
                }
            }
            Pass::Composite => composite::draw(state, scene_group, targets, &passes, &pipelines, &device, &mut context),
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
                R::Settings => BindingType::Buffer {
                    ty: BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                R::PreviousVisibility => texture(TextureSampleType::Uint),
                R::LightBefore | R::UnresampledLight | R::ResampledLight | R::PathLight => {
                    texture(TextureSampleType::Float { filterable: false })
                }
                R::CandidateLight | R::LightAfter => BindingType::StorageTexture {
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
    let history = state.history.as_ref();
    let own = history.and_then(|h| h.of(pass.domain));
    let view = BindingResource::TextureView;
    // Light of a domain, or none where it is not resampled.
    let light = |domains: &[Domain], of: fn(&Reservoirs) -> &TextureView| {
        history.map(|h| {
            let light: &TextureView = domains.iter().find_map(|&domain| h.of(domain)).map_or(&h.black, of);
            view(light)
        })
    };
    let entries = pass
        .resources
        .iter()
        .enumerate()
        .map(|(binding, resource)| {
            let resource = match resource {
                R::Radiance => state.radiance.as_entire_binding(),
                R::Counters => state.counters.buffer.as_entire_binding(),
                R::Settings => own?.settings_of(round),
                R::Subsets | R::SubsetsRead => history?.subsets.as_entire_binding(),
                R::CandidateReservoirs => own?.candidates().as_entire_binding(),
                R::NeighbourReservoirs => own?.neighbours_of(round).as_entire_binding(),
                R::RoundReservoirs => own?.output_of(round).as_entire_binding(),
                R::KeptReservoirs => own?.kept().as_entire_binding(),
                R::PreviousVisibility => view(&history?.previous_visibility_view),
                R::CandidateLight => view(own?.light_of_candidates()),
                R::LightBefore => view(own?.light_before(round)),
                R::LightAfter => view(own?.light_after(round)),
                R::UnresampledLight => light(&[Domain::Direct], Reservoirs::light_of_candidates)?,
                R::ResampledLight => light(&[Domain::Direct], Reservoirs::light_of_last_round)?,
                R::PathLight => light(&[Domain::Paths, Domain::Indirect], Reservoirs::light_of_last_round)?,
            };
            Some(BindGroupEntry { binding: binding as u32, resource })
        })
        .collect::<Option<Vec<_>>>()?;
    Some(device.create_bind_group(pass.name, &pipelines.get_bind_group_layout(&resource_layout(pass)), &entries))
}
