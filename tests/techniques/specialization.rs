//! Shaders that are specialized for the scene give the same picture, bit by bit, as shaders with features that the scene lacks.

use crate::support::{
    app::plant_edits,
    proof::{Bidirectional, Subject},
    reuse_settings::*,
    small_scenes::*,
};
use bevy_restir::{
    Jitter, LightTechniques, SceneFeatures,
    testing::{SharedPipelines, plant_shader_defs, shader_library::ShaderEdit, share_pipelines},
};

/// Features without a part in this comparison.  Some come with bindings or passes of their own, others are settings of the camera.  One
/// rounds differently: absorption multiplies by an exponential of 0.
const LEFT_OUT: SceneFeatures = SceneFeatures::RAY_QUERY
    .union(SceneFeatures::BOUND_TEXTURES)
    .union(SceneFeatures::SUBSURFACE)
    .union(SceneFeatures::ENERGY_COMPENSATION)
    .union(SceneFeatures::SPLIT_LIGHT)
    .union(SceneFeatures::COPIED_MIS)
    .union(SceneFeatures::ATTENUATION);

/// Compares the pictures in a room with mirrors, after some frames of history.
fn check(technique: &str, subject: &impl Subject) {
    let Some(mut rig) = scene(32, mirrors) else { return };
    let mut picture = |features: &[&str]| {
        plant_shader_defs(&mut rig.app, features);
        rig.set(|r| {
            subject.apply_to(r);
            (r.bounces, r.seed, r.jitter) = (4, 1, Jitter::Always);
        });
        rig.picture(4)
    };
    let specialized = picture(&[]);
    let everything = picture(&SceneFeatures::all().difference(LEFT_OUT).names());
    let pixels = specialized.iter().zip(everything.iter());
    let different: Vec<_> = pixels.filter(|((_, a), (_, b))| a != b).collect();
    assert!(different.is_empty(), "{technique}: {} of 1024 pixels, such as {:?}", different.len(), different[0]);
    assert!(specialized.mean() > 0.01, "{technique}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn features_that_the_scene_lacks_change_no_pixel_of_direct_light() {
    check("DI", &di::all_reuse());
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_features_that_the_scene_lacks_change_no_pixel_of_paths() {
    check("PT", &paths::all_reuse());
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn features_that_the_scene_lacks_change_no_pixel_of_light_paths() {
    check("BDPT", &Bidirectional(LightTechniques::Full, paths::all_reuse()));
}

/// Tests share compiled pipelines.  One with a planted error must never serve a test without it, or the other way round.
#[test]
fn shared_pipelines_are_those_of_the_same_shader() {
    const EDIT: ShaderEdit = ShaderEdit {
        module: "restir/reservoir_sampling.wgsl",
        from: "return sum / selected_target;",
        to: "return 1.1 * sum / selected_target;",
    };
    let Some(mut rig) = room_scene(16) else { return };
    let shared = SharedPipelines::default();
    share_pipelines(&mut rig.app, shared.clone());
    rig.set(|r| di::all_reuse().apply_to(r));
    let plain = rig.picture(4);
    plant_shader_defs(&mut rig.app, &["PLANT_SCALED_UCW"]);
    let planted = rig.picture(4);
    assert!(planted.mean() > 1.01 * plain.mean(), "{} and {}", planted.mean(), plain.mean());
    // Both are shared by now.
    let count = shared.count();
    plant_shader_defs(&mut rig.app, &[]);
    assert_eq!(rig.picture(4), plain);
    plant_shader_defs(&mut rig.app, &["PLANT_SCALED_UCW"]);
    assert_eq!(rig.picture(4), planted);
    plant_shader_defs(&mut rig.app, &[]);
    assert_eq!(shared.count(), count, "no pipeline was compiled again");
    plant_edits(&mut rig.app, &[EDIT]);
    let edited = rig.picture(4);
    assert!(edited.mean() > 1.05 * plain.mean(), "{} and {}", edited.mean(), plain.mean());
    plant_edits(&mut rig.app, &[]);
    assert_eq!(rig.picture(4), plain);
}
