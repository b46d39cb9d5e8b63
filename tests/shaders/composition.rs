//! Every shader composes, validates, translates to SPIR-V, MSL and HLSL, and stays within WebGPU's limits, for sets of scene features
//! in which every pair of features occurs in all combinations.  No GPU is needed.

use crate::support::compose::{Def, TEXTURE_ARRAYS, compose, composer, flag, library, module_name};
use bevy_restir::{
    SceneFeatures,
    testing::{
        features_read_by,
        shader_library::{MODULES, instantiate, is_template},
        shader_templates,
    },
};
use naga::{
    AddressSpace, BinaryOperator, Expression, ImageClass, ScalarKind, TypeInner,
    back::{hlsl, msl, spv},
    valid::{Capabilities, ModuleInfo, ValidationFlags, Validator},
};
use std::collections::HashSet;

fn defs(features: SceneFeatures) -> Vec<Def> {
    features.names().into_iter().map(flag).collect()
}

/// Scene features without which a pass does not exist.
fn required(path: &str) -> SceneFeatures {
    match path {
        "pass/environment.wgsl" => SceneFeatures::ENVIRONMENT | SceneFeatures::ENVIRONMENT_MAP,
        "pass/sss_candidates.wgsl" | "pass/debug_sss.wgsl" | "pass/reuse.wgsl for restir/sss" => {
            SceneFeatures::SUBSURFACE
        }
        _ => SceneFeatures::empty(),
    }
}

/// Shader definitions, besides those of features, that a pass is compiled with.
fn variants(path: &str) -> &'static [Option<&'static str>] {
    match path {
        "pass/reference.wgsl" => &[None, Some("SHOWS_RAYS"), Some("SHOWS_BOUNCES")],
        "pass/resolve.wgsl" => &[None, Some("TO_DENOISER")],
        "pass/debug_counts.wgsl" => &[None, Some("SHOWS_GUARDS")],
        "pass/reuse.wgsl for restir/pt" | "pass/reuse.wgsl for restir/gi" => &[None, Some("PAIRED")],
        _ if path.starts_with("pass/pair_shifts.wgsl for ") => &[None, Some("DEFERS_REPLAYS"), Some("FROM_QUEUE")],
        _ => &[None],
    }
}

/// Sets of features in which every pair of features takes all four combinations.  The choice is greedy over a fixed sequence of
/// candidates.
fn covering_set() -> Vec<SceneFeatures> {
    let bits: Vec<SceneFeatures> = SceneFeatures::TABLE.iter().map(|(feature, _)| *feature).collect();
    let pairs = |set: SceneFeatures| {
        let mut covered = HashSet::new();
        for (i, a) in bits.iter().enumerate() {
            for (j, b) in bits.iter().enumerate().skip(i + 1) {
                covered.insert((i, j, set.contains(*a), set.contains(*b)));
            }
        }
        covered
    };
    let mut chosen = vec![SceneFeatures::empty(), SceneFeatures::all()];
    let mut covered: HashSet<_> = chosen.iter().flat_map(|s| pairs(*s)).collect();
    let wanted = bits.len() * (bits.len() - 1) / 2 * 4;
    let mut state = 0x2545_f491u64;
    while covered.len() < wanted {
        let best = (0..64)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                SceneFeatures::from_bits_truncate(state >> 30)
            })
            .max_by_key(|s| pairs(*s).difference(&covered).count())
            .expect("there are candidates");
        covered.extend(pairs(best));
        chosen.push(best);
    }
    chosen
}

/// Name and text of every pass and of every instance of a template, and the features that its pipelines are specialized for.
fn passes() -> Vec<(String, String, SceneFeatures)> {
    let mut passes = Vec::new();
    for &(path, text) in MODULES {
        let Some(file) = path.strip_prefix("pass/").and_then(|file| file.strip_suffix(".wgsl")) else { continue };
        if !is_template(text) {
            passes.push((path.to_string(), text.to_string(), features_read_by(file, &[])));
            continue;
        }
        for (_, rooms) in shader_templates().into_iter().filter(|(template, _)| file == *template) {
            let name = format!("{path} for {}", rooms[0]);
            passes.push((name, instantiate(text, rooms), features_read_by(file, rooms)));
        }
    }
    passes
}

/// With all features.  Pictures of other tests need few features.
#[test]
fn every_pass_composes_validates_and_translates() {
    check(&covering_set()[1..2]);
}

/// With no feature, and every other set of those that together have every pair of features.
#[test]
#[ignore = "second tier: ./run test --more"]
fn every_pass_composes_validates_and_translates_in_most_pairs_of_features() {
    let sets: Vec<_> = covering_set().into_iter().step_by(2).collect();
    check(&sets);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_pass_composes_validates_and_translates_in_every_pair_of_features() {
    check(&covering_set());
}

/// Pipelines are not specialized for other features, which change nothing.
#[test]
#[ignore = "second tier: ./run test --more"]
fn features_that_a_pass_does_not_read_leave_its_module_as_it_is() {
    let mut composer = composer();
    for (path, text, read) in passes() {
        let [with, without] = [SceneFeatures::all(), SceneFeatures::all() & read]
            .map(|features| compose(&mut composer, &path, &text, &defs(features)));
        assert_eq!(format!("{:?}", with.functions), format!("{:?}", without.functions), "{path}");
    }
    let reads = |file: &str, rooms: &[&str]| features_read_by(file, rooms);
    assert!(reads("reuse", &["restir/pt"]).contains(SceneFeatures::MANY_NEIGHBORS | SceneFeatures::TEXTURES));
    assert!(!reads("path_candidates", &["restir/pt"]).contains(SceneFeatures::MANY_NEIGHBORS));
    assert!(!reads("presample", &[]).intersects(SceneFeatures::CLEARCOAT | SceneFeatures::CONNECTIONS));
    assert_eq!(reads("statistics", &[]), SceneFeatures::COUNT_RAYS);
}

fn check(sets: &[SceneFeatures]) {
    let mut composer = composer();
    for (path, text, read) in passes() {
        let mut seen = HashSet::new();
        for &features in sets {
            let features = features & read | required(&path);
            if !seen.insert(features) {
                continue;
            }
            for variant in variants(&path) {
                let mut defs = defs(features);
                defs.extend(variant.iter().copied().map(flag));
                let module = compose(&mut composer, &path, &text, &defs);
                let what = format!("{path} with {variant:?} {:?}", features.names());
                let ray_queries = features.contains(SceneFeatures::RAY_QUERY);
                let mut capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32;
                capabilities.set(Capabilities::RAY_QUERY, ray_queries);
                capabilities.set(TEXTURE_ARRAYS, features.contains(SceneFeatures::BOUND_TEXTURES));
                let info = Validator::new(ValidationFlags::all(), capabilities)
                    .validate(&module)
                    .unwrap_or_else(|e| panic!("{what}: {e:?}"));
                stays_inside_the_portable_limits(&module, &info, &what);
                takes_no_signed_remainder(&module, &info, &what);
                translates(&module, &info, ray_queries, &what);
            }
        }
    }
}

/// Ray queries need SPIR-V 1.4 and shader model 6.5.
fn translates(module: &naga::Module, info: &ModuleInfo, ray_queries: bool, what: &str) {
    let options = spv::Options { lang_version: (1, if ray_queries { 4 } else { 0 }), ..Default::default() };
    spv::write_vec(module, info, &options, None).unwrap_or_else(|e| panic!("{what}: SPIR-V: {e}"));
    // The pipeline assigns the bindings of the back ends; any will do here.
    let options = msl::Options { fake_missing_bindings: true, lang_version: (2, 4), ..Default::default() };
    msl::write_string(module, info, &options, &msl::PipelineOptions::default())
        .unwrap_or_else(|e| panic!("{what}: MSL: {e}"));
    let mut text = String::new();
    let shader_model = if ray_queries { hlsl::ShaderModel::V6_5 } else { hlsl::ShaderModel::V5_1 };
    // The pipeline sets the length of texture arrays.
    let array = naga::ResourceBinding { group: if ray_queries { 4 } else { 3 }, binding: 0 };
    let target = hlsl::BindTarget { binding_array_size: Some(64), ..Default::default() };
    let binding_map = [(array, target)].into();
    let options = hlsl::Options { fake_missing_bindings: true, shader_model, binding_map, ..Default::default() };
    let pipeline = hlsl::PipelineOptions::default();
    hlsl::Writer::new(&mut text, &options, &pipeline)
        .write(module, info, None)
        .unwrap_or_else(|e| panic!("{what}: HLSL: {e}"));
}

/// Vulkan leaves the remainder undefined where an operand is negative.
fn takes_no_signed_remainder(module: &naga::Module, info: &ModuleInfo, what: &str) {
    let functions = module.functions.iter().map(|(handle, function)| (function, &info[handle]));
    let entry_points = module.entry_points.iter().enumerate().map(|(i, e)| (&e.function, info.get_entry_point(i)));
    for (function, info) in functions.chain(entry_points) {
        for (_, expression) in function.expressions.iter() {
            let Expression::Binary { op: BinaryOperator::Modulo, left, .. } = expression else { continue };
            let kind = info[*left].ty.inner_with(&module.types).scalar_kind();
            assert_ne!(kind, Some(ScalarKind::Sint), "{what}: {:?} has a remainder of signed integers", function.name);
        }
    }
}

/// WebGPU's defaults: 8 storage buffers and 4 storage textures per stage, 16 textures, 16 KiB of workgroup memory, 256 invocations.
fn stays_inside_the_portable_limits(module: &naga::Module, info: &ModuleInfo, what: &str) {
    for (i, entry) in module.entry_points.iter().enumerate() {
        let (mut buffers, mut storage_textures, mut textures, mut workgroup_bytes) = (0, 0, 0, 0);
        for (handle, variable) in module.global_variables.iter() {
            if info.get_entry_point(i)[handle].is_empty() {
                continue;
            }
            let inner = &module.types[variable.ty].inner;
            match variable.space {
                AddressSpace::Storage { .. } => buffers += 1,
                AddressSpace::WorkGroup => workgroup_bytes += inner.size(module.to_ctx()),
                AddressSpace::Handle => match inner {
                    TypeInner::Image { class: ImageClass::Storage { .. }, .. } => storage_textures += 1,
                    TypeInner::Image { .. } => textures += 1,
                    _ => {}
                },
                _ => {}
            }
        }
        let size: u32 = entry.workgroup_size.iter().product();
        assert!(buffers <= 8, "{what}: {} binds {buffers} storage buffers", entry.name);
        assert!(storage_textures <= 4, "{what}: {} binds {storage_textures} storage textures", entry.name);
        assert!(textures <= 16, "{what}: {} binds {textures} textures", entry.name);
        assert!(workgroup_bytes <= 16384, "{what}: {} has {workgroup_bytes} bytes of workgroup memory", entry.name);
        assert!(size <= 256, "{what}: {} has {size} invocations", entry.name);
    }
}

#[test]
fn modules_are_named_by_their_paths() {
    for (path, text) in MODULES.iter().filter(|(path, _)| !path.starts_with("pass/")) {
        let expected = format!("#define_import_path {}", module_name(path));
        assert!(text.lines().any(|line| line == expected), "{path} does not contain {expected}");
    }
}

#[test]
fn every_import_names_a_module_of_the_table() {
    // A mistyped import raises no error while nothing uses it, and at run time the pass then never runs.
    let known: HashSet<String> = library().into_iter().map(|(path, _)| module_name(path)).collect();
    for (path, text) in MODULES {
        let (_, imports, _) = naga_oil::compose::get_preprocessor_data(text);
        for import in imports {
            let module = import.import.as_str();
            if module.starts_with("domain") && path.starts_with("pass/") {
                continue;
            }
            let found = known
                .iter()
                .any(|k| module == k || module.strip_prefix(k.as_str()).is_some_and(|r| r.starts_with("::")));
            assert!(found, "{path} imports {module}");
        }
    }
}

#[test]
fn only_the_tracing_module_names_a_back_end() {
    // A pass that names one back end would trace acceleration structures that do not exist under the other.
    for (path, text) in MODULES.iter().filter(|(path, _)| *path != "trace/trace.wgsl") {
        for backend in ["software", "hardware"] {
            assert!(!text.contains(&format!("#import bevy_restir::trace::{backend}")), "{path} imports {backend}");
        }
    }
}

#[test]
fn only_binding_modules_and_passes_bind() {
    for (path, text) in MODULES {
        // Acceleration structures are bound where they are used, because naga cannot pass them to functions.
        if !path.ends_with("bindings.wgsl") && !path.starts_with("pass/") && *path != "trace/hardware.wgsl" {
            assert!(!text.contains("@group("), "{path} binds");
        }
        assert_eq!(
            text.contains("@compute") || text.contains("@fragment"),
            path.starts_with("pass/"),
            "{path}: entry points belong in pass/"
        );
    }
}

#[test]
fn every_file_below_shaders_is_in_the_table() {
    let root = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("shaders");
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("shaders/ exists").flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(&root).expect("below shaders/").to_string_lossy().replace('\\', "/");
                assert!(MODULES.iter().any(|(m, _)| *m == name), "{name} is not in src/shader_library.rs");
            }
        }
    }
}
