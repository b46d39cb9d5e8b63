//! Records the passes of a camera's frame in the order that its technique lists.

use bevy::{
    core_pipeline::prepass::ViewPrepassTextures,
    ecs::prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::*,
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::{ViewDepthTexture, ViewTarget},
    },
};
use core::sync::atomic::Ordering;

use super::{SPAN_PREFIX, composite, pipelines::PassPipelines, resource, visibility};
use crate::{
    cpu_times::{CpuTimes, Stage},
    scene::{SceneFeatures, bindings::SceneBindings},
    technique::{
        domain::Domain,
        frame::Step,
        pass::{ComputePass, Dispatch, Pass, PassResource},
        reuse_schedule::IterationKind,
    },
    view::{
        RestirView, ViewPool, bevy_handoff::HiddenFromBevy, counters::RunOfFrame, history::presample_workgroups,
        pairs::ReplayQueue,
    },
};

pub(super) fn run_passes(
    view: ViewQuery<(&ViewTarget, &ViewDepthTexture, Option<&ViewPrepassTextures>)>,
    views: Res<ViewPool>,
    scene: Res<SceneBindings>,
    passes: Res<PassPipelines>,
    run: Res<RunOfFrame>,
    pipelines: Res<PipelineCache>,
    device: Res<RenderDevice>,
    hidden: Res<HiddenFromBevy>,
    times: Res<CpuTimes>,
    mut context: RenderContext,
) {
    let _running = times.measure(Stage::Passes);
    // Bevy still lights the frame in which our pipelines become ready, so that no frame is black.
    let bevy_draws = hidden.bevy_draws(view.entity());
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
    state.ran.store(true, Ordering::Relaxed);
    state.counters.begin_frame(run.0, &mut context);
    if let Some(light_paths) = state.history.as_ref().and_then(|history| history.light_paths.as_ref()) {
        context.command_encoder().clear_buffer(&light_paths.map, 0, Some(light_paths.heads));
    }
    let view_group = state.bind_group(&device, &pipelines);
    let iterations = |domain: &Domain| {
        let reservoirs = state.history.as_ref().and_then(|h| h.of(domain));
        reservoirs.map_or(vec![IterationKind::Search], |reservoirs| reservoirs.schedule().iteration_kinds())
    };
    for step in key.frame.steps(iterations) {
        match step.pass {
            Pass::Visibility => visibility::draw(state, key, &scene, scene_group, &passes, &pipelines, &mut context),
            Pass::Compute(pass) => {
                let resources = resource::bind_group(pass, &step, state, &device, &pipelines);
                let compute = Compute { pass, step: &step, state, scene: &scene, groups: [scene_group, &view_group] };
                if let (Some(pipeline), Some(group)) = (passes.compute(pass, key, &pipelines), resources) {
                    compute.record(pipeline, &group, &mut context);
                }
            }
            Pass::Composite if bevy_draws => {}
            Pass::Composite => composite::draw(state, scene_group, targets, &passes, &pipelines, &device, &mut context),
        }
    }
    state.counters.copy(&mut context);
}

/// A compute pass of a frame.
struct Compute<'a> {
    pass: &'static ComputePass,
    step: &'a Step,
    state: &'a RestirView,
    scene: &'a SceneBindings,
    /// Those of the scene and of the view.
    groups: [&'a BindGroup; 2],
}

impl Compute<'_> {
    fn record(&self, pipeline: &ComputePipeline, resources: &BindGroup, context: &mut RenderContext) {
        let workgroups = self.workgroups();
        if matches!(workgroups, Workgroups::Direct([0, _] | [_, 0])) {
            return;
        }
        self.empty_queue(context);
        let name = self.step.name;
        let diagnostics = context.diagnostic_recorder();
        let mut encoder = context
            .command_encoder()
            .begin_compute_pass(&ComputePassDescriptor { label: Some(name), ..Default::default() });
        let span = diagnostics.as_deref().map(|d| d.pass_span(&mut encoder, format!("{SPAN_PREFIX}{name}")));
        encoder.set_pipeline(pipeline);
        for (group, index) in self.groups.into_iter().zip(0..) {
            encoder.set_bind_group(index, group, &[]);
        }
        encoder.set_bind_group(2, resources, &[]);
        let optional_groups = self.scene.structures.iter().chain(&self.scene.bound_textures);
        for (group, index) in optional_groups.zip(3..) {
            encoder.set_bind_group(index, group, &[]);
        }
        match workgroups {
            Workgroups::Direct([x, y]) => encoder.dispatch_workgroups(x, y, 1),
            Workgroups::Indirect(arguments) => encoder.dispatch_workgroups_indirect(arguments, 0),
        }
        if let Some(span) = span {
            span.end(&mut encoder);
        }
    }

    fn queue(&self) -> Option<&ReplayQueue> {
        self.state.history.as_ref()?.pairs.as_ref()?.queue.as_ref()
    }

    /// Empties the replay queue before the pass that fills it.
    fn empty_queue(&self, context: &mut RenderContext) {
        if let Some(queue) = self.queue().filter(|_| self.pass.resources.contains(&PassResource::ReplayQueue)) {
            context.command_encoder().clear_buffer(&queue.0, 0, Some(ReplayQueue::HEADER));
        }
    }

    fn workgroups(&self) -> Workgroups<'_> {
        let nothing = Workgroups::Direct([0, 0]);
        match self.pass.dispatch {
            Dispatch::Pixels => Workgroups::Direct([self.state.size.x.div_ceil(8), self.state.size.y.div_ceil(8)]),
            Dispatch::Subsets => Workgroups::Direct(presample_workgroups(&self.state.settings.direct)),
            Dispatch::ReplayQueue => self.queue().map_or(nothing, |queue| Workgroups::Indirect(&queue.0)),
        }
    }
}

/// Number of workgroups of a dispatch.
enum Workgroups<'a> {
    Direct([u32; 2]),
    /// A buffer holds the number.
    Indirect(&'a Buffer),
}
