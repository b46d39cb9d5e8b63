//! Records the passes of a camera's frame in the order that its technique lists.

use bevy::{
    core_pipeline::prepass::ViewPrepassTextures,
    ecs::prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{self, *},
        renderer::{PendingCommandBuffers, RenderContext, RenderDevice, RenderQueue, ViewQuery},
        view::{ViewDepthTexture, ViewTarget},
    },
};
use core::sync::atomic::Ordering;

use super::{SPAN_PREFIX, composite, pipelines::PassPipelines, recorder::Recorder, resource, visibility};
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
        RestirView, ViewPool,
        bands::{Bands, WORKGROUP},
        bevy_handoff::HiddenFromBevy,
        counters::RunOfFrame,
        history::presample_workgroups,
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
    queue: Res<RenderQueue>,
    mut pending: ResMut<PendingCommandBuffers>,
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
    let lacks_structures = key.features.contains(SceneFeatures::RAY_QUERY) && scene.structures.is_none();
    let lacks_textures = key.features.contains(SceneFeatures::BOUND_TEXTURES) && scene.bound_textures.is_none();
    if lacks_structures || lacks_textures {
        return;
    }
    state.ran.store(true, Ordering::Relaxed);
    let view_group = state.bind_group(&device, &pipelines);
    let iterations = |domain: &Domain| {
        let reservoirs = state.history.as_ref().and_then(|h| h.of(domain));
        reservoirs.map_or(vec![IterationKind::Search], |reservoirs| reservoirs.schedule().iteration_kinds())
    };
    let steps = key.frame.steps(iterations);
    let rays = steps.iter().map(|step| state.rays_of(step)).sum();
    let limit = u64::from(state.rays_per_dispatch);
    let mut recorder = Recorder::begin(&mut context, (&*device, &*queue), &mut pending, rays, limit);
    state.counters.begin_frame(run.0, recorder.encoder());
    if let Some(light_paths) = state.history.as_ref().and_then(|history| history.light_paths.as_ref()) {
        recorder.encoder().clear_buffer(&light_paths.map, 0, Some(light_paths.heads));
    }
    for step in steps {
        match step.pass {
            Pass::Visibility => visibility::draw(state, key, &scene, scene_group, &passes, &pipelines, &mut recorder),
            Pass::Compute(pass) => {
                let resources = resource::bind_group(pass, &step, state, &device, &pipelines);
                let (Some(pipeline), Some(resources)) = (passes.compute(pass, key, &pipelines), resources) else {
                    continue;
                };
                let groups = [scene_group, &view_group, &resources];
                let compute = Compute { pass, step: &step, state, scene: &scene, pipeline, groups };
                let rays = state.rays_of(&step);
                match state.bands.as_ref().filter(|_| rays > limit) {
                    Some(bands) => {
                        let group_of = |band| state.bind_group_of_band(bands, band, &device, &pipelines);
                        compute.record_bands(bands, rays, group_of, &mut recorder);
                    }
                    None => compute.record(rays, &mut recorder),
                }
            }
            Pass::Composite if bevy_draws => {}
            Pass::Composite => {
                composite::draw(state, scene_group, targets, &passes, &pipelines, &device, &mut recorder);
            }
        }
    }
    state.counters.copy(recorder.encoder());
    recorder.finish();
}

/// A compute pass of a frame.
struct Compute<'a> {
    pass: &'static ComputePass,
    step: &'a Step,
    state: &'a RestirView,
    scene: &'a SceneBindings,
    pipeline: &'a ComputePipeline,
    /// Those of the scene, of the view and of the pass.
    groups: [&'a BindGroup; 3],
}

impl Compute<'_> {
    /// Records the pass over the whole picture.
    fn record(&self, rays: u64, recorder: &mut Recorder) {
        let workgroups = self.workgroups();
        if matches!(workgroups, Workgroups::Direct([0, _] | [_, 0])) {
            return;
        }
        recorder.make_room(rays);
        self.empty_queue(recorder);
        let name = self.step.name;
        let diagnostics = recorder.diagnostics();
        let mut encoder = self.begin(recorder);
        let span = diagnostics.as_deref().map(|d| d.pass_span(&mut encoder, format!("{SPAN_PREFIX}{name}")));
        self.dispatch(self.groups[1], workgroups, &mut encoder);
        if let Some(span) = span {
            span.end(&mut encoder);
        }
    }

    /// Records the pass over one band after another, or a few at once, each dispatch in a submission of its own.  `group_of`: the group of the
    /// view for a band.
    fn record_bands(&self, bands: &Bands, rays: u64, group_of: impl Fn(u32) -> BindGroup, recorder: &mut Recorder) {
        recorder.submit();
        self.empty_queue(recorder);
        let name = self.step.name;
        let diagnostics = recorder.diagnostics();
        let span = diagnostics.as_deref().map(|d| d.time_span(recorder.encoder(), format!("{SPAN_PREFIX}{name}")));
        let together = match self.pass.dispatch {
            // The uniforms of a band say how many entries of the queue are its own.
            Dispatch::ReplayQueue => 1,
            _ => bands.division.together(rays, self.state.rays_per_dispatch),
        };
        for (band, rows) in bands.division.dispatches(together) {
            if band > 0 {
                recorder.submit();
            }
            let workgroups = match self.workgroups() {
                Workgroups::Direct([x, _]) => Workgroups::Direct([x, rows]),
                indirect => indirect,
            };
            self.dispatch(&group_of(band), workgroups, &mut self.begin(recorder));
        }
        if let Some(span) = span {
            span.end(recorder.encoder());
        }
        recorder.submit();
    }

    fn begin<'e>(&self, recorder: &'e mut Recorder) -> render_resource::ComputePass<'e> {
        let descriptor = ComputePassDescriptor { label: Some(self.step.name), ..Default::default() };
        recorder.encoder().begin_compute_pass(&descriptor)
    }

    fn dispatch(&self, view: &BindGroup, workgroups: Workgroups, encoder: &mut render_resource::ComputePass) {
        encoder.set_pipeline(self.pipeline);
        let [scene, _, own] = self.groups;
        let optional_groups = self.scene.structures.iter().chain(&self.scene.bound_textures);
        for (group, index) in [scene, view, own].into_iter().chain(optional_groups).zip(0..) {
            encoder.set_bind_group(index, group, &[]);
        }
        match workgroups {
            Workgroups::Direct([x, y]) => encoder.dispatch_workgroups(x, y, 1),
            Workgroups::Indirect(arguments) => encoder.dispatch_workgroups_indirect(arguments, 0),
        }
    }

    fn queue(&self) -> Option<&ReplayQueue> {
        self.state.history.as_ref()?.pairs.as_ref()?.queue.as_ref()
    }

    /// Empties the replay queue before the pass that fills it.
    fn empty_queue(&self, recorder: &mut Recorder) {
        if let Some(queue) = self.queue().filter(|_| self.pass.resources.contains(&PassResource::ReplayQueue)) {
            recorder.encoder().clear_buffer(&queue.0, 0, Some(ReplayQueue::HEADER));
        }
    }

    fn workgroups(&self) -> Workgroups<'_> {
        let nothing = Workgroups::Direct([0, 0]);
        match self.pass.dispatch {
            Dispatch::Pixels => Workgroups::Direct(self.state.size.map(|side| side.div_ceil(WORKGROUP)).to_array()),
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
