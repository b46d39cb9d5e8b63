//! `lab features`: what it takes out of a scene, how it tells a change of the picture from noise, and the program as users call it.

use crate::support::{
    cli::{Folder, asset},
    gltf::Scene,
    scenes::Random,
};
use bevy::{
    light::SunDisk,
    mesh::{morph::MeshMorphWeights, skinning::SkinnedMesh},
    prelude::*,
};
use bevy_restir::{RestirEnvironment, Subsurface};
use change::{Change, Figure};
use list::FEATURES;
use serde_json::json;
use std::fs;

#[path = "../../examples/lab/features/change.rs"]
mod change;
#[path = "../../examples/lab/features/list.rs"]
mod list;

/// A world that has every feature.
fn full_world() -> World {
    let mut world = World::new();
    world.init_resource::<Assets<StandardMaterial>>();
    world.init_resource::<Assets<Mesh>>();
    let texture = Some(Handle::default());
    let layered = StandardMaterial {
        base_color_texture: texture.clone(),
        normal_map_texture: texture.clone(),
        metallic_roughness_texture: texture.clone(),
        emissive_texture: texture.clone(),
        clearcoat_normal_texture: texture,
        emissive: LinearRgba::rgb(0.0, 0.0, 1.0),
        perceptual_roughness: 0.0,
        clearcoat: 1.0,
        anisotropy_strength: 0.5,
        alpha_mode: AlphaMode::Mask(0.5),
        ..default()
    };
    let glass = StandardMaterial {
        specular_transmission: 1.0,
        diffuse_transmission: 0.5,
        thickness: 0.1,
        attenuation_color: Color::linear_rgb(0.5, 1.0, 1.0),
        attenuation_distance: 1.0,
        alpha_mode: AlphaMode::Blend,
        ..default()
    };
    let mesh = Mesh::from(Cuboid::default());
    let colors = vec![[1.0; 4]; mesh.count_vertices()];
    let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh.with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, colors));
    for material in [layered, glass] {
        let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
        world.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(material)));
    }
    world.spawn((Subsurface::default(), SkinnedMesh::default(), MeshMorphWeights::Value { weights: Vec::new() }));
    world.spawn(PointLight { radius: 0.1, ..default() });
    world.spawn(SpotLight::default());
    world.spawn((DirectionalLight::default(), SunDisk::EARTH));
    world.spawn(RectLight::default());
    world.spawn(RestirEnvironment::default());
    world
}

fn names(world: &mut World) -> Vec<&'static str> {
    FEATURES.iter().filter(|feature| feature.place(world).is_some()).map(|feature| feature.name).collect()
}

#[test]
fn what_is_taken_out_of_a_scene_is_gone() {
    let all = names(&mut full_world());
    assert_eq!(all, FEATURES.iter().map(|feature| feature.name).collect::<Vec<_>>(), "the world has all of them");
    for feature in FEATURES {
        let mut world = full_world();
        feature.take_out(&mut world);
        // Some features are parts of others.
        let part = match feature.name {
            "point lights" => "radii of point lights",
            "emission" => "emissive textures",
            _ => "",
        };
        let rest: Vec<&str> = all.iter().copied().filter(|other| *other != feature.name && *other != part).collect();
        assert_eq!(names(&mut world), rest, "without {}", feature.name);
    }
}

#[test]
fn the_place_of_a_feature_counts_materials_and_their_objects() {
    let mut world = full_world();
    let coated = world.query::<&MeshMaterial3d<StandardMaterial>>().iter(&world).next().cloned().expect("an object");
    world.spawn((Mesh3d::default(), coated));
    // Nobody uses this one.
    let unused = StandardMaterial { clearcoat: 1.0, ..default() };
    let _unused = world.resource_mut::<Assets<StandardMaterial>>().add(unused);
    let mut place = |name: &str| FEATURES.iter().find(|feature| feature.name == name)?.place(&mut world);
    assert_eq!(place("clearcoats").as_deref(), Some("1 material of 2 objects"));
    assert_eq!(place("spot lights").as_deref(), Some("1 light"));
    assert_eq!(place("vertex colors").as_deref(), Some("1 mesh"));
}

/// Eight pictures whose pixels have up to half of their light as noise.
fn pictures(random: &mut Random, light: impl Fn(usize) -> f64) -> Vec<Vec<[f64; 3]>> {
    let mut pixel = |i: usize| [light(i); 3].map(|light| light * f64::from(random.range(0.5, 1.5)));
    (0..8).map(|_| (0..256).map(&mut pixel).collect()).collect()
}

#[test]
fn noise_is_no_change_and_a_change_has_its_size() {
    let mut random = Random::new(1);
    let before = pictures(&mut random, |_| 1.0);
    let mut change = |light: fn(usize) -> f64| Change::new(&before, &pictures(&mut random, light));
    let same = change(|_| 1.0);
    assert!(same.light.is_noise() && same.pixels.is_noise() && !same.is_nothing(), "{same:?}");
    let is_near =
        |figure: Figure, wanted: f64| (figure.value - wanted).abs() < 4.0 * figure.error && figure.error < 2.0;
    let darker = change(|_| 0.5);
    assert!(is_near(darker.light, -50.0) && is_near(darker.pixels, 50.0) && !darker.light.is_noise(), "{darker:?}");
    let moved = change(|i| if i % 2 == 0 { 0.5 } else { 1.5 });
    assert!(is_near(moved.light, 0.0) && is_near(moved.pixels, 50.0) && !moved.pixels.is_noise(), "{moved:?}");
    assert!(Change::new(&before, &before).is_nothing());
}

#[test]
fn an_outlier_does_not_move_a_median() {
    let mut values: Vec<f64> = (0..100).map(f64::from).collect();
    values.push(1e9);
    let median = Figure::median(&values);
    // The deviation of uniform values is close enough to that of the estimate: 29 and 37.
    assert!(median.value == 50.0 && (4.0..5.0).contains(&median.error), "{median:?}");
    assert!(!median.is_noise() && Figure::median(&[0.1, -0.2, 0.3, -0.4, 0.2, -0.1]).is_noise());
}

#[test]
fn wrong_arguments_of_lab_features_give_one_line() {
    let folder = Folder::without_gpu("features_wrong");
    let scene = asset("cornell.glb").display().to_string();
    folder.lab(&[]).failed(2, "no command");
    folder.lab(&["features"]).failed(2, "no scene");
    folder.lab(&["features", &scene, "--seeds", "3"]).failed(2, "too few for a variance");
    folder.lab(&["features", "missing.glb", "--out", "tables"]).failed(1, "a scene that is missing");
    folder.lab(&["features", &scene, "--only", "no such name", "--out", "tables"]).failed(2, "no such feature");
}

/// A lamp with brushed metal that nothing lights: without its emission all light is gone, and without the brush no pixel changes.
#[test]
#[ignore = "second tier: ./run test --more"]
fn each_feature_has_its_cost_and_its_part_of_the_light() {
    let Some(folder) = Folder::new("features") else { return };
    let lamp = Scene {
        edit_json: |file| {
            file["materials"][0]["extensions"]["KHR_materials_anisotropy"] = json!({"anisotropyStrength": 0.5});
        },
        ..Scene::default()
    };
    let lamp = folder.gltf("lamp.gltf", &lamp).display().to_string();
    let fixed = ["features", &lamp, "--technique", "di", "--preset", "unbiased", "--size", "16x16", "--out", "tables"];
    let short = ["--warmup", "1", "--frames", "4", "--seeds", "4", "--samples", "8"];
    folder.lab(&[&fixed[..], &short[..]].concat()).succeeded();
    let read = |name: &str| fs::read_to_string(folder.path("tables").join(name)).expect("it was written");
    let (table, text) = (read("features.csv"), read("features.md"));
    let values = |row: &str| {
        let line = table.lines().find(|line| line.starts_with(&format!("lamp,{row},")));
        line.unwrap_or_else(|| panic!("{row}: {table}"))
            .split(',')
            .skip(4)
            .map(|v| v.parse().unwrap_or(f64::NAN))
            .collect()
    };
    let [all, emission, brush]: [Vec<f64>; 3] =
        ["all features", "emission (1 material of 1 object)", "anisotropy (1 material of 1 object)"].map(values);
    // The time and the changes of the light and of the pixels, each with its error; bytes, triangles, lights and the shader.
    assert_eq!(all.len(), 10, "{table}");
    assert!(all[0] > 0.0 && all[6] > 0.0 && all[7..9] == [2.0, 2.0] && all[9] > 1000.0, "{table}");
    assert!((emission[2] + 100.0).abs() < 1e-9 && emission[3] < 1e-9 && emission[8] == 2.0, "{table}");
    assert!(brush[2..6] == [0.0; 4] && brush[7..9] == [0.0, 0.0] && brush[9] > 0.0, "{table}");
    let sentence = text.lines().find(|line| line.starts_with("- lamp: without anisotropy")).expect("a sentence");
    assert!(sentence.contains("the picture stays the same; the shaders lose `ANISOTROPY`"), "{sentence}");
}
