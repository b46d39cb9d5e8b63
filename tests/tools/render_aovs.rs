//! The files of `render --aov`.

use crate::support::{cli::*, gltf};
use std::fs;

#[test]
fn aovs_hold_the_first_surface_of_each_pixel() {
    let Some(folder) = Folder::new("aov") else { return };
    // A wall of 2 m by 2 m, 3 m in front of a camera that sees more than it.
    let scene = folder.gltf("scene.gltf", &gltf::Scene::default());
    let names = ["albedo", "normal", "depth", "motion"];
    let files: Vec<String> = names.iter().map(|name| format!("{name}={name}.exr")).collect();
    let plain = ["--technique", "reference", "--size", "9x9", "--frames", "2", "--env", "1,1,1", "--out", "out.exr"];
    let all: Vec<&str> = files.iter().flat_map(|file| ["--aov", file]).chain(plain).collect();
    folder.render(&scene, &plain).succeeded();
    let picture = fs::read(folder.path("out.exr")).expect("the file was written");
    folder.render(&scene, &all).succeeded();
    assert!(fs::read(folder.path("out.exr")).expect("the file was written") == picture, "the picture stays as it is");
    let center = names.map(|name| Exr::read(&folder.path(&format!("{name}.exr"))).at(4, 4));
    println!("{center:?}");
    let [albedo, normal, depth, motion] = center;
    assert!(albedo.iter().all(|c| (0.0..=1.0).contains(c)) && albedo != [0.0; 3], "{albedo:?}");
    let length = normal.iter().map(|c| c * c).sum::<f32>().sqrt();
    assert!((length - 1.0).abs() < 1e-3, "{normal:?}");
    assert!(depth[0] > 0.0 && depth[0] == depth[1], "{depth:?}");
    assert!(motion.iter().all(|c| c.abs() < 1e-3), "a still scene: {motion:?}");
}

/// Renders a picture and its parts: `out.exr`, and diffuse plus specular light.
fn parts(folder: &Folder, scene: &std::path::Path, arguments: &[&str]) -> (Exr, Vec<[f32; 3]>) {
    let aovs = ["--out", "out.exr", "--aov", "diffuse=diffuse.exr", "--aov", "specular=specular.exr"];
    folder.render(scene, &[arguments, &aovs].concat()).succeeded();
    let [diffuse, specular] = ["diffuse.exr", "specular.exr"].map(|name| Exr::read(&folder.path(name)).pixels);
    for (name, part) in [("diffuse", &diffuse), ("specular", &specular)] {
        assert!(part.iter().flatten().any(|c| *c > 0.0), "{name} light of {arguments:?}");
    }
    let add = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|i| a[i] + b[i]);
    (Exr::read(&folder.path("out.exr")), diffuse.iter().zip(&specular).map(add).collect())
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn parts_of_the_light_sum_to_the_picture() {
    let Some(folder) = Folder::new("parts") else { return };
    let scene = asset("glossy.glb");
    let common = ["--size", "24x24", "--frames", "3", "--warmup", "2", "--ev100", "1", "--seed", "5"];
    // The parts of a single frame are neither limited nor filtered.
    let raw = ["--set", "firefly_limit=0", "--set", "denoiser.iterations=0"];
    let single = [&["--technique", "di", "--output", "last"][..], &raw].concat();
    for technique in [&["--technique", "reference"][..], &single] {
        let arguments = [&common[..], technique].concat();
        folder.render(&scene, &[&arguments[..], &["--bounces", "0", "--out", "emission.exr"]].concat()).succeeded();
        let emission = Exr::read(&folder.path("emission.exr")).pixels;
        let (picture, sum) = parts(&folder, &scene, &arguments);
        for ((all, sum), emission) in picture.pixels.iter().zip(&sum).zip(&emission) {
            for i in 0..3 {
                assert!((sum[i] + emission[i] - all[i]).abs() <= 1e-5 * all[i], "{technique:?}: {sum:?}, {all:?}");
            }
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn parts_of_the_light_are_those_of_an_animation_from_the_same_time_on() {
    let Some(folder) = Folder::new("moving_parts") else { return };
    // A gray square that moves to the right by 0.5 m/s, before a white environment.
    let slow = |bytes: &mut [u8]| {
        bytes[116..120].copy_from_slice(&0.25f32.to_le_bytes());
        bytes[128..132].copy_from_slice(&5.0f32.to_le_bytes());
    };
    let scene = gltf::Scene { animated: true, emissive: [0.0; 3], edit_bytes: slow, ..Default::default() };
    let scene = folder.gltf("scene.gltf", &scene);
    let fixed =
        [["--technique", "di"], ["--size", "48x16"], ["--frames", "2"], ["--warmup", "2"], ["--env", "1,1,1"]].concat();
    let fixed = [&fixed[..], &["--animate"]].concat();
    let (picture, sum) = parts(&folder, &scene, &fixed);
    for (all, sum) in picture.pixels.iter().zip(&sum) {
        // The square hides the environment in none, one or both of the frames.
        let hidden = 2.0 * (1.0 - (all[0] - sum[0]));
        assert!((hidden - hidden.round()).abs() < 1e-4, "{all:?} and {sum:?}");
    }
    assert!(picture.pixels.iter().zip(&sum).any(|(all, sum)| sum[0] > 0.0 && all[0] - sum[0] < 1e-4), "it is seen");
}
