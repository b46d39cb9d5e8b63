//! Tests plant errors in the shaders of passes, replace them, and share compiled pipelines between apps.

use bevy::{
    app::App,
    asset::Assets,
    ecs::prelude::*,
    platform::collections::HashMap,
    render::{
        RenderApp,
        render_resource::{ComputePipeline, PipelineCache},
    },
    shader::{Shader, ShaderDefVal},
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{PassPipelines, PipelineId};
use crate::{scene::SceneFeatures, shader_library::ShaderEdit, technique::pass::ComputePass};

/// Compiled pipelines of a device, shared by the apps that use it one after the other.  A test would spend most of its time on compiling what
/// the tests before it have compiled.
#[derive(Clone, Default)]
pub struct SharedPipelines(Arc<Mutex<HashMap<SharedKey, ComputePipeline>>>);

/// Everything that the code of a pipeline depends on.
type SharedKey = (&'static str, SceneFeatures, String);

impl SharedPipelines {
    /// The number of pipelines.
    pub fn count(&self) -> usize {
        self.lock().len()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<SharedKey, ComputePipeline>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Lets an app use these pipelines, and adds those that it compiles.  All of its pipelines must be of one device.
pub fn share_pipelines(app: &mut App, shared: SharedPipelines) {
    if let Some(mut passes) = passes_of(app) {
        passes.shared = Some(shared);
    }
}

impl PassPipelines {
    fn shared_key(&self, name: &'static str, features: SceneFeatures) -> SharedKey {
        let Self { ray_queries, planted, edits, replaced_texts, .. } = self;
        (name, features, format!("{ray_queries} {planted:?} {edits:?} {:?}", replaced_texts.get(name)))
    }

    /// Takes the pipeline that another app compiled.
    pub(super) fn request_shared(&mut self, pass: &ComputePass, features: SceneFeatures) -> Option<usize> {
        let pipeline = self.shared.as_ref()?.lock().get(&self.shared_key(pass.name, features))?.clone();
        let index = self.push(PipelineId::Shared(pipeline), pass.name, features);
        self.compute.insert((pass.name, features), index);
        Some(index)
    }

    /// Keeps a compiled pipeline for other apps.
    pub(super) fn share(&self, index: usize, pipelines: &PipelineCache) {
        let entry = &self.all[index];
        let (Some(shared), PipelineId::Compute(id)) = (&self.shared, &entry.id) else { return };
        if let Some(pipeline) = pipelines.get_compute_pipeline(*id) {
            shared.lock().insert(self.shared_key(entry.name, entry.features), pipeline.clone());
        }
    }
}

fn passes_of(app: &mut App) -> Option<Mut<'_, PassPipelines>> {
    app.get_sub_app_mut(RenderApp).and_then(|render_app| render_app.world_mut().get_resource_mut::<PassPipelines>())
}

/// Recompiles all compute passes with additional shader definitions: `NAME`, or `NAME=VALUE` with an unsigned integer.  Tests plant errors in
/// this way and check that they find them.
pub fn plant_shader_defs(app: &mut App, defs: &[&str]) {
    if let Some(mut passes) = passes_of(app) {
        passes.planted = defs
            .iter()
            .map(|def| match def.split_once('=').map(|(name, value)| (name, value.parse())) {
                Some((name, Ok(value))) => ShaderDefVal::UInt(name.into(), value),
                _ => ShaderDefVal::Bool((*def).into(), true),
            })
            .collect();
        passes.compute.clear();
    }
}

/// Replaces passages of the shader library; all others have their original text again.  Tests plant errors in this way that need no
/// definition in a shader.
pub fn plant_shader_edits(app: &mut App, edits: &[ShaderEdit]) {
    let Some(mut passes) = passes_of(app) else { return };
    if passes.edits == edits {
        return;
    }
    let before = core::mem::replace(&mut passes.edits, edits.to_vec());
    // Bevy compiles only those pipelines again that this app compiled: the others are requested again.
    let PassPipelines { compute, all, .. } = &mut *passes;
    compute.retain(|_, index| !matches!(all[*index].id, PipelineId::Shared(_)));
    let Some(library) = passes.shaders.clone() else { return };
    let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
    library.edit(&mut shaders, &crate::technique::shader_templates(), &before, edits);
}

/// Replaces the shader of a compute pass.  The new shader has the same entry point, bindings and template.  Tests measure quantities in this
/// way that the passes do not write.
pub fn replace_pass_shader(app: &mut App, pass_name: &'static str, wgsl: &str) {
    let mut passes = crate::technique::all_domains().flat_map(crate::technique::domain::Domain::passes);
    let rooms = passes.find(|pass| pass.name == pass_name).map_or(&[][..], |pass| pass.domain_rooms);
    let text = crate::shader_library::instantiate(wgsl, rooms);
    let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
    let handle = shaders.add(Shader::from_wgsl(text.clone(), format!("test {pass_name}")));
    if let Some(mut passes) = passes_of(app) {
        passes.replaced.insert(pass_name, handle);
        passes.replaced_texts.insert(pass_name, text);
        passes.compute.clear();
    }
}
