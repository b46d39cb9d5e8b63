//! Broken files, random scenes and long runs: short forms of `lab broken-files`, `lab fuzz`, `lab soak` and `lab plants`, and files that make
//! a loader panic.

use crate::support::{cli::Folder, gltf::Scene};
use std::fs;

#[test]
#[ignore = "second tier: ./run test --more"]
fn broken_copies_of_scenes_give_errors_or_pictures() {
    let Some(folder) = Folder::new("broken_files") else { return };
    let run = folder.lab(&["broken-files", "--count", "30", "--size", "8x8", "--out", "broken"]);
    run.succeeded();
    assert!(run.stdout.contains("30 copies, none fails"), "{}", run.stdout);
    assert!(fs::read_dir(folder.path("broken")).expect("a folder").next().is_none(), "no copy is left");
    folder.lab(&["broken-files", "missing.glb"]).failed(1, "a file that is missing");
    fs::write(folder.path("no.glb"), b"no scene").expect("the folder can be written");
    folder.lab(&["broken-files", "no.glb"]).failed(1, "a file that is broken already");
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
    assert!(fs::read_dir(folder.path("cases")).expect("a folder").next().is_none(), "no case fails");
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
