//! Rust and WGSL agree on the numbers that `gpu_layout` does not hold, and the limits of Rust fit the bit fields, stacks and random streams of
//! the shaders.

use crate::support::bodies::{sheet, tube};
use bevy::mesh::Mesh;
use bevy_restir::{
    DebugView, Restir,
    testing::{
        accel::blas::MAX_TLAS_DEPTH,
        geometry::{rig::RigTables, triangulate::triangles_of},
        gpu_layout::{NONE, SPLAT_RESERVOIR_SIZE, SPLATS_OF_A_PATH},
        light::alias_table::{ENVIRONMENT_LIMIT, ENVIRONMENT_LIMIT_BESIDE_SUNS_AND_LAMPS},
        shader_library::MODULES,
        shared_numbers::*,
    },
};
use bevy_restir_support::fields::values;
use std::collections::HashMap;

fn text_of(path: &str) -> &'static str {
    MODULES.iter().find(|(p, _)| *p == path).expect("the module is in the table").1
}

/// The value of a literal such as `12u` or `0x1fu`.
fn literal(text: &str) -> Option<u32> {
    let digits = text.strip_suffix('u')?;
    match digits.strip_prefix("0x") {
        Some(hex) => u32::from_str_radix(hex, 16).ok(),
        None => digits.parse().ok(),
    }
}

/// Names and values of the `u32` constants that are literals, under every `#ifdef`.  The text is searched, because templates of passes do not
/// compose by themselves.
fn constants(text: &'static str) -> impl Iterator<Item = (&'static str, u32)> {
    text.lines().filter_map(|line| {
        let (name, value) = line.strip_prefix("const ")?.split_once(": u32 = ")?;
        Some((name, literal(value.split_once(';')?.0)?))
    })
}

/// The constants of a module whose names begin with `prefix`, in order.
fn constants_with(prefix: &str, path: &str) -> Vec<(&'static str, u32)> {
    constants(text_of(path)).filter(|(name, _)| name.starts_with(prefix)).collect()
}

fn value(name: &str, path: &str) -> u32 {
    let found = constants(text_of(path)).find(|(n, _)| *n == name);
    found.unwrap_or_else(|| panic!("{path} has no constant {name}")).1
}

/// The constant of a debug view: `DEBUG_PATH_ENDS` for `PathEnds`.
fn constant_of(view: DebugView) -> String {
    let mut name = String::from("DEBUG");
    for letter in format!("{view:?}").chars() {
        if letter.is_uppercase() {
            name.push('_');
        }
        name.push(letter.to_ascii_uppercase());
    }
    name
}

#[test]
fn debug_views_have_the_same_numbers_in_rust_and_wgsl() {
    let numbers: HashMap<String, u32> =
        values::<DebugView>().into_iter().map(|view| (constant_of(view), view as u32)).collect();
    let mut count = 0;
    for (path, text) in MODULES {
        for (name, number) in constants(text).filter(|(name, _)| name.starts_with("DEBUG_")) {
            assert_eq!(numbers.get(name), Some(&number), "{path}: {name}");
            count += 1;
        }
    }
    assert!(count > 20, "only {count} constants of debug views were found");
}

#[test]
fn textures_have_the_same_flags_and_encodings_in_rust_and_wgsl() {
    let flags = [
        ("TEXTURE_CLAMP_U", CLAMP_U),
        ("TEXTURE_MIRROR_U", MIRROR_U),
        ("TEXTURE_CLAMP_V", CLAMP_V),
        ("TEXTURE_MIRROR_V", MIRROR_V),
        ("TEXTURE_NEAREST", NEAREST),
        ("TEXTURE_SRGB", SRGB),
        ("TEXTURE_SHARED_EXPONENT", SHARED_EXPONENT),
        ("TEXTURE_SECOND_UV", SECOND_UV),
        ("TEXTURE_LEVELS_SHIFT", LEVELS_SHIFT),
        ("TEXTURE_TWO_COMPONENTS", TWO_COMPONENTS),
        ("TEXTURE_BOUND", BINDLESS),
    ];
    assert_eq!(constants_with("TEXTURE_", "scene/texture.wgsl"), flags);
    let encodings = [
        ("ENCODING_LINEAR", Encoding::Linear as u32),
        ("ENCODING_SRGB", Encoding::Srgb as u32),
        ("ENCODING_SHARED_EXPONENT", Encoding::SharedExponent as u32),
    ];
    assert_eq!(constants_with("ENCODING_", "common/texel.wgsl"), encodings);
}

#[test]
fn tables_and_dispatches_have_the_same_sizes_in_rust_and_wgsl() {
    assert_eq!(value("ELEMENTS_PER_ROW", "scene/bindings.wgsl"), ELEMENTS_PER_ROW);
    assert_eq!(value("WORKGROUP", "pass/deform.wgsl"), BODY_WORKGROUP);
    assert_eq!(4 * u64::from(value("QUEUE_HEADER", "pass/pair_shifts.wgsl")), REPLAY_QUEUE_HEADER);
    assert_eq!(4 * u64::from(value("WORDS", "restir/splats/reservoir.wgsl")), SPLAT_RESERVOIR_SIZE);
    // With MANY_NEIGHBORS, and without.
    let inputs = [MAX_PAIR_LAYERS + 1, FEW_INPUTS].map(|inputs| ("MAX_INPUTS", inputs));
    assert_eq!(constants_with("MAX_INPUTS", "restir/mis.wgsl"), inputs);
}

/// Number of vertices of a mesh that bends, and the places of its tables.
fn rig_of(mesh: &Mesh) -> (u32, RigTables) {
    let geometry = triangles_of(mesh).expect("the mesh has triangles");
    let vertices: Vec<u32> = (0..geometry.vertices.len() as u32).collect();
    let rig = geometry.rig.as_ref().expect("the mesh bends").pack(&geometry, &vertices, &[]);
    (vertices.len() as u32, rig.tables)
}

#[test]
fn rigs_are_packed_as_shaders_read_them() {
    let path = "deformation/pose.wgsl";
    let (vertex_count, skin) = rig_of(&tube());
    assert_eq!((skin.influences, skin.target_count), (0, 0));
    assert_eq!(skin.targets, vertex_count * value("INFLUENCE_WORDS", path));
    let (vertex_count, morphs) = rig_of(&sheet());
    assert_eq!((morphs.influences, morphs.targets, morphs.target_count), (NONE, 0, 2));
    assert_eq!(morphs.levels, 2 * vertex_count * value("DISPLACEMENT_WORDS", path));
}

/// The greatest value of a field of `PackedPath::structure`, from the line that unpacks it.
fn mask_of(field: &str) -> u32 {
    let start = format!("s.{field} = (p.structure >> ");
    let line = text_of("restir/stored_path.wgsl").lines().find(|line| line.trim_start().starts_with(&start));
    let mask = line.and_then(|line| line.rsplit_once("& ")?.1.strip_suffix(';'));
    mask.and_then(literal).unwrap_or_else(|| panic!("no line unpacks {field}"))
}

#[test]
fn the_longest_paths_fit_their_bits() {
    // The vertex on the light comes behind the last scattering event.
    for field in ["length", "reconnection"] {
        assert!(Restir::MAX_BOUNCES < mask_of(field), "{field}");
    }
    // An entry of the light map stores the number of scattering events less 1, and the index of the next entry plus 1.
    let link_bits = value("LINK_BITS", "restir/bdpt/light_map.wgsl");
    assert!(Restir::MAX_BOUNCES <= 1u32 << (32 - link_bits));
    assert!(u64::from(SPLATS_OF_A_PATH) * MAX_LIGHT_PATHS < 1u64 << link_bits);
    // A connection stores the number of scattering events of its light sub-path, and the index of the sub-path.
    let sub_path_bits = value("SUB_PATH_BITS", "restir/connection/connection.wgsl");
    assert!(Restir::MAX_BOUNCES < 1u32 << (32 - sub_path_bits));
    assert!(MAX_LIGHT_PATHS <= 1u64 << sub_path_bits);
}

#[test]
fn the_tree_over_lights_fits_its_stack() {
    assert!(value("STACK_SIZE", "light/analytic_area_light.wgsl") >= MAX_TLAS_DEPTH);
}

/// The streams of reuse are those that `iteration_stream` in `shaders/restir/iteration_rng.wgsl` returns.
#[test]
fn no_two_uses_share_a_stream_of_random_numbers() {
    /// More domains than any technique has.
    const DOMAINS: u32 = 8;
    let path = "common/rng.wgsl";
    let streams_per_domain = value("STREAMS_PER_DOMAIN", path);
    let mut used = HashMap::new();
    for (name, first) in constants_with("STREAM_", path) {
        let is_of_reuse = ["STREAM_REUSE", "STREAM_PAIRS"].contains(&name);
        let (domains, iterations) = if is_of_reuse { (DOMAINS, MAX_ITERATIONS as u32) } else { (1, 1) };
        for domain in 0..domains {
            for iteration in 0..iterations {
                let stream = first + domain * streams_per_domain + iteration;
                assert_eq!(used.insert(stream, name), None, "{name} uses stream {stream} of another use");
            }
        }
    }
    assert!(used.len() as u32 > 2 * DOMAINS, "only {} streams were found", used.len());
}

#[test]
fn the_least_probability_of_the_environment_is_below_the_greatest_ones() {
    let mut lines = text_of("light/select.wgsl").lines();
    let number = lines.find_map(|line| line.strip_prefix("const PROBABILITY_MIN: f32 = ")?.strip_suffix(';'));
    let least: f32 = number.and_then(|number| number.parse().ok()).expect("the constant is a literal");
    for greatest in [ENVIRONMENT_LIMIT, ENVIRONMENT_LIMIT_BESIDE_SUNS_AND_LAMPS] {
        assert!(least < greatest, "{least} and {greatest}");
    }
}
