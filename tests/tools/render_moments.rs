//! Which camera, which moment of an animation and which frames `render` shows, and that files of earlier runs survive an error.

use crate::support::{cli::*, gltf};
use bevy_restir::CapturedRadiance;
use bevy_restir_support::frame_sum::FrameSum;
use std::fs;

const SMALL: [&str; 6] = ["--technique", "di", "--size", "48x16", "--set", "jitter=Never"];

/// A square that stands where the animated one is after some frames: it moves by a third of a meter in a frame.
fn after(frames: u32) -> gltf::Scene {
    gltf::Scene {
        edit_json: match frames {
            3 => |file| file["nodes"][0]["translation"] = serde_json::json!([1.0, 0.0, 0.0]),
            _ => |file| file["nodes"][0]["translation"] = serde_json::json!([4.0 / 3.0, 0.0, 0.0]),
        },
        ..Default::default()
    }
}

#[test]
fn the_first_camera_of_the_file_is_shown() {
    let Some(folder) = Folder::new("cameras") else { return };
    fn two(file: &mut serde_json::Value, order: [u32; 3]) {
        let far = serde_json::json!({"camera": 0, "translation": [0.0, 0.0, 20.0], "name": "far"});
        file["nodes"].as_array_mut().expect("the file has nodes").push(far);
        file["scenes"][0]["nodes"] = serde_json::json!(order);
    }
    let files = [
        folder.gltf("a.gltf", &gltf::Scene { edit_json: |file| two(file, [0, 1, 2]), ..Default::default() }),
        folder.gltf("b.gltf", &gltf::Scene { edit_json: |file| two(file, [2, 1, 0]), ..Default::default() }),
    ];
    let shown = |scene: &std::path::Path, more: &[&str]| {
        let fixed = ["--technique", "reference", "--size", "9x9", "--frames", "1", "--out", "out.exr"];
        folder.render(scene, &[&fixed[..], more].concat()).succeeded();
        Exr::read(&folder.path("out.exr")).at(3, 3)
    };
    // Only the near camera sees the square in this pixel.
    let (near, far) = ([1.0, 2.0, 3.0], [0.0; 3]);
    assert_eq!([shown(&files[0], &[]), shown(&files[1], &[])], [near, far]);
    assert_eq!([shown(&files[0], &["--camera", "far"]), shown(&files[1], &["--camera", "eye"])], [far, near]);
    let run = folder.render(&files[0], &["--camera", "nobody"]);
    run.failed(1, "a camera that is missing");
    assert!(run.stderr.contains("eye") && run.stderr.contains("far"), "it names the others: {}", run.stderr);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn animate_plays_the_first_animation() {
    let Some(folder) = Folder::new("animation") else { return };
    // The quad leaves the image within half a second.
    let scene = folder.gltf("scene.gltf", &gltf::Scene { animated: true, ..Default::default() });
    let picture = |more: &[&str]| {
        let fixed = ["--technique", "di", "--size", "9x9", "--frames", "40", "--output", "last", "--out", "out.exr"];
        folder.render(&scene, &[&fixed[..], &FEW_PASSES, more].concat()).succeeded();
        Exr::read(&folder.path("out.exr")).at(4, 4)
    };
    assert_eq!(picture(&[]), [1.0, 2.0, 3.0], "still");
    assert_eq!(picture(&["--animate"]), [0.0; 3], "moving");
    // The same motion of the camera.
    let camera = gltf::Scene {
        animated: true,
        edit_json: |file| file["animations"][0]["channels"][0]["target"]["node"] = 1.into(),
        ..Default::default()
    };
    folder.gltf("scene.gltf", &camera);
    assert_eq!(picture(&[]), [1.0, 2.0, 3.0], "a still camera");
    assert_eq!(picture(&["--animate"]), [0.0; 3], "a camera that moves");
    folder.gltf("scene.gltf", &gltf::Scene { animated: true, ..Default::default() });
    let moving = ["--technique", "di", "--animate", "--size", "9x9", "--frames", "4", "--out"];
    let run = folder.render(&scene, &[&moving[..], &["out.png"], &FEW_PASSES].concat());
    run.succeeded();
    assert!(run.stderr.contains("shows its last frame"), "{}", run.stderr);
    assert!(!run.stderr.contains("no effect"), "{}", run.stderr);
    // A file without an animation stays still.
    let still = folder.gltf("still.gltf", &gltf::Scene::default());
    let run = folder.render(&still, &[&moving[..], &["out.exr"], &FEW_PASSES].concat());
    run.succeeded();
    assert!(run.stderr.contains("--animate has no effect"), "{}", run.stderr);
    assert!(!run.stderr.contains('\x1b'), "no colors without a terminal: {}", run.stderr);
    assert_eq!(Exr::read(&folder.path("out.exr")).at(4, 4), [1.0, 2.0, 3.0]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn pictures_and_surfaces_of_an_animation_are_of_the_moments_that_the_arguments_say() {
    let Some(folder) = Folder::new("moments") else { return };
    let moving = folder.gltf("moving.gltf", &gltf::Scene { animated: true, ..Default::default() });
    let still = folder.gltf("still.gltf", &after(3));
    let render = |scene: &std::path::Path, out: &str, more: &[&str]| {
        folder
            .render(scene, &[&SMALL[..], &FEW_PASSES, &["--output", "last", "--out", out], more].concat())
            .succeeded();
        fs::read(folder.path(out)).expect("the file was written")
    };
    let aovs = ["--aov", "depth=depth.exr", "--aov", "albedo=albedo.exr", "--aov", "motion=motion.exr"];
    let third = [&["--animate", "--warmup", "2", "--frames", "1"], &aovs[..]].concat();
    let wanted = render(&still, "still.exr", &["--warmup", "0", "--frames", "1"]);
    assert!(render(&moving, "a.exr", &third) == wanted, "the third frame is one twentieth of a second after the start");
    assert!(render(&moving, "b.exr", &["--animate", "--warmup", "0", "--frames", "3"]) == wanted, "the same frame");

    // Surfaces are those of the frame after it.
    let next = folder.gltf("next.gltf", &after(4));
    let read = |name: &str| Exr::read(&folder.path(name)).pixels;
    let [depth, albedo, motion] = ["depth.exr", "albedo.exr", "motion.exr"].map(read);
    render(&next, "next.exr", &["--warmup", "0", "--frames", "1"]);
    let is_seen: Vec<bool> = read("next.exr").iter().map(|p| p[0] > 0.0).collect();
    assert!(is_seen.contains(&true) && is_seen.contains(&false));
    for (i, seen) in is_seen.iter().enumerate() {
        assert_eq!((depth[i][0] > 0.0, albedo[i][0] > 0.0), (*seen, *seen), "pixel {i}");
    }
    // A third of a meter of the 4.23 m that are 16 pixels.
    let moved = motion.iter().zip(&is_seen).filter(|(_, seen)| **seen).map(|(m, _)| m[0].abs());
    assert!(moved.clone().all(|pixels| (pixels - 1.261).abs() < 0.01), "{:?}", moved.collect::<Vec<_>>());

    // A .png shows the last of the frames, not one more.
    let shown = render(&moving, "a.png", &["--animate", "--warmup", "2", "--frames", "1"]);
    assert!(shown == render(&still, "b.png", &["--warmup", "0", "--frames", "1"]));
}

#[test]
fn errors_leave_the_files_of_earlier_runs_alone() {
    let Some(folder) = Folder::new("earlier") else { return };
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    for name in ["out.exr", "d.exr"] {
        fs::write(folder.path(name), b"of an earlier run").expect("the folder can be written");
    }
    let before = folder.files();
    let small =
        ["--technique", "reference", "--size", "8x8", "--frames", "1", "--out", "out.exr", "--aov", "depth=d.exr"];
    for (code, more) in [
        (1, ["--stats", "no/such/folder/stats.json"]),
        (1, ["--aov", "normal=no/such/folder/n.exr"]),
        (1, ["--camera", "nobody"]),
        (2, ["--stats", "out.exr"]),
        (2, ["--stats", "./d.exr"]),
        (2, ["--aov", "albedo=d.exr"]),
    ] {
        folder.render(&scene, &[&small[..], &more].concat()).failed(code, more[1]);
        assert_eq!(folder.files(), before, "{more:?}");
        for name in ["out.exr", "d.exr"] {
            assert_eq!(fs::read(folder.path(name)).expect("it is there"), b"of an earlier run", "{name}: {more:?}");
        }
    }
}

#[test]
fn each_sample_counts_once_whether_the_reference_starts_again_or_goes_on() {
    // Sums of light and numbers of samples, as captures hold them.
    let mean = |frames: &[[f32; 2]]| {
        let mut sum = FrameSum::default();
        for [light, samples] in frames {
            sum.add(CapturedRadiance { size: [1, 1].into(), pixels: vec![[*light, 0.0, 0.0, *samples]] });
        }
        sum.mean()[0][0]
    };
    assert_eq!(mean(&[[3.0, 1.0], [5.0, 1.0], [4.0, 1.0]]), 4.0);
    assert_eq!(mean(&[[3.0, 1.0], [8.0, 2.0], [12.0, 3.0]]), 4.0);
    assert_eq!(mean(&[[3.0, 1.0], [8.0, 2.0], [4.0, 1.0]]), 4.0);
    // The mean of all samples is one frame.
    assert_eq!(mean(&[[8.0, 4.0]]), 2.0);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_mean_has_no_filter_from_its_first_frame_on() {
    let Some(folder) = Folder::new("unfiltered") else { return };
    let render = |out: &str, more: &[&str]| {
        let fixed = ["--technique", "di", "--size", "16x16", "--frames", "1", "--out", out];
        folder.render(&asset("cornell.glb"), &[&fixed[..], more].concat()).succeeded();
        fs::read(folder.path(out)).expect("the file was written")
    };
    let unfiltered = render("b.exr", &["--set", "denoiser.iterations=0", "--set", "firefly_limit=0"]);
    assert!(render("a.exr", &[]) == unfiltered);
}
