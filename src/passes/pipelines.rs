//! Pipelines, specialised by what the scene contains.  A scene that gains a feature, and a camera that changes its technique, keeps
//! rendering with the pipelines it has until the new ones are ready.

use bevy::{
    app::App,
    ecs::prelude::*,
    platform::{collections::HashMap, time::Instant},
    render::{RenderApp, render_resource::*},
    shader::ShaderDefVal,
};
use core::num::NonZeroU32;

use super::{
    ComputePass, Frame, Pass,
    composite::{self, CompositeKey},
    resource_layout, visibility,
};
use crate::{
    scene::{SceneFeatures, bindings::scene_layout, bound, hardware},
    shaders::ShaderTable,
    view::view_layout,
};

/// What the pipelines of a frame are made for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct FrameKey {
    pub frame: Frame,
    pub features: SceneFeatures,
}

impl FrameKey {
    /// Whether its shaders do what the settings of another ask for, if not what its scene does.
    pub(crate) fn serves_settings_of(self, wanted: Self) -> bool {
        let of_settings = SceneFeatures::ENERGY_COMPENSATION | SceneFeatures::MANY_TAPS;
        self.frame == wanted.frame && !(self.features ^ wanted.features).intersects(of_settings)
    }
}

/// One pipeline, for the statistics.
#[derive(Clone, Debug, PartialEq)]
pub struct PipelineReport {
    /// Name of the pass.
    pub name: &'static str,
    /// Shader definitions that it was compiled with.
    pub defs: Vec<&'static str>,
    /// From the request until it could be used, ms.  A driver may put part of its work off until the first use.
    pub compile_ms: f64,
}

#[derive(Clone, Copy)]
enum PipelineId {
    Compute(CachedComputePipelineId),
    Render(CachedRenderPipelineId),
}

struct Compiled {
    id: PipelineId,
    name: &'static str,
    features: SceneFeatures,
    asked: Instant,
    took_ms: Option<f64>,
}

/// All pipelines that were asked for.
#[derive(Resource, Default)]
pub(crate) struct PassPipelines {
    compute: HashMap<(&'static str, SceneFeatures), usize>,
    visibility: HashMap<(Option<Face>, SceneFeatures), usize>,
    composite: HashMap<CompositeKey, usize>,
    all: Vec<Compiled>,
    shaders: Option<ShaderTable>,
    /// Group 3 holds the device's acceleration structures.
    ray_queries: bool,
    /// How many textures the group behind all others holds.
    bound_textures: Option<NonZeroU32>,
    /// Shader definitions beside those of the features: what tests plant.
    planted: Vec<&'static str>,
}

/// Compiles every compute pass anew with these shader definitions as well.  For tests, which plant errors that they must find.
#[doc(hidden)]
pub fn plant_shader_defs(app: &mut App, defs: &[&'static str]) {
    if let Some(mut passes) =
        app.get_sub_app_mut(RenderApp).and_then(|r| r.world_mut().get_resource_mut::<PassPipelines>())
    {
        passes.planted = defs.to_vec();
        passes.compute.clear();
    }
}

/// Ways in which the visibility pass culls.
const CULLS: [Option<Face>; 3] = [None, Some(Face::Back), Some(Face::Front)];

impl PassPipelines {
    /// Takes the table of shaders, and what the device has beyond the portable tier.
    pub(crate) fn new(shaders: ShaderTable, ray_queries: bool, bound_textures: Option<NonZeroU32>) -> Self {
        Self { shaders: Some(shaders), ray_queries, bound_textures, ..Default::default() }
    }

    /// The pipelines to render with: the wanted ones once all are ready, until then the last ones.
    pub(crate) fn choose(
        &mut self,
        wanted: FrameKey,
        last: Option<FrameKey>,
        pipelines: &PipelineCache,
    ) -> Option<FrameKey> {
        if self.ready(wanted, pipelines) { Some(wanted) } else { last }
    }

    /// Asks for every pipeline of a frame; true once all are there.
    fn ready(&mut self, key: FrameKey, pipelines: &PipelineCache) -> bool {
        let mut indices = Vec::new();
        for pass in key.frame.passes() {
            match pass {
                Pass::Compute(pass) => indices.push(self.ask_compute(pass, key, pipelines)),
                Pass::Visibility => {
                    for cull in CULLS {
                        indices.push(self.ask_visibility(cull, key.features, pipelines));
                    }
                }
                // Asked for once the format of the target is known.
                Pass::Composite => {}
            }
        }
        // All are asked, so that each notes when it was ready.
        let missing = indices.into_iter().filter(|&index| !self.is_ready(index, pipelines)).count();
        missing == 0
    }

    fn is_ready(&mut self, index: usize, pipelines: &PipelineCache) -> bool {
        let compiled = &mut self.all[index];
        let ready = match compiled.id {
            PipelineId::Compute(id) => pipelines.get_compute_pipeline(id).is_some(),
            PipelineId::Render(id) => pipelines.get_render_pipeline(id).is_some(),
        };
        if ready && compiled.took_ms.is_none() {
            compiled.took_ms = Some(compiled.asked.elapsed().as_secs_f64() * 1e3);
        }
        ready
    }

    fn push(&mut self, id: PipelineId, name: &'static str, features: SceneFeatures) -> usize {
        self.all.push(Compiled { id, name, features, asked: Instant::now(), took_ms: None });
        self.all.len() - 1
    }

    fn shader(&self, path: &str) -> bevy::asset::Handle<bevy::shader::Shader> {
        self.shaders.as_ref().map(|table| table.pass(path)).unwrap_or_default()
    }

    fn ask_compute(&mut self, pass: &'static ComputePass, key: FrameKey, pipelines: &PipelineCache) -> usize {
        let features = specialisation(pass, key);
        if let Some(&index) = self.compute.get(&(pass.name, features)) {
            return index;
        }
        let mut shader_defs = features.shader_defs();
        shader_defs.extend(pass.def.map(|def| ShaderDefVal::Bool(def.into(), true)));
        shader_defs.extend(self.planted.iter().map(|&def| ShaderDefVal::Bool(def.into(), true)));
        let mut layout = vec![scene_layout(), view_layout(), resource_layout(pass)];
        if self.ray_queries {
            layout.push(hardware::layout());
        }
        layout.extend(self.bound_layout(features));
        let id = pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(format!("restir {}", pass.name).into()),
            layout,
            shader: self.shader(&format!("pass/{}.wgsl", pass.file)),
            shader_defs,
            entry_point: Some(pass.file.into()),
            ..Default::default()
        });
        let index = self.push(PipelineId::Compute(id), pass.name, features);
        self.compute.insert((pass.name, features), index);
        index
    }

    /// Of the features of a scene those that the visibility pass is compiled for: alpha may come from a texture.
    fn visibility_features(features: SceneFeatures) -> SceneFeatures {
        if !features.contains(SceneFeatures::ALPHA) {
            return SceneFeatures::empty();
        }
        features & SceneFeatures::BOUND_TEXTURES | SceneFeatures::ALPHA | SceneFeatures::TEXTURES
    }

    fn ask_visibility(&mut self, cull: Option<Face>, features: SceneFeatures, pipelines: &PipelineCache) -> usize {
        let used = Self::visibility_features(features);
        if let Some(&index) = self.visibility.get(&(cull, used)) {
            return index;
        }
        let shader = self.shader("pass/visibility.wgsl");
        let descriptor = visibility::pipeline(shader, used.shader_defs(), cull, self.bound_layout(used));
        let id = pipelines.queue_render_pipeline(descriptor);
        let index = self.push(PipelineId::Render(id), "visibility", used & (features | SceneFeatures::TEXTURES));
        self.visibility.insert((cull, used), index);
        index
    }

    /// The layout of the textures that are bound as they are, where shaders of these features read them.
    fn bound_layout(&self, features: SceneFeatures) -> Option<BindGroupLayoutDescriptor> {
        self.bound_textures.filter(|_| features.contains(SceneFeatures::BOUND_TEXTURES)).map(bound::layout)
    }

    /// The pipeline of a compute pass.
    pub(crate) fn compute<'a>(
        &self,
        pass: &ComputePass,
        key: FrameKey,
        pipelines: &'a PipelineCache,
    ) -> Option<&'a ComputePipeline> {
        match self.all[*self.compute.get(&(pass.name, specialisation(pass, key)))?].id {
            PipelineId::Compute(id) => pipelines.get_compute_pipeline(id),
            PipelineId::Render(_) => None,
        }
    }

    /// The pipeline that draws instances of a culling.
    pub(crate) fn visibility<'a>(
        &self,
        cull: Option<Face>,
        key: FrameKey,
        pipelines: &'a PipelineCache,
    ) -> Option<&'a RenderPipeline> {
        match self.all[*self.visibility.get(&(cull, Self::visibility_features(key.features)))?].id {
            PipelineId::Render(id) => pipelines.get_render_pipeline(id),
            PipelineId::Compute(_) => None,
        }
    }

    /// Asks for the pipeline that writes to these targets; true once it is there.
    pub(crate) fn ask_composite(&mut self, key: CompositeKey, pipelines: &PipelineCache) -> bool {
        let index = match self.composite.get(&key) {
            Some(&index) => index,
            None => {
                let shader = self.shader("pass/composite.wgsl");
                let id = pipelines.queue_render_pipeline(composite::pipeline(shader, key));
                let index = self.push(PipelineId::Render(id), "composite", SceneFeatures::empty());
                self.composite.insert(key, index);
                index
            }
        };
        self.is_ready(index, pipelines)
    }

    /// That pipeline.
    pub(crate) fn composite<'a>(&self, key: CompositeKey, pipelines: &'a PipelineCache) -> Option<&'a RenderPipeline> {
        match self.all[*self.composite.get(&key)?].id {
            PipelineId::Render(id) => pipelines.get_render_pipeline(id),
            PipelineId::Compute(_) => None,
        }
    }

    /// Every pipeline that is ready.
    pub(crate) fn report(&self) -> Vec<PipelineReport> {
        self.all
            .iter()
            .filter_map(|c| Some(PipelineReport { name: c.name, defs: c.features.names(), compile_ms: c.took_ms? }))
            .collect()
    }
}

fn specialisation(pass: &ComputePass, key: FrameKey) -> SceneFeatures {
    if pass.specialised { key.features } else { SceneFeatures::empty() }
}
