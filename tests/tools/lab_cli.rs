//! `lab compare`, `lab frames` and `lab times` as scripts call them: their figures, their files, and their exit codes.

use crate::support::{
    app::Rig,
    cli::{Folder, asset},
};
use bevy::math::UVec2;
use bevy_restir::{ReuseOrder, Technique};
use bevy_restir_support::{headless, scene::View};
use serde_json::Value;
use std::fs;

#[path = "../../examples/lab/series.rs"]
#[allow(dead_code, reason = "the program uses more of it")]
mod series;

/// A picture without equal pixels, and far from black.
fn plain(x: usize, y: usize) -> [f32; 3] {
    let at = (x + 31 * y) as f32;
    [0.5 + 0.3 * (0.7 * at).sin(), 2.0 + 0.01 * at, 1.0 + 0.5 * (0.3 * at).cos()]
}

fn write(folder: &Folder, name: &str, [width, height]: [usize; 2], pixel: impl Sync + Fn(usize, usize) -> [f32; 3]) {
    let channels = |x, y| {
        let [r, g, b] = pixel(x, y);
        (r, g, b)
    };
    exr::prelude::write_rgb_file(folder.path(name), width, height, channels).expect("the folder can be written");
}

/// The comparison of two files: one line of JSON.
fn compared(folder: &Folder, picture: &str, reference: &str, more: &[&str]) -> Value {
    let run = folder.lab(&[&["compare", picture, reference, "--out", "tables"], more].concat());
    run.succeeded();
    assert_eq!(run.stdout.trim_end().lines().count(), 1, "{}", run.stdout);
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    serde_json::from_str(&run.stdout).expect("the output is JSON")
}

fn is_near(value: &Value, wanted: f64) -> bool {
    value.as_f64().is_some_and(|value| (value - wanted).abs() <= 1e-5)
}

#[test]
fn equal_pictures_differ_by_nothing() {
    let folder = Folder::without_gpu("compare_equal");
    write(&folder, "a.exr", [21, 13], plain);
    write(&folder, "b.exr", [21, 13], plain);
    let nothing = serde_json::json!({
        "rel_mean": 0.0,
        "rel_mean_rgb": [0.0, 0.0, 0.0],
        "tile_abs_mean": 0.0,
        "tile_abs_p95": 0.0,
        "tile_abs_max": 0.0,
        "tile_bias": 0.0,
        "rmse": 0.0,
        "rel_mse": 0.0,
        "mape": 0.0,
        "rel_mse_trimmed": 0.0,
        "black": 0.0,
        "flip": 0.0,
        "non_finite": 0,
    });
    assert_eq!(compared(&folder, "a.exr", "b.exr", &[]), nothing);
    assert_eq!(compared(&folder, "a.exr", "a.exr", &["--tile", "5"]), nothing);
}

#[test]
fn colors_of_a_png_are_compared_as_linear_light() {
    let folder = Folder::without_gpu("compare_png");
    let gray = image::RgbImage::from_pixel(16, 16, image::Rgb([188, 188, 188]));
    gray.save(folder.path("a.png")).expect("the folder can be written");
    write(&folder, "b.exr", [16, 16], |_, _| [0.5029; 3]);
    let found = compared(&folder, "a.png", "b.exr", &[]);
    assert!(found["rel_mean"].as_f64().is_some_and(|difference| difference.abs() < 1e-3), "{found}");
}

#[test]
fn a_brighter_picture_has_the_same_relative_difference_everywhere() {
    let folder = Folder::without_gpu("compare_brighter");
    write(&folder, "a.exr", [24, 16], |x, y| plain(x, y).map(|c| 1.01 * c));
    write(&folder, "b.exr", [24, 16], plain);
    let found = compared(&folder, "a.exr", "b.exr", &[]);
    for key in ["rel_mean", "tile_abs_mean", "tile_abs_p95", "tile_abs_max", "tile_bias"] {
        assert!(is_near(&found[key], 0.01), "{key}: {found}");
    }
    assert!((0..3).all(|i| is_near(&found["rel_mean_rgb"][i], 0.01)), "{found}");
    assert_eq!(found["non_finite"], 0);
    // With the arguments swapped, the picture is darker, relative to the brighter reference.
    let found = compared(&folder, "b.exr", "a.exr", &[]);
    assert!(is_near(&found["tile_bias"], -0.01 / 1.01) && is_near(&found["tile_abs_mean"], 0.01 / 1.01), "{found}");
}

#[test]
fn figures_follow_their_definitions() {
    let folder = Folder::without_gpu("compare_definitions");
    // Two tiles, and a column and a row that belong to no tile.  The left tile is half as bright again.
    write(&folder, "a.exr", [9, 5], |x, y| [if x < 4 && y < 4 { 1.5 } else { 1.0 }; 3]);
    write(&folder, "b.exr", [9, 5], |_, _| [1.0; 3]);
    let found = compared(&folder, "a.exr", "b.exr", &["--tile", "4"]);
    let share: f64 = 16.0 / 45.0;
    for (key, wanted) in [
        ("rel_mean", 0.5 * share),
        ("tile_abs_mean", 0.25),
        ("tile_abs_p95", 0.475),
        ("tile_abs_max", 0.5),
        ("tile_bias", 0.25),
        ("rmse", 0.5 * share.sqrt()),
        ("rel_mse", 0.25 * share / 1.01),
        ("mape", 0.5 * share / 1.01),
        // By the authors' implementation, of the same tone-mapped bytes.
        ("flip", 0.143_933),
    ] {
        assert!(is_near(&found[key], wanted), "{key} is {wanted}: {found}");
    }
    // One bright pixel of a hundred is left out of the trimmed error, and one black pixel is a hundredth of the picture.
    let spots = |x: usize, y: usize| match (x, y) {
        (3, 3) => [100.0; 3],
        (5, 5) => [0.0; 3],
        _ => [1.0; 3],
    };
    write(&folder, "spots.exr", [10, 10], spots);
    write(&folder, "one.exr", [10, 10], |_, _| [1.0; 3]);
    let spotted = compared(&folder, "spots.exr", "one.exr", &[]);
    for (key, wanted) in
        [("rel_mse", 98.02 / 1.01), ("rel_mse_trimmed", 1.0 / 99.0 / 1.01), ("black", 0.01), ("flip", 0.041_985)]
    {
        assert!(is_near(&spotted[key], wanted), "{key} is {wanted}: {spotted}");
    }
    // A black pixel beside a dark pixel of the reference is not counted: it may show the dark surface at a silhouette.
    write(&folder, "edge.exr", [10, 10], |x, y| [if (x, y) == (6, 6) { 0.01 } else { 1.0 }; 3]);
    assert_eq!(compared(&folder, "spots.exr", "edge.exr", &[])["black"], 0.0);
    // Without a complete tile, the figures of tiles are empty.
    let found = compared(&folder, "a.exr", "b.exr", &[]);
    assert!(found["tile_abs_max"].is_null() && is_near(&found["rel_mean"], 0.5 * share), "{found}");
}

#[test]
fn pixels_that_are_not_finite_are_counted_and_taken_as_black() {
    let folder = Folder::without_gpu("compare_nan");
    let spot = |x: usize, y: usize, what: [f32; 3]| if (x, y) == (3, 2) { what } else { plain(x, y) };
    write(&folder, "nan.exr", [16, 16], |x, y| spot(x, y, [1.0, f32::NAN, 1.0]));
    write(&folder, "black.exr", [16, 16], |x, y| spot(x, y, [0.0; 3]));
    write(&folder, "b.exr", [16, 16], plain);
    let mut found = compared(&folder, "nan.exr", "b.exr", &[]);
    assert_eq!(found["non_finite"], 1);
    let black = compared(&folder, "black.exr", "b.exr", &[]);
    assert_eq!(black["non_finite"], 0);
    found["non_finite"] = 0.into();
    assert_eq!(found, black);
    // A reference must be finite.
    let run = folder.lab(&["compare", "b.exr", "nan.exr"]);
    run.failed(1, "a reference that is not finite");
    assert!(run.stderr.contains("nan.exr"), "{}", run.stderr);
}

#[test]
fn the_table_names_the_compared_files() {
    let folder = Folder::without_gpu("compare_table");
    write(&folder, "a.exr", [16, 8], |x, y| plain(x, y).map(|c| 2.0 * c));
    write(&folder, "b.exr", [16, 8], plain);
    let found = compared(&folder, "a.exr", "b.exr", &[]);
    assert_eq!(folder.files(), ["a.exr", "b.exr", "tables"]);
    let table = |name: &str| fs::read_to_string(folder.path("tables").join(name)).expect("the file was written");
    let (csv, markdown) = (table("compare.csv"), table("compare.md"));
    for text in [&csv, &markdown] {
        assert!(text.contains("`cargo run --example lab -- compare a.exr b.exr --out tables`"), "{text}");
        assert!(text.contains("16 x 8 pixels, tiles of 8 x 8"), "{text}");
    }
    for name in found.as_object().expect("an object").keys() {
        assert!(csv.lines().any(|line| line.starts_with(&format!(",{name},"))), "{name}: {csv}");
        assert!(markdown.contains(&format!("| {name} |")), "{name}: {markdown}");
    }
}

#[test]
fn a_difference_is_a_picture_beside_its_error() {
    let folder = Folder::without_gpu("compare_difference");
    write(&folder, "a.exr", [16, 8], |x, y| if (x, y) == (2, 3) { [9.0; 3] } else { plain(x, y) });
    write(&folder, "b.exr", [16, 8], plain);
    compared(&folder, "a.exr", "b.exr", &["--difference", "difference.png"]);
    let picture = image::open(folder.path("difference.png")).expect("the picture can be read").to_rgb8();
    // A line of four pixels lies between them.
    let error_at = 16 + 4;
    assert_eq!((picture.width(), picture.height()), (2 * 16 + 4, 8));
    assert!(picture.get_pixel(error_at + 2, 3).0[0] > 200, "the pixel that differs");
    assert_eq!(picture.get_pixel(error_at + 3, 3).0, [0; 3], "a pixel that is equal");
    let run = folder.lab(&["compare", "a.exr", "b.exr", "--difference", "missing/difference.png"]);
    run.failed(1, "a folder that is missing");
    let run = folder.lab(&["compare", "difference.png", "difference.png", "--difference", "difference.png"]);
    run.failed(2, "an input");
    folder.lab(&["compare", "a.exr", "b.exr", "--difference", "difference.exr"]).failed(2, "another format");
    assert_eq!(image::open(folder.path("difference.png")).expect("it is still there").to_rgb8(), picture);
}

#[test]
fn pictures_that_cannot_be_compared_give_one_line_and_exit_code_1() {
    let folder = Folder::without_gpu("compare_wrong");
    write(&folder, "a.exr", [8, 8], plain);
    write(&folder, "wide.exr", [16, 8], plain);
    write(&folder, "high.exr", [8, 16], plain);
    fs::write(folder.path("garbage.exr"), b"no exr").expect("the folder can be written");
    let whole = fs::read(folder.path("a.exr")).expect("it was written");
    fs::write(folder.path("cut.exr"), &whole[..whole.len() / 2]).expect("the folder can be written");
    let before = folder.files();
    for name in ["wide.exr", "high.exr", "missing.exr", "garbage.exr", "cut.exr", "."] {
        for pair in [["a.exr", name], [name, "a.exr"]] {
            let run = folder.lab(&["compare", pair[0], pair[1]]);
            run.failed(1, name);
            assert!(run.stderr.contains(name), "{pair:?}: the line names the file: {}", run.stderr);
            assert!(run.stdout.is_empty(), "{pair:?}: {}", run.stdout);
            assert_eq!(folder.files(), before, "{pair:?}");
        }
    }
    let wrong: [&[&str]; 3] = [&["compare", "a.exr"], &["compare", "a.exr", "a.exr", "--tile", "0"], &["contrast"]];
    for arguments in wrong {
        folder.lab(arguments).failed(2, &format!("{arguments:?}"));
        assert_eq!(folder.files(), before, "{arguments:?}");
    }
}

/// A row for each figure, of the preset and of a variant.
#[test]
#[ignore = "second tier: ./run test --more"]
fn frames_have_a_row_for_each_figure() {
    let Some(folder) = Folder::new("frames") else { return };
    let scene = crate::support::cli::asset("cornell.glb").display().to_string();
    let short = ["--seeds", "2", "--warmup", "1", "--frames", "1", "--centers", "16", "--out", "tables"];
    let variants = ["--variant", "bounces=1", "--variant", "resolution_scale=0.5"];
    folder.lab(&[&["frames", &scene], &variants[..], &short[..]].concat()).succeeded();
    let table = fs::read_to_string(folder.path("tables/frames.csv")).expect("the table was written");
    let value = |section: &str, row: &str| {
        let line = table.lines().find(|line| line.starts_with(&format!("{section},{row},")));
        let field = line.and_then(|line| line.rsplit(',').next()).unwrap_or_default();
        field.parse::<f64>().unwrap_or_else(|_| panic!("{section}, {row}: {table}"))
    };
    for section in ["Balanced", "bounces=1", "resolution_scale=0.5"] {
        for row in [
            "relMSE without the worst percent",
            "relMSE",
            "MAPE",
            "FLIP",
            "standard error of energy",
            "lighting",
            "memory",
        ] {
            assert!(value(section, row) > 0.0, "{section}, {row}: {table}");
        }
    }
    // A quarter of the pixels is traced, and the memory of the scene and of the light subsets does not count.
    assert!(value("resolution_scale=0.5", "memory") < 0.5 * value("Balanced", "memory"), "{table}");
    // The light of later bounces is missing.
    assert!(value("bounces=1", "energy") < value("Balanced", "energy") - 0.1, "{table}");
}

/// Each technique beside the first one, at equal time.  With jitter, the edges of the lamp have most of the error.
#[test]
#[ignore = "second tier: ./run test --more"]
fn techniques_at_equal_time_have_a_row_beside_the_first_one() {
    let Some(folder) = Folder::new("equal") else { return };
    let scene = asset("cornell.glb").display().to_string();
    let short = ["--size", "16x16", "--warmup", "2", "--frames", "2", "--seeds", "2", "--samples", "64"];
    let fixed = ["equal-time", &scene, "--set", "jitter=Always", "--bounces", "2", "--out", "tables"];
    folder.lab(&[&fixed[..], &short[..]].concat()).succeeded();
    let table = fs::read_to_string(folder.path("tables/equal-time.csv")).expect("the table was written");
    let numbers = |part: &str| -> Vec<f64> {
        let lines = table.lines().filter(|line| line.contains(part));
        lines.filter_map(|line| line.rsplit(',').next()?.parse().ok()).collect()
    };
    let ratios = numbers("ReSTIR PT in equal time: its error");
    // Three of whole pictures, and two without emitters.
    assert!(ratios.len() == 2 * 5 && ratios.iter().all(|ratio| *ratio > 0.0), "{table}");
    assert!((1.0..99.0).contains(&numbers(",pixels without emitters,")[0]), "{table}");
    let without = numbers(",error without emitters,,MSE,");
    // The first error is that of the reference tracer, the others are those of the techniques.
    let whole = &numbers(",error,,MSE,")[1..];
    assert_eq!((whole.len(), without.len()), (3, 3), "{table}");
    assert!(whole.iter().zip(&without).all(|(whole, without)| 0.0 < *without && 2.0 * without < *whole), "{table}");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn times_of_the_techniques_that_are_asked_for_have_a_row_each() {
    let Some(folder) = Folder::new("times") else { return };
    let scene = asset("cornell.glb");
    let times = |only: &str| {
        let scene = scene.to_str().expect("the path is text");
        folder.lab(&["times", scene, "--size", "16x16", "--frames", "4", "--only", only, "--out", "tables"])
    };
    times("Di Balanced").succeeded();
    let table = fs::read_to_string(folder.path("tables/times.csv")).expect("it was written");
    let row =
        |start: &str| table.lines().find(|line| line.starts_with(start)).unwrap_or_else(|| panic!("{start}: {table}"));
    let last = |start: &str| row(start).rsplit(',').next().and_then(|text| text.parse::<f64>().ok());
    for start in ["Di,Balanced,", "\"Passes of Di, Balanced\",di_reuse,"] {
        assert!(last(start).is_some_and(|ms| ms > 0.0), "{table}");
    }
    assert!(!table.lines().any(|line| line.starts_with("Pt,")), "{table}");
}

/// The command fails if a shader no longer has the text that a fault replaces.
#[test]
fn planted_faults_fit_the_shaders() {
    let folder = Folder::without_gpu("plants");
    let listed = folder.lab(&["plants", "--list"]);
    listed.succeeded();
    assert_eq!(listed.stdout.lines().count(), 25, "{listed:?}");
    folder.lab(&["plants", "--list", "--only", "no such fault"]).failed(2, "no such fault");
}

/// Commands that measure a glTF file and write a table, a report or a picture into `--out`.
const OF_A_SCENE: [&str; 13] = [
    "ablate",
    "equal-time",
    "steps",
    "thresholds",
    "resolutions",
    "times",
    "frames",
    "motion",
    "bias",
    "budget",
    "sweep",
    "presets",
    "demo",
];

#[test]
fn a_missing_scene_and_an_unwritable_folder_give_one_line_and_leave_nothing() {
    let folder = Folder::without_gpu("lab_unwritable");
    fs::write(folder.path("file"), "").expect("the folder can be written");
    let scene = asset("cornell.glb").display().to_string();
    for command in OF_A_SCENE {
        folder.lab(&[command, "missing.glb", "--out", "new/tables"]).failed(1, command);
        let run = folder.lab(&[command, &scene, "--out", "file/tables"]);
        run.failed(1, command);
        assert!(run.stderr.contains("file/tables"), "{command}: {}", run.stderr);
        assert_eq!(folder.files(), ["file"], "{command}");
    }
    for command in [
        "scale",
        "subsurface",
        "characters",
        "instances",
        "rays",
        "extremes",
        "soak",
        "materials",
        "fuzz",
        "broken-files",
    ] {
        folder.lab(&[command, "--out", "file/tables"]).failed(1, command);
        assert_eq!(folder.files(), ["file"], "{command}");
    }
}

#[test]
fn arguments_that_do_not_fit_each_other_give_exit_code_2() {
    let folder = Folder::without_gpu("lab_arguments");
    let scene = asset("cornell.glb").display().to_string();
    let wrong: [&[&str]; 17] = [
        &["bias", &scene, "--only", "no such setting"],
        &["bias", &scene, "--seeds", "1"],
        &["extremes", "--axes", "time"],
        &["equal-time", &scene, "--set", "jitter=Sometimes"],
        // The row of each technique, and the bounces in the header, would be others than stated.
        &["equal-time", &scene, "--set", "technique=di"],
        &["equal-time", &scene, "--set", "jitter=Always bounces=2"],
        &["steps", &scene, "--set", "bounces=2"],
        &["frames", &scene, "--variant", "accumulate=true"],
        &["frames", &scene, "--variant", "bounces=1 debug_view=Depth"],
        &["steps", &scene, "--variant", "seed=3"],
        &["motion", &scene, "--variant", "reset=true"],
        &["times", &scene, "--only", "Di Nothing"],
        &["budget", &scene, "--least-resolution-scale", "0.2"],
        &["budget", &scene, "--least-resolution-scale", "nan"],
        &["fuzz", "--shrink", "0"],
        &["fuzz", "--count", "1", "--shrink", "0.99999"],
        &["fuzz", "--count", "1", "--shrink", "first"],
    ];
    for arguments in wrong {
        folder.lab(&[arguments, &["--out", "tables"][..]].concat()).failed(2, &format!("{arguments:?}"));
        assert!(folder.files().is_empty(), "{arguments:?}");
    }
}

/// `lab ablate`: a row whose settings are clamped, or those of another row, would have a wrong label.
#[test]
fn rows_that_compare_parts_of_direct_light_have_settings_of_their_own() {
    let all = series::entries();
    for (section, rows) in [
        ("Bitterli et al. 2020", 2),
        ("Decoupled shading (7.1)", 4),
        ("Kinds of reuse (6.3)", 7),
        ("Rays by purpose", 6),
        ("Confidence cap", 8),
        ("Correlation by presampled lights (5.2)", 5),
    ] {
        let of: Vec<&series::Entry> = all.iter().filter(|entry| entry.section == section).collect();
        assert_eq!(of.len(), rows, "{section}");
        for (i, entry) in of.iter().enumerate() {
            assert!(entry.settings.clone().validate().is_empty(), "{section}: {}", entry.label);
            let same = of[..i].iter().find(|other| other.settings == entry.settings);
            assert!(same.is_none(), "{section}: {} is {}", entry.label, same.map_or("", |other| &other.label));
        }
    }
    let caps = all.iter().filter(|entry| entry.section == "Confidence cap");
    assert_eq!(caps.map(|entry| entry.settings.direct.reuse.confidence_cap).fold(0.0, f32::max), 250.0);
}

/// `lab steps`: each row changes something, the first has no pairs, and a row is what users get.
#[test]
fn steps_begin_without_pairs_and_reach_the_default() {
    let mut default = series::plain(Technique::Pt, 8);
    let rows = series::steps(&default);
    for (i, (name, settings)) in rows.iter().enumerate() {
        assert!(settings.clone().validate().is_empty(), "{name}");
        assert!(rows[..i].iter().all(|(_, other)| other != settings), "{name} is another row");
    }
    let first = &rows[0].1;
    assert!(first.paths.separate_direct_light && !first.paths.reuse.paired);
    // As in Wyman and Panteleev 2021.
    let direct = &first.direct.reuse;
    assert!(!direct.paired && direct.order == ReuseOrder::Spatiotemporal);
    assert_eq!((direct.spatial_samples, direct.radius, direct.confidence_cap), (1, 30.0, 20.0));
    default.paths.separate_direct_light = true;
    let reached = rows.iter().find(|(name, _)| name.ends_with("(the default)"));
    assert_eq!(reached.map(|(_, settings)| settings), Some(&default));
}

/// Times and errors of fewer pixels would pass for those of the picture that was asked for.
#[test]
fn a_picture_that_a_device_traces_with_fewer_pixels_does_not_fit() {
    // Radiance takes 16 bytes a pixel.
    let Some(mut rig) = Rig::binding_at_most(1 << 20, 320, 256) else { return };
    let view = View { camera: rig.camera, capture: rig.capture.clone() };
    rig.app.insert_resource(view);
    rig.until_ready();
    let error = headless::fits(&mut rig.app, UVec2::new(320, 256)).expect_err("1.25 MiB are too many");
    assert!(error.contains("320 x 256") && error.contains("does not fit"), "{error}");
    rig.set(|restir| restir.resolution_scale = 0.5);
    rig.until_ready();
    assert_eq!(headless::fits(&mut rig.app, UVec2::new(160, 128)), Ok(()));
}
