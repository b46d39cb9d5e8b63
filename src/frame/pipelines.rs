//! Compiles pipelines, specialized for the features of the scene.  When a scene gains a feature or a camera changes its technique, the camera
//! keeps its old pipelines until the new ones are compiled, so that no frame is missing.

#[cfg(feature = "testing")]
pub(crate) mod testing;

use bevy::{
    asset::Handle,
    core_pipeline::prepass::ViewPrepassTextures,
    ecs::prelude::*,
    platform::{collections::HashMap, time::Instant},
    render::{
        camera::ExtractedCamera,
        render_resource::*,
        view::{Msaa, ViewTarget},
    },
    shader::{Shader, ShaderDefVal},
};
use core::num::NonZeroU32;

use super::{composite, resource, visibility};
use crate::{
    cpu_times::{CpuTimes, Stage},
    scene::{
        SceneFeatures,
        accel::ray_query,
        bindings::{SceneBindings, scene_layout},
        texture::bindless,
    },
    shader_library::{ShaderLibrary, definitions_read_by},
    technique::{
        frame::PipelineKey,
        pass::{ComputePass, Pass},
    },
    view::{
        ViewPool,
        counters::RayCounting,
        environment::EnvironmentPool,
        extract::{self, ExtractedViews},
        selection::{CompositeKey, SelectedPipelines, Selection, requested_key},
        view_layout,
    },
};

/// A compiled pipeline, as the report lists it.
#[derive(Clone, Debug, PartialEq)]
pub struct PipelineReport {
    /// Name of the pass.
    pub name: &'static str,
    /// Shader definitions that it was specialized with.
    pub defs: Vec<&'static str>,
    /// Time from the request until the pipeline was ready, ms.  A driver may defer part of its work to the first use.
    pub compile_ms: f64,
}

/// Where a pipeline is.
enum PipelineId {
    Compute(CachedComputePipelineId),
    Render(CachedRenderPipelineId),
    /// Compiled by another app of the test program.
    #[cfg(feature = "testing")]
    Shared(ComputePipeline),
}

/// A requested pipeline.
struct PipelineEntry {
    id: PipelineId,
    name: &'static str,
    features: SceneFeatures,
    requested: Instant,
    compile_ms: Option<f64>,
}

/// All requested pipelines.
#[derive(Resource, Default)]
pub(crate) struct PassPipelines {
    compute: HashMap<(&'static str, SceneFeatures), usize>,
    /// Features that the shader of each pass asks for.
    reads: HashMap<&'static str, SceneFeatures>,
    visibility: HashMap<(Option<Face>, SceneFeatures), usize>,
    composite: HashMap<CompositeKey, usize>,
    all: Vec<PipelineEntry>,
    shaders: Option<ShaderLibrary>,
    /// Rays are traced by ray queries, and group 3 holds acceleration structures.
    ray_queries: bool,
    /// Size of the array of bindless textures in the last group, if the device has such arrays.
    max_bindless_textures: Option<NonZeroU32>,
    /// Additional shader definitions, set by tests.
    planted: Vec<ShaderDefVal>,
    /// Replacements for the shaders of passes, set by tests.
    replaced: HashMap<&'static str, Handle<Shader>>,
    /// Their texts.
    #[cfg(feature = "testing")]
    replaced_texts: HashMap<&'static str, String>,
    /// Passages of the shader library that tests replaced.
    #[cfg(feature = "testing")]
    edits: Vec<crate::shader_library::ShaderEdit>,
    #[cfg(feature = "testing")]
    shared: Option<testing::SharedPipelines>,
}

/// Chooses the pipelines of every camera.
pub(super) fn select_pipelines(
    mut selected: ResMut<SelectedPipelines>,
    mut passes: ResMut<PassPipelines>,
    extracted: Res<ExtractedViews>,
    views: Res<ViewPool>,
    cameras: Query<(&ExtractedCamera, Option<&ViewTarget>, Option<&ViewPrepassTextures>, Option<&Msaa>)>,
    scene: Res<SceneBindings>,
    environments: Res<EnvironmentPool>,
    ray_counting: Res<RayCounting>,
    pipelines: Res<PipelineCache>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::Pipelines);
    selected.0.clear();
    for (&entity, restir) in &extracted.0 {
        let Some((_, target, prepass, msaa)) = cameras.get(entity).ok().filter(|c| extract::has_view(Some(c.0))) else {
            continue;
        };
        let last = views.last_key(entity);
        let requested = requested_key(restir, &scene, &environments, last, ray_counting.is_on());
        let key = passes.request_or_keep(requested, last, &pipelines);
        let has_target = target.is_some();
        // The plugin turns multisampling off at the end of the app's frame.  An app that turns it on later than that loses this frame.
        let target = target.filter(|_| msaa.is_none_or(|msaa| *msaa == Msaa::Off));
        let composite = target.map(|target| CompositeKey::of(target, prepass));
        if let Some(key) = composite.filter(|_| views.views.get(&entity).is_some_and(|view| view.rendered)) {
            // The other variant is compiled ahead of time: temporal antialiasing adds a prepass of motion vectors, and removes it again.  It
            // is small, and a camera whose pipeline is not compiled would be black for a frame.
            passes.request_composite(CompositeKey { motion: !key.motion, ..key }, &pipelines);
        }
        let composite = composite.filter(|&key| passes.request_composite(key, &pipelines));
        selected.0.insert(entity, Selection { requested, key, composite, has_target });
    }
}

/// Culling modes of the visibility pass.
const CULLS: [Option<Face>; 3] = [None, Some(Face::Back), Some(Face::Front)];

impl PassPipelines {
    /// `ray_queries` and `max_bindless_textures` add the bindings of optional device features.
    pub(crate) fn new(shaders: ShaderLibrary, ray_queries: bool, max_bindless_textures: Option<NonZeroU32>) -> Self {
        Self { shaders: Some(shaders), ray_queries, max_bindless_textures, ..Default::default() }
    }

    /// Requests the pipelines of a frame.  Returns the key to render with: the requested one once all of its pipelines are compiled, and
    /// that of the last frame until then.
    fn request_or_keep(
        &mut self,
        requested: PipelineKey,
        last: Option<PipelineKey>,
        pipelines: &PipelineCache,
    ) -> Option<PipelineKey> {
        if self.request_frame(requested, pipelines) { Some(requested) } else { last }
    }

    /// Requests every pipeline of a frame; true once all of them are ready.
    fn request_frame(&mut self, key: PipelineKey, pipelines: &PipelineCache) -> bool {
        let mut indices = Vec::new();
        for pass in key.frame.passes() {
            match pass {
                Pass::Compute(pass) => indices.push(self.request_compute(pass, key, pipelines)),
                Pass::Visibility => {
                    for cull in CULLS {
                        indices.push(self.request_visibility(cull, key.features, pipelines));
                    }
                }
                // Requested by `select_pipelines`, for the format of the target.
                Pass::Composite => {}
            }
        }
        // Every pipeline is queried, without a short circuit, because `is_ready` records the compile time.
        let missing = indices.into_iter().filter(|&index| !self.is_ready(index, pipelines)).count();
        missing == 0
    }

    fn is_ready(&mut self, index: usize, pipelines: &PipelineCache) -> bool {
        let compiled = &mut self.all[index];
        let ready = match compiled.id {
            PipelineId::Compute(id) => pipelines.get_compute_pipeline(id).is_some(),
            PipelineId::Render(id) => pipelines.get_render_pipeline(id).is_some(),
            #[cfg(feature = "testing")]
            PipelineId::Shared(_) => true,
        };
        if ready && compiled.compile_ms.is_none() {
            compiled.compile_ms = Some(compiled.requested.elapsed().as_secs_f64() * 1e3);
            #[cfg(feature = "testing")]
            self.share(index, pipelines);
        }
        ready
    }

    fn push(&mut self, id: PipelineId, name: &'static str, features: SceneFeatures) -> usize {
        self.all.push(PipelineEntry { id, name, features, requested: Instant::now(), compile_ms: None });
        self.all.len() - 1
    }

    fn shader(&self, path: &str) -> Handle<Shader> {
        self.shaders.as_ref().map(|library| library.pass(path, &[])).unwrap_or_default()
    }

    fn pass_shader(&self, pass: &ComputePass) -> Handle<Shader> {
        let replaced = self.replaced.get(pass.name).cloned();
        let path = format!("pass/{}.wgsl", pass.file);
        let library = || self.shaders.as_ref().map(|library| library.pass(&path, pass.domain_rooms));
        replaced.or_else(library).unwrap_or_default()
    }

    fn request_compute(&mut self, pass: &'static ComputePass, key: PipelineKey, pipelines: &PipelineCache) -> usize {
        self.reads.entry(pass.name).or_insert_with(|| features_read_by(pass.file, pass.domain_rooms));
        let features = self.specialization(pass, key);
        if let Some(&index) = self.compute.get(&(pass.name, features)) {
            return index;
        }
        #[cfg(feature = "testing")]
        if let Some(index) = self.request_shared(pass, features) {
            return index;
        }
        let mut shader_defs = features.shader_defs();
        shader_defs.extend(pass.defs.iter().map(|&def| ShaderDefVal::Bool(def.into(), true)));
        shader_defs.extend(self.planted.iter().cloned());
        let mut layout = vec![scene_layout(), view_layout(), resource::layout(pass)];
        if self.ray_queries {
            layout.push(ray_query::layout());
        }
        layout.extend(self.bindless_layout(features));
        let id = pipelines.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(format!("restir {}", pass.name).into()),
            layout,
            shader: self.pass_shader(pass),
            shader_defs,
            entry_point: Some(pass.file.into()),
            ..Default::default()
        });
        let index = self.push(PipelineId::Compute(id), pass.name, features);
        self.compute.insert((pass.name, features), index);
        index
    }

    /// Features that the visibility pass is specialized for.  It only tests alpha, which may come from a texture and from vertex colors.
    fn visibility_features(features: SceneFeatures) -> SceneFeatures {
        if !features.contains(SceneFeatures::ALPHA) {
            return SceneFeatures::empty();
        }
        let sources = SceneFeatures::BOUND_TEXTURES | SceneFeatures::SECOND_UVS | SceneFeatures::VERTEX_COLORS;
        features & sources | SceneFeatures::ALPHA | SceneFeatures::TEXTURES
    }

    fn request_visibility(&mut self, cull: Option<Face>, features: SceneFeatures, pipelines: &PipelineCache) -> usize {
        let used = Self::visibility_features(features);
        if let Some(&index) = self.visibility.get(&(cull, used)) {
            return index;
        }
        let shader = self.shader("pass/visibility.wgsl");
        let descriptor = visibility::pipeline(shader, used.shader_defs(), cull, self.bindless_layout(used));
        let id = pipelines.queue_render_pipeline(descriptor);
        let index = self.push(PipelineId::Render(id), "visibility", used);
        self.visibility.insert((cull, used), index);
        index
    }

    /// Layout of the bindless textures, if shaders of these features read them.
    fn bindless_layout(&self, features: SceneFeatures) -> Option<BindGroupLayoutDescriptor> {
        self.max_bindless_textures.filter(|_| features.contains(SceneFeatures::BOUND_TEXTURES)).map(bindless::layout)
    }

    /// Features that the pipeline of a pass is specialized for: those that its shader asks for.  Others need no pipelines of their own.
    fn specialization(&self, pass: &ComputePass, key: PipelineKey) -> SceneFeatures {
        let is_replaced = self.replaced.contains_key(pass.name);
        let read = self.reads.get(pass.name).filter(|_| !is_replaced);
        read.map_or(key.features, |&read| key.features & read)
    }

    /// The pipeline of a compute pass.
    pub(crate) fn compute<'a>(
        &'a self,
        pass: &ComputePass,
        key: PipelineKey,
        pipelines: &'a PipelineCache,
    ) -> Option<&'a ComputePipeline> {
        match &self.all[*self.compute.get(&(pass.name, self.specialization(pass, key)))?].id {
            PipelineId::Compute(id) => pipelines.get_compute_pipeline(*id),
            PipelineId::Render(_) => None,
            #[cfg(feature = "testing")]
            PipelineId::Shared(pipeline) => Some(pipeline),
        }
    }

    /// The pipeline that draws instances with a culling mode.
    pub(crate) fn visibility<'a>(
        &self,
        cull: Option<Face>,
        key: PipelineKey,
        pipelines: &'a PipelineCache,
    ) -> Option<&'a RenderPipeline> {
        match self.all[*self.visibility.get(&(cull, Self::visibility_features(key.features)))?].id {
            PipelineId::Render(id) => pipelines.get_render_pipeline(id),
            _ => None,
        }
    }

    /// Requests the composite pipeline for these targets; true once it is compiled.
    pub(crate) fn request_composite(&mut self, key: CompositeKey, pipelines: &PipelineCache) -> bool {
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

    /// The composite pipeline for these targets.
    pub(crate) fn composite<'a>(&self, key: CompositeKey, pipelines: &'a PipelineCache) -> Option<&'a RenderPipeline> {
        match self.all[*self.composite.get(&key)?].id {
            PipelineId::Render(id) => pipelines.get_render_pipeline(id),
            _ => None,
        }
    }

    /// Lists every compiled pipeline again, if more are compiled than the list has.
    pub(crate) fn update_report(&self, list: &mut Vec<PipelineReport>) {
        let compiled = self.all.iter().filter_map(|entry| Some((entry, entry.compile_ms?)));
        // Pipelines are never removed.  A new device begins without any.
        if compiled.clone().count() != list.len() {
            list.clear();
            list.extend(compiled.map(|(entry, compile_ms)| PipelineReport {
                name: entry.name,
                defs: entry.features.names(),
                compile_ms,
            }));
        }
    }
}

/// Features that the shader `pass/FILE.wgsl` asks for.  `rooms`: those of the domain, if the shader is a template.
pub fn features_read_by(file: &str, rooms: &[&str]) -> SceneFeatures {
    let definitions = definitions_read_by(&format!("pass/{file}.wgsl"), rooms);
    SceneFeatures::TABLE.iter().filter(|(_, def)| definitions.contains(*def)).map(|(feature, _)| *feature).collect()
}
