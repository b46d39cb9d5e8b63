//! Composes WGSL with `naga_oil` exactly as Bevy does, without a GPU.

use crate::mutant;
use bevy_restir::{
    SceneFeatures,
    testing::shader_library::{MODULES, ShaderEdit, edited},
};
use naga::valid::Capabilities;
use naga_oil::compose::{
    ComposableModuleDescriptor, Composer, NagaModuleDescriptor, ShaderDefValue, ShaderLanguage, ShaderType,
    get_preprocessor_data,
};
use std::collections::{HashMap, HashSet};

/// Capabilities that shaders may use: the portable tier, and on devices that have them ray queries and arrays of textures.
pub const CAPABILITIES: Capabilities =
    Capabilities::SHADER_FLOAT16_IN_FLOAT32.union(Capabilities::RAY_QUERY).union(TEXTURE_ARRAYS);

/// Arrays of textures with an index that differs between the invocations of a subgroup.
pub const TEXTURE_ARRAYS: Capabilities = Capabilities::TEXTURE_AND_SAMPLER_BINDING_ARRAY
    .union(Capabilities::TEXTURE_AND_SAMPLER_BINDING_ARRAY_NON_UNIFORM_INDEXING);

/// A shader definition.
pub type Def = (&'static str, ShaderDefValue);

/// A shader definition without a value.
pub fn flag(name: &'static str) -> Def {
    (name, ShaderDefValue::Bool(true))
}

/// Module name of a path below `shaders/`.
pub fn module_name(path: &str) -> String {
    format!("bevy_restir::{}", path.trim_end_matches(".wgsl").replace('/', "::"))
}

/// Paths and texts of the library modules, ordered so that imports come first.
pub fn library() -> Vec<(&'static str, &'static str)> {
    let mut rest: Vec<_> = MODULES.iter().copied().filter(|(path, _)| !path.starts_with("pass/")).collect();
    let known: HashSet<String> = rest.iter().map(|(path, _)| module_name(path)).collect();
    let mut done = HashSet::new();
    let mut ordered = Vec::new();
    while !rest.is_empty() {
        let before = rest.len();
        rest.retain(|&(path, text)| {
            let (_, imports, _) = get_preprocessor_data(text);
            let ready = imports.iter().all(|i| {
                let module = known.iter().find(|m| i.import == **m || i.import.starts_with(&format!("{m}::")));
                module.is_none_or(|m| done.contains(m))
            });
            if ready {
                done.insert(module_name(path));
                ordered.push((path, text));
            }
            !ready
        });
        assert!(rest.len() < before, "circular imports among {:?}", rest.iter().map(|r| r.0).collect::<Vec<_>>());
    }
    ordered
}

/// A composer with the whole library.
pub fn composer() -> Composer {
    composer_with(&[])
}

/// A composer with the whole library, in which tests replace passages.
pub fn composer_with(edits: &[ShaderEdit]) -> Composer {
    // Callers validate the composed shaders; a validating composer would also write each module as text and parse it again (slow).
    let mut composer = Composer::non_validating().with_capabilities(CAPABILITIES);
    for (path, text) in library() {
        let text = &edited(path, &edited(path, text, mutant::edits()), edits);
        composer
            .add_composable_module(ComposableModuleDescriptor {
                source: text,
                file_path: path,
                language: ShaderLanguage::Wgsl,
                ..Default::default()
            })
            .map(|_| ())
            .unwrap_or_else(|e| panic!("{path}: {}", e.emit_to_string(&Composer::default())));
    }
    composer
}

/// Composes a top-level shader, and panics with the composer's message where that fails.
pub fn compose(composer: &mut Composer, path: &str, source: &str, defs: &[Def]) -> naga::Module {
    let shader_defs: HashMap<String, ShaderDefValue> =
        defs.iter().map(|(name, value)| (name.to_string(), *value)).collect();
    match composer.make_naga_module(NagaModuleDescriptor {
        source,
        file_path: path,
        shader_type: ShaderType::Wgsl,
        shader_defs,
        ..Default::default()
    }) {
        Ok(module) => module,
        Err(error) => panic!("{path} {defs:?}: {}", error.emit_to_string(composer)),
    }
}

/// A shader of the library whose size depends on the features that it is specialized for.
pub struct SizedShader {
    composer: Composer,
    path: &'static str,
}

impl SizedShader {
    pub fn new(path: &'static str) -> Self {
        Self { composer: composer(), path }
    }

    /// Number of expressions in all of its functions.
    pub fn expressions(&mut self, features: SceneFeatures) -> usize {
        let text = MODULES.iter().find(|(path, _)| *path == self.path).map_or("", |(_, text)| text);
        let defs: Vec<Def> = features.names().into_iter().map(flag).collect();
        let module = compose(&mut self.composer, self.path, text, &defs);
        let functions = module.functions.iter().map(|(_, function)| function);
        let entry_points = module.entry_points.iter().map(|entry_point| &entry_point.function);
        functions.chain(entry_points).map(|function| function.expressions.len()).sum()
    }
}
