//! Broken files, random scenes and long runs: short forms of `lab broken-files`, `lab fuzz`, `lab soak` and `lab plants`, and files that make
//! a loader panic.

use crate::support::{
    cli::{Folder, asset},
    gltf::Scene,
    scenes::Random,
};
use std::{collections::BTreeMap, fs};

#[path = "../../examples/lab/broken_files/glb.rs"]
#[allow(dead_code, reason = "the program uses more of it")]
mod glb;
#[path = "../../examples/lab/broken_files/images.rs"]
mod images;

/// Fails unless a folder has no files.
fn assert_empty(folder: &Folder, name: &str) {
    let mut files = fs::read_dir(folder.path(name)).expect("there is a folder");
    assert!(files.next().is_none(), "something is left in {name}");
}

/// Makes a folder with models: one that is broken, one with an image in a file of its own, and `textured.glb`.
fn make_models(folder: &Folder) {
    fs::create_dir_all(folder.path("models/inner")).expect("the folder can be written");
    fs::write(folder.path("models/broken.gltf"), "no glTF").expect("the folder can be written");
    let image = folder.path("models/inner/red image.png");
    image::RgbImage::from_pixel(4, 4, image::Rgb([200, 20, 20])).save(image).expect("the folder can be written");
    folder.gltf("models/inner/scene.gltf", &Scene { texture: Some("red%20image.png".into()), ..Scene::default() });
    fs::copy(asset("textured.glb"), folder.path("models/textured.glb")).expect("the folder can be written");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn broken_copies_of_scenes_give_errors_or_pictures() {
    let Some(folder) = Folder::new("broken_files") else { return };
    let run = folder.lab(&["broken-files", "--count", "30", "--size", "8x8", "--out", "broken"]);
    run.succeeded();
    assert!(run.stdout.contains("30 copies, none fails"), "{}", run.stdout);
    assert_empty(&folder, "broken");
    folder.lab(&["broken-files", "missing.glb"]).failed(1, "a file that is missing");
    fs::write(folder.path("no.glb"), b"no scene").expect("the folder can be written");
    folder.lab(&["broken-files", "no.glb"]).failed(1, "a file that is broken already");
    folder.lab(&["broken-files", "--folder", "missing"]).failed(1, "a folder that is missing");
    folder.lab(&["broken-files", "no.glb", "--folder", "."]).failed(2, "files and a folder");
}

/// A short form of `lab broken-files` for every run.
#[test]
fn models_of_a_folder_and_broken_copies_of_them_give_errors_or_pictures() {
    let Some(folder) = Folder::new("models") else { return };
    make_models(&folder);
    let models = ["broken-files", "--folder", "models", "--count", "7", "--size", "8x8", "--list", "--out", "broken"];
    let run = folder.lab(&models);
    run.succeeded();
    assert!(run.stdout.contains("7 copies, none fails"), "{}", run.stdout);
    let outcome = |number: u32, name: &str| {
        let line = run.stdout.lines().find(|line| line.starts_with(&format!("copy {number} of ")));
        let outcome = line.and_then(|line| line.split_once(name)).map(|(_, outcome)| outcome.to_owned());
        outcome.unwrap_or_else(|| panic!("{number}, {name}: {}", run.stdout))
    };
    assert!(outcome(1, "broken.gltf, unchanged: ").contains("broken.gltf"), "an error that names the file");
    assert_eq!(outcome(2, "scene.gltf, unchanged: "), "a picture");
    assert_eq!(outcome(3, "textured.glb, unchanged: "), "a picture");
    for number in 4..=7 {
        assert!(!outcome(number, " (").is_empty(), "the change, and what became of it");
    }
    assert_empty(&folder, "broken");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn models_and_broken_copies_give_errors_or_pictures_in_render() {
    let Some(folder) = Folder::new("in_render") else { return };
    make_models(&folder);
    let models = ["broken-files", "--folder", "models", "--loader", "render", "--count", "10", "--size", "8x8"];
    let run = folder.lab(&[&models[..], &["--list", "--out", "broken"]].concat());
    run.succeeded();
    assert!(run.stdout.contains("10 copies, none fails"), "{}", run.stdout);
    for (name, end) in [("broken.gltf", "error: "), ("scene.gltf", "a picture"), ("textured.glb", "a picture")] {
        let is_right = |line: &str| line.contains(&format!("{name}, unchanged: {end}"));
        assert!(run.stdout.lines().any(is_right), "{name}: {}", run.stdout);
    }
    assert_empty(&folder, "broken");
}

/// Images of broken copies: headers are valid, so that a decoder finds the size itself, and types are not those that the file states.
#[test]
fn images_are_broken_in_the_ways_that_are_named() {
    let mut seen = BTreeMap::new();
    for seed in 0..200 {
        let mut file = glb::rich();
        let name = images::replace(&mut file, &mut Random::new(seed));
        let view = file.json["images"][0]["bufferView"].as_u64().expect("the image has a view") as usize;
        let view = &file.json["bufferViews"][view];
        let number = |field: &str| view[field].as_u64().expect("a number") as usize;
        let [start, length] = ["byteOffset", "byteLength"].map(number);
        seen.insert(name, file.bytes[start..start + length].to_vec());
    }
    assert_eq!(seen.len(), 9, "{:?}", seen.keys());
    let error = |name: &str| image::load_from_memory(&seen[name]).expect_err(name).to_string();
    for name in ["a PNG image without width", "a PNG image without height"] {
        assert!(error(name).contains("dimensions"), "{name}: {}", error(name));
    }
    assert!(!error("a PNG image that no memory holds").contains("CRC"), "the header is valid");
    assert!(!error("half of a PNG image").is_empty());
    for name in ["a JPEG image that is stated as PNG", "half of a JPEG image"] {
        assert_eq!(image::guess_format(&seen[name]).expect("a known type"), image::ImageFormat::Jpeg, "{name}");
    }
    assert!(seen["an image without bytes"].is_empty());

    let mut file = glb::rich();
    file.json.as_object_mut().expect("an object").remove("images");
    images::replace(&mut file, &mut Random::new(1));
    assert_eq!(file.json["images"].as_array().map(Vec::len), Some(1), "a file without images gets one");
    let texture = &file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    assert_eq!(texture["index"], 0, "its material shows it");
}

/// A sampler of an animation whose output has the wrong type makes the loader panic.
#[test]
fn a_loader_that_panics_gives_one_line() {
    let Some(folder) = Folder::new("panic") else { return };
    let edit_json = |json: &mut serde_json::Value| {
        let output = json["animations"][0]["samplers"][0]["output"].as_u64().expect("the scene moves") as usize;
        json["accessors"][output]["type"] = "VEC2".into();
    };
    let scene = folder.gltf("scene.gltf", &Scene { animated: true, edit_json, ..Default::default() });
    let run = folder.render(&scene, &["--size", "8x8", "--frames", "1", "--out", "out.exr"]);
    run.failed(1, "a loader that panics");
    assert!(run.stderr.contains("scene.gltf") && run.stderr.contains("panicked"), "{}", run.stderr);
    assert_eq!(folder.files(), ["scene.gltf"]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn random_scenes_render_and_leave_nothing() {
    let Some(folder) = Folder::new("fuzz") else { return };
    // The reference tracer has the fewest shaders to compile.
    let run = folder.lab(&["fuzz", "--technique", "reference", "--count", "3", "--size", "8x6", "--out", "cases"]);
    run.succeeded();
    assert!(run.stdout.contains("3 cases, none fails"), "{}", run.stdout);
    for seed in 1..=3 {
        let passes = |line: &str| line.starts_with(&format!("case {seed} (Reference, ")) && line.ends_with(": passes");
        assert!(run.stdout.lines().any(passes), "case {seed}: {}", run.stdout);
    }
    assert_empty(&folder, "cases");
}

/// A short form of `lab fuzz` for every run.
#[test]
fn a_random_scene_by_di_renders_and_leaves_nothing() {
    let Some(folder) = Folder::new("fuzz_di") else { return };
    let run = folder.lab(&["fuzz", "--technique", "di", "--count", "1", "--size", "8x6", "--out", "cases"]);
    run.succeeded();
    assert!(run.stdout.lines().any(|line| line.starts_with("case 1 (Di, ")), "{}", run.stdout);
    assert!(run.stdout.contains("1 cases, none fails"), "{}", run.stdout);
    assert_empty(&folder, "cases");
}

/// A short form of `lab soak` for every run, by the technique with the fewest shaders.
#[test]
fn a_short_soak_by_the_reference_finds_nothing() {
    let Some(folder) = Folder::new("short_soak") else { return };
    let run = folder.lab(&["soak", "--frames", "288", "--technique", "reference", "--size", "8x6", "--out", "tables"]);
    run.succeeded();
    assert!(!run.stdout.contains("fault: "), "{}", run.stdout);
    let table = fs::read_to_string(folder.path("tables/soak.csv")).expect("the table was written");
    assert!(table.contains("reference"), "{table}");
}

/// Of the faults of `lab plants`, this one takes the least time.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_planted_leak_is_found() {
    let Some(folder) = Folder::new("plant") else { return };
    let run = folder.lab(&["plants", "--only", "a freed range keeps its last element"]);
    run.succeeded();
    let finding = run.stdout.lines().find(|line| line.starts_with("a freed range")).expect("a line for the fault");
    assert!(finding.contains(": found (reference: table: "), "{finding}");
    assert!(finding.contains("--technique reference"), "the command: {finding}");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_soak_compares_the_halves_of_a_run() {
    let Some(folder) = Folder::new("soak") else { return };
    let run = folder.lab(&["soak", "--frames", "288", "--technique", "di", "--size", "8x6", "--out", "tables"]);
    run.succeeded();
    let table = fs::read_to_string(folder.path("tables/soak.csv")).expect("the table was written");
    for row in ["buffers and textures of the plugin", "heap", "entities", "mean radiance", "failed"] {
        assert!(table.contains(row), "{row}: {table}");
    }
    for wrong in [["soak", "--frames", "287"], ["soak", "--technique", "none"], ["broken-files", "--count", "0"]] {
        folder.lab(&wrong).failed(2, &format!("{wrong:?}"));
    }
}
