//! Passes skip work that cannot change the picture.  Without these shortcuts, which edits of the shaders take out, pictures of the same seed
//! are the same bit by bit.

use crate::support::{
    app::plant_edits,
    proof::{AllLight, Bidirectional, Subject},
    reuse_settings::{di, paths},
    small_scenes::*,
};
use bevy_restir::{Direct, LightTechniques, Mis, Paths, Reuse, testing::shader_library::ShaderEdit};

const fn edit(module: &'static str, from: &'static str, to: &'static str) -> ShaderEdit {
    ShaderEdit { module, from, to }
}

/// MIS weights of samples without a target at the pixel.
const TARGETS: ShaderEdit = edit("pass/reuse.wgsl", "if matters && ", "if ");
/// Surfaces of which only the emission counts.
const EMISSION: ShaderEdit = edit(
    "scene/material.wgsl",
    "return max_component(materials[instances[instance].material].emissive) > 0.0;",
    "return true;",
);
/// BSDF densities of candidates without a target.
const DENSITIES: ShaderEdit =
    edit("restir/di/initial_candidates.wgsl", "if candidate.pmf > 0.0 && value > 0.0 {", "if candidate.pmf > 0.0 {");
/// The surface of a pixel whose shifts are stored.
const RECEIVER: ShaderEdit =
    edit("pass/reuse.wgsl", "var r: Receiver;\n    return r;", "return receiver_of(ids, pixel, false);");
/// Paths of fewer scattering events than the domain has.
const SHORT_PATHS: ShaderEdit =
    edit("pass/path_candidates.wgsl", "view.bounces + 1u < SHORTEST_LENGTH", "view.bounces == 0u");
/// The last vertex of a light sub-path that the camera does not see.
const LAST_VERTEX: ShaderEdit = edit(
    "pass/light_paths.wgsl",
    "let last = select(last_connected, view.bounces, settings.splats > 0u);",
    "let last = view.bounces;",
);

/// Compares the fourth frame of a subject with that of the edited shaders, which trace more rays if the shortcuts save some.
fn check(subject: &dyn Subject, bounces: u32, edits: &[ShaderEdit], saves_rays: bool) {
    let Some(mut rig) = room_scene(64) else { return };
    let mut picture = |edits: &[ShaderEdit]| {
        plant_edits(&mut rig.app, edits);
        rig.set(|r| {
            subject.apply_to(r);
            (r.bounces, r.accumulate, r.seed) = (bounces, false, 1);
        });
        let pixels = rig.picture(4).pixels;
        // Counters come back some frames late.
        rig.set(|r| r.reset = true);
        rig.frames(6);
        (pixels, rig.report().rays)
    };
    let (pixels, rays) = picture(&[]);
    let (pixels_of_edited, rays_of_edited) = picture(edits);
    let differing = pixels.iter().zip(&pixels_of_edited).filter(|(a, b)| a != b).count();
    assert_eq!(differing, 0);
    eprintln!("{rays} rays, {rays_of_edited} without shortcuts");
    assert_eq!(rays < rays_of_edited, saves_rays);
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn targets_that_do_not_matter_trace_no_rays() {
    let balance =
        Direct { reuse: Reuse { mis: Mis::Balance, ..di::across_edges(Mis::Balance).reuse }, ..di::all_reuse() };
    check(&balance, 1, &[TARGETS, EMISSION, DENSITIES], true);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_surfaces_of_paths_are_built_where_they_matter() {
    let reuse = Reuse { paired: true, ..paths::all_reuse().reuse };
    let paths = Paths { separate_direct_light: true, reuse, ..paths::all_reuse() };
    check(&paths, 3, &[TARGETS, EMISSION, DENSITIES, RECEIVER], false);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_of_one_bounce_costs_nothing() {
    check(&AllLight::Gi(di::all_reuse(), paths::all_reuse()), 1, &[SHORT_PATHS], true);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_light_sub_paths_end_with_their_last_connection() {
    check(&Bidirectional(LightTechniques::Full, paths::all_reuse()), 3, &[TARGETS, EMISSION], false);
    check(&Bidirectional(LightTechniques::NoLightTracing, paths::all_reuse()), 3, &[LAST_VERTEX], true);
}
