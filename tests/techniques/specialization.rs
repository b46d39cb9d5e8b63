//! Shaders that are specialized for the scene give the same picture, bit by bit, as shaders with features that the scene lacks, and such features
//! take no memory.

use crate::support::{
    app::*,
    bodies::{spawn_skinned, tube},
    proof::{Bidirectional, Indirect, Subject},
    reuse_settings::*,
    small_scenes::*,
};
use bevy::{mesh::UvChannel, prelude::*};
use bevy_restir::{
    Denoiser, Jitter, LightTechniques, Reuse, SceneFeatures, Subsurface,
    testing::{SharedPipelines, plant_shader_defs, shader_library::ShaderEdit, share_pipelines},
};
use std::collections::BTreeSet;

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
#[ignore = "minutes: ./run test --full"]
fn full_length_features_that_the_scene_lacks_change_no_pixel_of_indirect_light() {
    check("GI", &Indirect(di::all_reuse(), paths::all_reuse()));
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

/// The memory of direct light in any scene.
const ALWAYS: [&str; 18] = [
    "acceleration structures",
    "counters",
    "counts of pixels",
    "depth",
    "di light",
    "di reservoirs",
    "di settings",
    "instances",
    "last visibility",
    "light subsets",
    "lights",
    "materials",
    "radiance",
    "scene uniforms",
    "triangles",
    "vertices",
    "view uniforms",
    "visibility",
];

/// A feature, what brings it, and its memory.
type Optional = (&'static str, fn(&mut Rig), &'static [&'static str]);

/// All other memory of direct light.
const OPTIONAL: [Optional; 12] = [
    (
        "textures",
        |rig| {
            let image = rig.add::<Image>(texture(4, 4, |x, y| [60 * x as u8, 60 * y as u8, 50, 255]));
            let material = StandardMaterial { base_color_texture: Some(image), ..lambert(0.8) };
            rig.spawn(square(0.5), material, Transform::default());
        },
        &["texture table", "texture atlas"],
    ),
    (
        "second texture coordinates",
        |rig| {
            let image = rig.add::<Image>(texture(2, 2, |x, y| [100 * x as u8, 100 * y as u8, 50, 255]));
            let (base_color_texture, base_color_channel) = (Some(image), UvChannel::Uv1);
            let material = StandardMaterial { base_color_texture, base_color_channel, ..lambert(0.8) };
            let mesh = square(0.5).with_inserted_attribute(Mesh::ATTRIBUTE_UV_1, vec![[0.7f32, 0.7]; 4]);
            rig.spawn(mesh, material, Transform::default());
        },
        &["second texture coordinates"],
    ),
    (
        "vertex colors",
        |rig| {
            let mesh = square(0.5).with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, vec![[0.2f32, 0.5, 1.0, 1.0]; 4]);
            rig.spawn(mesh, lambert(0.8), Transform::default());
        },
        &["vertex colors"],
    ),
    (
        "bodies that bend",
        |rig| {
            spawn_skinned(rig, "tube", tube(), lambert(0.8));
        },
        &["rigs", "bodies", "poses", "boxes of bodies"],
    ),
    ("an environment with an image", |rig| environment_of(rig, true), &["environment importance"]),
    (
        "translucent objects",
        |rig| {
            let ball = rig.spawn(Sphere::new(0.4).mesh().uv(16, 10), lambert(0.8), Transform::default());
            rig.insert(ball, Subsurface { mean_free_path: Vec3::splat(0.1), weight: 1.0 });
        },
        &["subsurface", "sss settings", "sss reservoirs", "sss light"],
    ),
    (
        "the denoiser",
        |rig| rig.set(|restir| restir.denoiser = Denoiser::ON),
        &["denoiser settings", "denoiser light", "denoiser guides", "denoiser means"],
    ),
    (
        "mirrors with the denoiser",
        |rig| {
            rig.set(|restir| restir.denoiser = Denoiser::ON);
            rig.spawn(square(0.5), shiny(Color::WHITE, 0.0, 1.0), Transform::default());
        },
        &["optical images"],
    ),
    ("energy compensation", |rig| rig.set(|restir| restir.energy_compensation = true), &["specular albedo"]),
    ("pairs", |rig| rig.set(|restir| restir.direct.reuse = Reuse::DIRECT), &["pair masks", "pair shifts"]),
    ("fewer traced pixels", |rig| rig.set(|restir| restir.resolution_scale = 0.5), &["shown surfaces"]),
    ("bands", |rig| rig.set(|restir| restir.research.rays_per_dispatch = 1), &["uniforms of bands"]),
];

/// Memory of paths and light paths, which tests of their techniques look at.
const OF_OTHER_TECHNIQUES: [&str; 7] = [
    "pt reservoirs",
    "gi reservoirs",
    "bdpt reservoirs",
    "splats reservoirs",
    "light vertices",
    "light map",
    "replay queue",
];

/// A room with direct light, with a feature.
fn room_with(add: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = room_scene(16)?;
    rig.set(|restir| di::all_reuse().apply_to(restir));
    add(&mut rig);
    rig.until_ready();
    // Bodies are posed, and reported, some frames later.
    rig.frames(4);
    Some(rig)
}

/// Names of the buffers and textures that exist, without those of ray queries.
fn memory(rig: &Rig) -> BTreeSet<&'static str> {
    let memory = rig.report().memory;
    memory.into_iter().map(|(name, _)| name).filter(|name| *name != "top-level instances").collect()
}

#[test]
fn features_that_the_scene_lacks_take_no_memory() {
    let Some(rig) = room_with(|_| ()) else { return };
    let found = memory(&rig);
    let optional = OPTIONAL.iter().flat_map(|(.., names)| names.iter()).chain(&OF_OTHER_TECHNIQUES);
    let superfluous: Vec<_> = optional.filter(|name| found.contains(*name)).collect();
    assert!(superfluous.is_empty(), "{superfluous:?}");
    assert_eq!(found, BTreeSet::from(ALWAYS), "a new name belongs to one of the lists");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn features_that_come_bring_their_memory() {
    for (feature, add, names) in OPTIONAL {
        let Some(mut rig) = room_with(add) else { return };
        let found = memory(&rig);
        let missing: Vec<_> = names.iter().filter(|name| !found.contains(*name)).collect();
        assert!(missing.is_empty(), "{feature}: {missing:?} is missing in {found:?}");
        rig.assert_sound();
    }
}
