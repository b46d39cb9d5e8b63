//! The `render` program as scripts call it: its files, its messages, and its exit codes.

use crate::support::{cli::*, gltf};
use bevy_restir::testing::guards::GUARDS;
use serde_json::Value;
use std::{fs, path::PathBuf};

#[test]
fn exit_code_0_means_that_the_picture_was_written() {
    let Some(folder) = Folder::new("written") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    for name in ["a.exr", "a.png"] {
        let small = ["--technique", "reference", "--size", "33x17", "--frames", "2", "--out", name];
        let run = folder.render(&scene, &small);
        run.succeeded();
        assert!(run.stderr.is_empty(), "{}", run.stderr);
        assert!(folder.path(name).is_file());
    }
    let exr = Exr::read(&folder.path("a.exr"));
    assert_eq!((exr.width, exr.height), (33, 17));
    assert_eq!(exr.channels, ["B", "G", "R"], "32-bit float RGB");
    assert!(exr.pixels.iter().flatten().all(|c| c.is_finite()));
    // The quad of the scene emits (1, 2, 3) in the middle; the rest is black.
    assert_eq!((exr.at(16, 8), exr.at(0, 0)), ([1.0, 2.0, 3.0], [0.0; 3]));
    let png = image::open(folder.path("a.png")).expect("the picture can be read").to_rgb8();
    assert_eq!(png.dimensions(), (33, 17));
    assert!(png.get_pixel(16, 8)[0] > 100 && png.get_pixel(0, 0)[0] < 10);
    assert_eq!(folder.files(), ["a.exr", "a.png", "scene.gltf"], "there are no other files");
}

#[test]
fn the_default_technique_is_pt() {
    let Some(folder) = Folder::new("defaults") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    // Without the passes that other tests do not share.
    let few = ["--set", "paths.reuse.spatial_samples=0", "--set", "paths.separate_direct_light=false"];
    let fixed = ["--size", "8x8", "--stats", "stats.json", "--set", "energy_compensation=false"];
    folder.render(&scene, &[&fixed[..], &few].concat()).succeeded();
    let stats: Value = serde_json::from_slice(&fs::read(folder.path("stats.json")).expect("written")).expect("JSON");
    assert_eq!(
        (&stats["technique"], &stats["preset"], &stats["frames"]),
        (&"pt".into(), &"balanced".into(), &16.into())
    );
    // The passes are those of the mean, which has no denoiser.
    let passes = stats["passes"].as_array().expect("a list");
    assert!(passes.iter().any(|pass| pass["name"] == "resolve"), "{passes:?}");
    assert_eq!(folder.files(), ["out.png", "scene.gltf", "stats.json"]);
}

#[test]
fn broken_files_give_one_line_and_exit_code_1() {
    let Some(folder) = Folder::new("broken") else { return };
    let sound = fs::read(asset("cornell.glb")).expect("the scene is there");
    let scene = gltf::Scene::default();
    let files = [
        ("missing.glb", None),
        ("empty.glb", Some(Vec::new())),
        ("garbage.glb", Some((0..2000u32).map(|i| ((i * 7919) >> 3) as u8).collect())),
        ("header.glb", Some(sound[..20].to_vec())),
        ("truncated.glb", Some(sound[..sound.len() / 2].to_vec())),
        ("garbage.gltf", Some(b"not json at all".to_vec())),
        ("cut.gltf", Some(scene.json().into_bytes()[..200].to_vec())),
        ("no_buffer.gltf", Some(scene.json().replace("data:application/octet-stream;base64,", "absent/").into_bytes())),
        ("no_scene.gltf", Some(br#"{"asset":{"version":"2.0"}}"#.to_vec())),
        ("picture.txt", Some(b"hello".to_vec())),
    ];
    for (name, content) in files {
        if let Some(content) = &content {
            fs::write(folder.path(name), content).expect("the folder can be written");
        }
        let run = folder.render(&folder.path(name), &["--size", "8x8", "--frames", "1", "--out", "out.exr"]);
        run.failed(1, name);
        assert!(run.stderr.contains(name), "{name}: the line names the file: {}", run.stderr);
        if content.is_some() {
            fs::remove_file(folder.path(name)).expect("the file exists");
        }
        assert!(folder.files().is_empty(), "{name} left {:?}", folder.files());
    }
    let run = folder.render(&folder.path("."), &["--out", "out.exr"]);
    run.failed(1, "a folder");
}

/// Valid JSON that describes a subtly wrong scene: each row changes the buffer or the file.
fn subtly_wrong() -> Vec<(&'static str, gltf::Scene)> {
    fn float(bytes: &mut [u8], index: usize, value: f32) {
        bytes[4 * index..4 * index + 4].copy_from_slice(&value.to_le_bytes());
    }
    fn index(bytes: &mut [u8], place: usize, value: u16) {
        bytes[80 + 2 * place..82 + 2 * place].copy_from_slice(&value.to_le_bytes());
    }
    let bytes = |edit_bytes| gltf::Scene { edit_bytes, ..Default::default() };
    let json = |edit_json| gltf::Scene { edit_json, ..Default::default() };
    vec![
        ("a position of NaN", bytes(|b| float(b, 0, f32::NAN))),
        ("infinite positions", bytes(|b| (0..12).for_each(|i| float(b, i, f32::INFINITY)))),
        ("positions of 1e38", bytes(|b| (0..12).for_each(|i| float(b, i, 1e38)))),
        ("a texture coordinate of NaN", bytes(|b| float(b, 12, f32::NAN))),
        ("an index out of range", bytes(|b| index(b, 5, 4))),
        ("indices out of range", bytes(|b| (0..6).for_each(|i| index(b, i, u16::MAX - 1)))),
        ("more positions than bytes", json(|f| f["accessors"][0]["count"] = 400.into())),
        ("more indices than bytes", json(|f| f["accessors"][2]["count"] = 600.into())),
        ("more positions than the view has", json(|f| f["accessors"][0]["count"] = 6.into())),
        ("no positions", json(|f| f["accessors"][0]["count"] = 0.into())),
        ("fewer positions than texture coordinates", json(|f| f["accessors"][0]["count"] = 3.into())),
        ("fewer texture coordinates than positions", json(|f| f["accessors"][1]["count"] = 2.into())),
        ("no indices", json(|f| f["accessors"][2]["count"] = 0.into())),
        ("an incomplete triangle", json(|f| f["accessors"][2]["count"] = 5.into())),
        ("positions of two numbers", json(|f| f["accessors"][0]["type"] = "VEC2".into())),
        ("integer positions", json(|f| f["accessors"][0]["componentType"] = 5123.into())),
        ("indices that are floats", json(|f| f["accessors"][2]["componentType"] = 5126.into())),
        ("a missing accessor", json(|f| f["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9.into())),
        (
            "texture coordinates as normals",
            json(|f| f["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 1.into()),
        ),
        ("indices as positions", json(|f| f["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 2.into())),
        ("no attributes", json(|f| f["meshes"][0]["primitives"][0]["attributes"] = serde_json::json!({}))),
        ("no primitives", json(|f| f["meshes"][0]["primitives"] = serde_json::json!([]))),
        ("lines", json(|f| f["meshes"][0]["primitives"][0]["mode"] = 1.into())),
        ("a missing material", json(|f| f["meshes"][0]["primitives"][0]["material"] = 7.into())),
        ("a missing mesh", json(|f| f["nodes"][0]["mesh"] = 7.into())),
        ("a missing node", json(|f| f["scenes"][0]["nodes"] = serde_json::json!([0, 1, 7]))),
        ("a view beyond the buffer", json(|f| f["bufferViews"][0]["byteOffset"] = 1000.into())),
        ("a view of no bytes", json(|f| f["bufferViews"][0]["byteLength"] = 0.into())),
        ("a buffer that is too short", json(|f| f["buffers"][0]["byteLength"] = 1000.into())),
        ("a scale of 0", json(|f| f["nodes"][0]["scale"] = serde_json::json!([0, 0, 0]))),
        ("a scale of 1e38", json(|f| f["nodes"][0]["scale"] = serde_json::json!([1e38, 1e38, 1e38]))),
        ("a translation beyond f32", json(|f| f["nodes"][0]["translation"] = serde_json::json!([1e60, 0, 0]))),
        ("a rotation of 0", json(|f| f["nodes"][0]["rotation"] = serde_json::json!([0, 0, 0, 0]))),
        (
            "a singular matrix",
            json(|f| f["nodes"][0]["matrix"] = serde_json::json!([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1])),
        ),
        ("a negative emission", json(|f| f["materials"][0]["emissiveFactor"] = serde_json::json!([-1, -1, -1]))),
        (
            "a base color of 1e38",
            json(|f| {
                f["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = serde_json::json!([1e38, 1e38, 1e38, -1])
            }),
        ),
        ("a roughness of -1", json(|f| f["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = (-1).into())),
        ("a field of view of 0", json(|f| f["cameras"][0]["perspective"]["yfov"] = 0.0.into())),
        ("a near plane of 0", json(|f| f["cameras"][0]["perspective"]["znear"] = 0.0.into())),
    ]
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn subtly_wrong_scenes_give_a_finite_picture_or_one_line_of_error() {
    let Some(folder) = Folder::new("subtle") else { return };
    for (name, scene) in subtly_wrong() {
        let path = folder.gltf("scene.gltf", &scene);
        let run =
            folder.render(&path, &["--size", "8x8", "--frames", "1", "--technique", "reference", "--out", "out.exr"]);
        if run.code != 0 {
            // Bevy's loader panics on some of them, and reports that as a failure to load.
            assert_eq!(run.code, 1, "{name}: {}", run.stderr);
            let last = run.stderr.trim_end().lines().last().unwrap_or_default();
            assert!(last.starts_with("error: ") && last.contains("scene.gltf"), "{name}: {}", run.stderr);
            assert_eq!(folder.files(), ["scene.gltf"], "{name}");
            continue;
        }
        let pixels = Exr::read(&folder.path("out.exr")).pixels;
        assert!(pixels.iter().flatten().all(|c| c.is_finite()), "{name}: {}", run.stderr);
        assert!(!run.stderr.contains("panicked"), "{name}: {}", run.stderr);
        fs::remove_file(folder.path("out.exr")).expect("the file exists");
    }
}

#[test]
fn a_missing_texture_gives_a_warning_and_a_picture_of_the_rest() {
    let Some(folder) = Folder::new("texture") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene { texture: Some("absent.png".into()), ..Default::default() });
    let arguments = ["--technique", "reference", "--size", "9x9", "--frames", "1", "--out", "out.exr"];
    let run = folder.render(&scene, &arguments);
    run.succeeded();
    assert!(run.stderr.contains("absent.png"), "a warning names the file: {}", run.stderr);
    assert_eq!(Exr::read(&folder.path("out.exr")).at(4, 4), [1.0, 2.0, 3.0]);
    // The file exists but is not an image.
    fs::write(folder.path("absent.png"), b"no image").expect("the folder can be written");
    let run = folder.render(&scene, &arguments);
    run.succeeded();
    assert!(run.stderr.contains("absent.png"), "{}", run.stderr);
}

#[test]
fn wrong_arguments_give_exit_code_2_and_write_nothing() {
    let Some(folder) = Folder::new("arguments") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    let in_folder = scene.to_str().expect("the path is text");
    let wrong: [&[&str]; 31] = [
        &["--size", "0x10"],
        &["--size", "10"],
        &["--size", "10x-3"],
        &["--size", "99999x10"],
        &["--frames", "0"],
        &["--frames", "many"],
        &["--bounces", "-1"],
        &["--technique", "magic"],
        &["--preset", "perfect"],
        &["--env", "1,2"],
        &["--env", "1,nan,2"],
        &["--env", "-1,0,0"],
        &["--env", "sky.txt"],
        &["--ev100", "nan"],
        &["--aov", "depth"],
        &["--aov", "depth=d.png"],
        &["--aov", "beauty=d.exr"],
        &["--aov", "diffuse=d.png"],
        &["--time-budget", "0"],
        &["--time-budget", "nan"],
        &["--time-budget", "9", "--least-resolution-scale", "0.2"],
        &["--time-budget", "9", "--least-resolution-scale", "0.5"],
        &["--least-resolution-scale", "0.5"],
        &["--out", "picture.gif"],
        &["--set", "no.such.field=1"],
        &["--set", "bounces=several"],
        &["--set", "bounces"],
        &["--set", "resolution_scale=0.5"],
        &["--stats", in_folder],
        &["--no-such-option"],
        &["another.glb"],
    ];
    for arguments in wrong {
        let mut all = vec!["--out", "out.exr"];
        if arguments[0] == "--out" {
            all.clear();
        }
        all.extend(arguments);
        let run = folder.render(&scene, &all);
        assert_eq!(run.code, 2, "{arguments:?}: {}", run.stderr);
        assert!(run.stderr.starts_with("error: "), "{arguments:?}: {}", run.stderr);
        assert_eq!(run.stderr.trim_end().lines().count(), 1, "{arguments:?}: one line: {}", run.stderr);
        assert_eq!(folder.files(), ["scene.gltf"], "{arguments:?}");
    }
    let run = folder.render(&scene, &["--bounces", "-1"]);
    assert!(run.stderr.contains("--bounces"), "it names the option: {}", run.stderr);
}

#[test]
fn late_failures_give_exit_code_1_and_leave_no_files() {
    let Some(folder) = Folder::new("late") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    fs::create_dir(folder.path("folder.exr")).expect("the folder can be written");
    fs::write(folder.path("broken.exr"), b"no exr").expect("the folder can be written");
    fs::write(folder.path("broken.hdr"), b"no hdr").expect("the folder can be written");
    let before = folder.files();
    let cases: [(&str, &[&str]); 8] = [
        ("camera", &["--camera", "nobody", "--out", "out.exr"]),
        ("no folder", &["--out", "no/such/folder/out.exr"]),
        ("a folder of that name", &["--out", "folder.exr"]),
        ("no environment", &["--env", "absent.hdr", "--out", "out.exr"]),
        ("broken exr", &["--env", "broken.exr", "--out", "out.exr"]),
        ("broken hdr", &["--env", "broken.hdr", "--out", "out.exr"]),
        ("aov", &["--aov", "depth=d.exr", "--aov", "albedo=no/such/folder/a.exr", "--out", "out.exr"]),
        ("stats", &["--stats", "no/such/folder/stats.json", "--out", "out.exr"]),
    ];
    for (name, arguments) in cases {
        let small = ["--technique", "reference", "--size", "8x8", "--frames", "1"];
        let run = folder.render(&scene, &[&small[..], arguments].concat());
        run.failed(1, name);
        assert_eq!(folder.files(), before, "{name}");
    }
}

#[test]
fn values_out_of_range_are_clamped_with_a_warning() {
    let Some(folder) = Folder::new("range") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    let small = ["--technique", "reference", "--size", "8x8", "--frames", "1", "--out", "out.exr"];
    let run = folder.render(&scene, &[&small[..], &["--set", "bounces=1000"]].concat());
    run.succeeded();
    assert!(run.stderr.contains("bounces = 1000"), "{}", run.stderr);
    assert_eq!(run.stderr.trim_end().lines().count(), 1, "once: {}", run.stderr);
    let run =
        folder.render(&scene, &[&small[..], &["--set", "energy_compensation=false", "--set", "jitter=Never"]].concat());
    run.succeeded();
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    // Without a camera, one is placed in front of the scene.
    let bare = folder.gltf("bare.gltf", &gltf::Scene { camera: false, ..Default::default() });
    let run = folder.render(&bare, &[&small[..], &["--env", "1,1,1"]].concat());
    run.succeeded();
    assert!(run.stderr.contains("no camera"), "{}", run.stderr);
    assert!(Exr::read(&folder.path("out.exr")).pixels.iter().any(|p| p[2] != 1.0), "the quad is in the picture");
}

#[test]
fn equal_commands_give_equal_bytes_and_options_have_their_effect() {
    let Some(folder) = Folder::new("options") else { return };
    let render_by = |technique: &str, out: &str, more: &[&str]| {
        let fixed = ["--technique", technique, "--size", "24x24", "--frames", "4", "--bounces", "3", "--out", out];
        let run = folder.render(&asset("cornell.glb"), &[&fixed[..], more].concat());
        run.succeeded();
        fs::read(folder.path(out)).expect("the file was written")
    };
    let render = |out: &str, more: &[&str]| render_by("reference", out, more);
    let first = render("a.exr", &[]);
    assert!(render("b.exr", &[]) == first, "again");
    let defaults = ["--seed", "0", "--output", "last", "--warmup", "3"];
    assert!(render("b.exr", &defaults) == first, "the reference with explicit defaults");
    assert!(render("b.exr", &["--seed", "1"]) != first, "another seed");
    // Exposure is 1/(1.2 · 2^ev100), and linear.
    render("b.exr", &["--ev100", "2"]);
    let (plain, exposed) = (Exr::read(&folder.path("a.exr")), Exr::read(&folder.path("b.exr")));
    for (a, b) in plain.pixels.iter().flatten().zip(exposed.pixels.iter().flatten()) {
        assert!((a / 4.8 - b).abs() <= 1e-5 * a, "{a} and {b}");
    }
    let depth = |out: &str, more: &[&str]| render(out, &[&["--set", "debug_view=Depth"][..], more].concat());
    assert!(depth("b.exr", &[]) == depth("c.exr", &["--ev100", "2"]), "a distance has no exposure");
    assert!(render("b.png", &[]) == render("c.png", &[]), "equal PNG files");
    // For a technique that does not accumulate by itself, the output is the mean of its frames in both file formats.
    let di = |out: &str, more: &[&str]| render_by("di", out, &[&FEW_PASSES[..], more].concat());
    assert!(di("mean.exr", &[]) != di("last.exr", &["--output", "last"]));
    assert!(di("mean.png", &[]) != di("last.png", &["--output", "last"]));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_time_budget_takes_samples_away_where_frames_take_longer() {
    let Some(folder) = Folder::new("budget") else { return };
    let render = |out: &str, more: &[&str]| {
        let fixed = ["--technique", "di", "--size", "16x16", "--frames", "2", "--warmup", "2", "--out", out];
        let run = folder.render(&asset("cornell.glb"), &[&fixed[..], &["--stats", "stats.json"], more].concat());
        run.succeeded();
        let can_keep = !more.contains(&"1e-4");
        assert!(run.stderr.is_empty() == can_keep, "{}", run.stderr);
        let stats = fs::read_to_string(folder.path("stats.json")).expect("the file was written");
        let stats: Value = serde_json::from_str(&stats).expect("the file is JSON");
        (fs::read(folder.path(out)).expect("the file was written"), stats["budget_step"].as_u64())
    };
    let free = render("a.exr", &[]);
    assert_eq!(render("b.exr", &["--time-budget", "1e6"]), free, "all samples fit");
    // Two spatial neighbors, those of disocclusions, and candidates from 32 to 4.
    let (picture, step) = render("c.exr", &["--time-budget", "1e-4"]);
    assert_eq!((free.1, step), (Some(0), Some(6)));
    assert!(picture != free.0);
    // After the samples the pixels: 0.8, 0.64 and 0.512 times the width and the height.
    let (_, step) = render("d.png", &["--time-budget", "1e-4", "--least-resolution-scale", "0.5"]);
    assert_eq!(step, Some(9));
}

#[test]
fn environments_light_by_color_and_by_file() {
    let Some(folder) = Folder::new("environment") else {
        return;
    };
    // The camera stands inside the environment; the scene holds only a gray quad that does not emit.
    let scene = gltf::Scene { emissive: [0.0; 3], ..Default::default() };
    let scene = folder.gltf("scene.gltf", &scene);
    let map = |name: &str| folder.path(name).to_string_lossy().into_owned();
    exr::prelude::write_rgb_file(folder.path("sky.exr"), 8, 4, |_, _| (0.5f32, 1.0f32, 2.0f32))
        .expect("the folder can be written");
    // The Radiance format: a header, then one texel of shared exponent each, (0.5, 1, 2) · 2^(128 - 128 - 8 + 8).
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 4\n".to_vec();
    hdr.extend([32u8, 64, 128, 130].repeat(16));
    fs::write(folder.path("sky.hdr"), hdr).expect("the folder can be written");
    for env in ["0.5,1,2".to_string(), map("sky.exr"), map("sky.hdr")] {
        let fixed = ["--technique", "reference", "--size", "17x17", "--frames", "64", "--out", "out.exr"];
        let run = folder.render(&scene, &[&fixed[..], &["--env", env.as_str()]].concat());
        run.succeeded();
        let picture = Exr::read(&folder.path("out.exr"));
        for (c, radiance) in [0.5, 1.0, 2.0].into_iter().enumerate() {
            let backdrop = picture.at(0, 0)[c];
            assert!((backdrop - radiance).abs() <= 0.02 * radiance, "{env}: {backdrop}, not {radiance}");
            // Albedo 0.5 of the environment, and a weak specular reflection.
            let quad = picture.at(8, 8)[c] / radiance;
            assert!((0.4..0.7).contains(&quad), "{env}: {quad}");
        }
    }
}

/// Fields of the file of `--stats`.
const STATISTICS: [&str; 26] = [
    "adapter",
    "backend",
    "technique",
    "preset",
    "size",
    "frames",
    "features",
    "passes",
    "frame_ms_median",
    "cpu_ms_median",
    "cpu_stages",
    "rays_per_frame",
    "light_paths_per_frame",
    "light_vertices_per_frame",
    "splats_per_frame",
    "memory",
    "pipelines",
    "uploaded_bytes_last_frame",
    "non_finite_pixels",
    "overflow_flags",
    "guards",
    "resets",
    "budget_step",
    "triangles",
    "instances",
    "lights",
];

#[test]
fn statistics_are_complete_and_correct() {
    let Some(folder) = Folder::new("stats") else { return };
    let arguments = [
        ["--technique", "reference"],
        ["--size", "20x10"],
        ["--frames", "6"],
        ["--bounces", "2"],
        ["--out", "out.exr"],
        ["--stats", "stats.json"],
    ]
    .concat();
    folder.render(&asset("cornell.glb"), &arguments).succeeded();
    let text = fs::read_to_string(folder.path("stats.json")).expect("the file was written");
    let stats: Value = serde_json::from_str(&text).expect("the file is JSON");
    let number = |v: &Value| v.as_f64().unwrap_or_else(|| panic!("{v} is a number"));
    let list = |v: &Value| v.as_array().unwrap_or_else(|| panic!("{v} is a list")).clone();
    let text = |v: &Value| v.as_str().unwrap_or_else(|| panic!("{v} is text")).to_string();

    assert!(!text(&stats["adapter"]).is_empty());
    assert_eq!(text(&stats["backend"]), "software", "software is the automatic choice on a CPU");
    assert_eq!((text(&stats["technique"]), text(&stats["preset"])), ("reference".into(), "balanced".into()));
    assert_eq!(stats["size"], serde_json::json!([20, 10]));
    assert_eq!(stats["frames"], 6);
    assert!(list(&stats["features"]).contains(&Value::from("LIGHT_TRIANGLES")), "{}", stats["features"]);
    let passes = list(&stats["passes"]);
    for wanted in ["visibility", "reference", "statistics", "composite"] {
        let pass = passes.iter().find(|p| p["name"] == wanted).unwrap_or_else(|| panic!("{wanted}: {passes:?}"));
        let [low, median, high] = ["ms_min", "ms_median", "ms_max"].map(|key| number(&pass[key]));
        assert!(0.0 < low && low <= median && median <= high && high < 1e5, "{pass}");
    }
    assert!(
        number(&stats["frame_ms_median"]) >= number(&stats["cpu_ms_median"]) && number(&stats["cpu_ms_median"]) > 0.0
    );
    // Every pixel sees the room: at least one shadow ray per pixel, at most one shadow ray and one path ray per bounce.
    let rays = number(&stats["rays_per_frame"]);
    assert!((200.0..=200.0 * 4.0).contains(&rays), "{rays} rays");
    let memory = &stats["memory"];
    let items: f64 = list(&memory["items"]).iter().map(|i| number(&i["bytes"])).sum();
    assert_eq!(number(&memory["total_bytes"]), items);
    let bytes = |name: &str| {
        list(&memory["items"]).iter().filter(|i| i["name"] == name).map(|i| number(&i["bytes"])).sum::<f64>()
    };
    assert_eq!((bytes("radiance"), bytes("visibility")), (200.0 * 16.0, 200.0 * 8.0));
    assert_eq!(number(&memory["reservoir_bytes_per_pixel"]), 0.0, "the reference has none");
    let pipelines = list(&stats["pipelines"]);
    let reference = pipelines.iter().find(|p| p["name"] == "reference").expect("a pipeline");
    assert!(
        number(&reference["compile_ms"]) > 0.0 && list(&reference["defs"]).contains(&Value::from("LIGHT_TRIANGLES"))
    );
    assert_eq!(stats["uploaded_bytes_last_frame"], 0, "a still scene");
    assert_eq!((&stats["non_finite_pixels"], &stats["overflow_flags"]), (&Value::from(0), &Value::from(0)));
    let guards = stats["guards"].as_object().expect("an object");
    assert_eq!(guards.len(), GUARDS.len());
    assert!(GUARDS.iter().all(|guard| guards[guard.name] == 0), "{guards:?}");
    assert!(number(&stats["triangles"]) > 10.0 && number(&stats["instances"]) > 1.0 && number(&stats["lights"]) > 0.0);
    let mut keys: Vec<&str> = stats.as_object().expect("an object").keys().map(String::as_str).collect();
    let mut wanted = STATISTICS.to_vec();
    keys.sort_unstable();
    wanted.sort_unstable();
    assert_eq!(keys, wanted);
}

#[test]
fn the_help_names_every_option_of_the_contract() {
    let Some(folder) = Folder::new("help") else { return };
    let run = folder.render(&PathBuf::from("--help"), &[]);
    assert_eq!(run.code, 0);
    for option in [
        "--out",
        "--size",
        "--technique",
        "--preset",
        "--bounces",
        "--frames",
        "--warmup",
        "--output",
        "--seed",
        "--env",
        "--ev100",
        "--backend",
        "--animate",
        "--set",
        "--stats",
        "--aov",
        "--time-budget",
        "--camera",
    ] {
        assert!(run.stdout.contains(option), "{option}");
    }
}
