//! Mutants of what a frame shows and reports: guards, accumulation, exposure, the limit of bright pixels, and parts of the light.

use super::{Mutant, mutant};

const LIGHT_PARTS: &[&str] = &["sum_to_the_light_of_a_frame"];

pub const MUTANTS: &[Mutant] = &[
    // Guards.
    mutant(
        "raised guards are not reported",
        "view/ray_counter.wgsl",
        "let raised = trace_flags | raised_guards;",
        "let raised = trace_flags;",
        &["guards_are_counted", "every_guard_stops"],
    ),
    mutant(
        "raised guards are not counted",
        "pass/statistics.wgsl",
        "atomicAdd(&counters.guards[bit], 1u);",
        "",
        &["guards_are_counted", "every_guard_stops"],
    ),
    mutant(
        "negative numbers pass the guards",
        "common/guard.wgsl",
        "return is_finite(x) && x >= 0.0;",
        "return is_finite(x);",
        &["guards_pass"],
    ),
    mutant("colors pass the guards", "common/guard.wgsl", "if is_sound_3(w) {", "if true {", &["guards_pass"]),
    // The picture.
    mutant(
        "frames are not added up",
        "pass/resolve.wgsl",
        "sum += radiance[index];",
        "",
        &["samples_add_up", "every_technique_accumulates"],
    ),
    mutant(
        "the picture is not exposed",
        "pass/composite.wgsl",
        "max(sum.a, 1.0) * view.exposure",
        "max(sum.a, 1.0)",
        &["tonemapping_and_exposure"],
    ),
    mutant(
        "a limit from fewer pixels than three",
        "pass/resolve.wgsl",
        "if neighbors < FEWEST_NEIGHBORS {",
        "if neighbors < 1u {",
        &["light_is_limited"],
    ),
    mutant(
        "a limit from pixels of other objects",
        "pass/resolve.wgsl",
        "textureLoad(visibility, neighbor, 0).x == instance",
        "instance == instance",
        &["light_is_limited"],
    ),
    // Diffuse and specular light apart.
    mutant(
        "all lobes that NEE samples are diffuse",
        "restir/pt/domain.wgsl",
        "if path.termination == TERMINATION_NEE && path.length == 2u {",
        "if path.termination == TERMINATION_NEE && path.length == 2u { return vec3<f32>(1.0);",
        LIGHT_PARTS,
    ),
    mutant(
        "the lobe at the reconnection vertex in place of the first",
        "restir/pt/domain.wgsl",
        "var lobe = path.lobe_before;",
        "var lobe = path.lobe_after;",
        LIGHT_PARTS,
    ),
    mutant(
        "light of a surface counts as diffuse",
        "view/light_part.wgsl",
        "fn shown_emission(light: vec3<f32>) -> vec3<f32> {\n    return vec3<f32>(0.0);",
        "fn shown_emission(light: vec3<f32>) -> vec3<f32> {\n    return light;",
        LIGHT_PARTS,
    ),
    mutant(
        "light by samples of the BSDF counts as diffuse",
        "view/light_part.wgsl",
        "return shown_by_lobes(b, wo, s.wi);",
        "return shown_share(vec3<f32>(1.0));",
        LIGHT_PARTS,
    ),
];
