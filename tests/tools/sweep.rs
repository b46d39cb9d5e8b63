//! `lab sweep`: fronts of time and error, from which it takes its advice, and the program as users call it.

use crate::support::{
    cli::{Folder, asset},
    gltf::Scene,
};
use bevy_restir_support::front::{Point, at_time, best_within, budgets, fastest_within, front};
use std::fs;

#[path = "../../examples/lab/sweep/plan.rs"]
#[allow(dead_code, reason = "the program uses more of it")]
mod plan;

fn points(all: &[(f64, f64)]) -> Vec<Point> {
    all.iter().map(|&(time, error)| Point { time, error }).collect()
}

#[test]
fn a_front_holds_the_points_that_no_other_beats() {
    let all = points(&[(4.0, 0.2), (1.0, 0.9), (2.0, 0.5), (3.0, 0.6), (2.0, 0.4), (5.0, f64::NAN), (4.0, 0.2)]);
    assert_eq!(front(&all), [1, 4, 0]);
    // The definition, point by point.
    for (i, p) in all.iter().enumerate().filter(|(_, p)| p.error.is_finite()) {
        let is_beaten =
            all.iter().any(|q| (q.time < p.time && q.error <= p.error) || (q.time <= p.time && q.error < p.error));
        assert_eq!(front(&all).iter().any(|&f| all[f] == *p), !is_beaten, "{i}");
    }
    assert!(front(&[]).is_empty());
}

#[test]
fn advice_lies_on_the_front_and_within_the_budget() {
    let all = points(&[(4.0, 0.2), (1.0, 0.9), (2.0, 0.5), (3.0, 0.6)]);
    assert_eq!(fastest_within(&all, 0.55), Some(2));
    assert_eq!(fastest_within(&all, 0.1), None);
    assert_eq!(best_within(&all, 3.5), Some(2));
    assert_eq!(best_within(&all, 0.5), None);
}

#[test]
fn budgets_divide_a_range_and_are_round() {
    let shown = |all: [f64; 3]| all.map(|b| format!("{b:.4}"));
    assert_eq!(shown(budgets(1.0, 16.0)), ["2.0000", "4.0000", "8.0000"]);
    assert_eq!(shown(budgets(0.01, 0.0777)), ["0.0170", "0.0280", "0.0470"]);
    assert_eq!(shown(budgets(3.0, 3.0)), ["3.0000"; 3]);
}

#[test]
fn a_curve_is_a_power_law_between_and_beyond_its_points() {
    let curve: Vec<Point> = [8.0, 1.0, 2.0].map(|time| Point { time, error: 3.0 / time }).into();
    for time in [0.25, 1.0, 1.5, 2.0, 5.0, 100.0] {
        let error = at_time(&curve, time).expect("three points are a curve");
        assert!((error - 3.0 / time).abs() < 1e-12, "{time}: {error}");
    }
    // A worse point at the time of another one changes nothing.
    let doubled = [&curve[..], &points(&[(2.0, 9.0)])].concat();
    assert_eq!(at_time(&doubled, 1.5), at_time(&curve, 1.5));
    assert_eq!(at_time(&curve[..1], 1.0), None);
    assert_eq!(at_time(&[], 1.0), None);
}

/// A row that repeats another one costs time and tells nothing.
#[test]
fn all_configurations_of_a_sweep_differ() {
    use plan::Extent;
    for extent in [Extent::Presets, Extent::Settings, Extent::Full] {
        let mut seen = Vec::new();
        for configuration in plan::configurations(extent) {
            let settings = configuration.settings(&[]).expect("a plan has valid fields");
            let is_of_grid = configuration.section.contains("combinations");
            let before = seen.iter().find(|(_, known)| *known == settings).map(|(name, _): &(String, _)| name.clone());
            assert!(before.is_none() || is_of_grid, "{} repeats {before:?}", configuration.name());
            seen.push((configuration.name(), settings));
        }
    }
}

#[test]
fn wrong_arguments_of_a_sweep_give_one_line() {
    let folder = Folder::without_gpu("sweep_wrong");
    let scene = asset("cornell.glb").display().to_string();
    let wrong: [&[&str]; 8] = [
        &["sweep"],
        &["sweep", &scene, "--seeds", "1"],
        &["sweep", &scene, "--reference-error", "0"],
        &["sweep", &scene, "--by", "eye"],
        &["presets", &scene, "--full"],
        &["sweep", &scene, "--set", "bounces"],
        &["sweep", &scene, "--set", "paths.reuse.color=1"],
        &["sweep", &scene, "--set", "technique=di"],
    ];
    for arguments in wrong {
        folder.lab(arguments).failed(2, &format!("{arguments:?}"));
    }
    let unusable: [&[&str]; 4] = [
        &["sweep", "missing.glb"],
        &["sweep", &scene, "--reference", "missing.exr"],
        &["sweep", &scene, "--into", "missing.md"],
        &["sweep", &scene, "--only", "no such name"],
    ];
    for arguments in unusable {
        folder.lab(arguments).failed(1, &format!("{arguments:?}"));
    }
    assert!(folder.files().is_empty(), "{:?}", folder.files());
}

/// The presets on the smallest picture: all files, one row for each configuration, and nothing measured twice.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_sweep_reports_every_preset_and_continues() {
    let Some(folder) = Folder::new("sweep") else { return };
    let scene = asset("cornell.glb").display().to_string();
    fs::write(folder.path("trade.md"), "a\n<!-- lab sweep cornell --><!-- /lab sweep cornell -->\nb\n")
        .expect("it can be written");
    let short = ["--size", "16x16", "--seeds", "2", "--history", "2", "--samples", "64", "--out", "report"];
    let arguments = [&["presets", &scene, "--into", "trade.md"], &short[..]].concat();
    folder.lab(&arguments).succeeded();
    let read =
        |name: &str| fs::read_to_string(folder.path("report").join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
    let results = read("results.csv");
    let rows: Vec<&str> = results.lines().filter(|line| line.starts_with("Presets,")).collect();
    assert_eq!(rows.len(), 16, "{results}");
    for technique in ["Di", "Gi", "Pt", "Bdpt"] {
        for preset in ["Performance", "Balanced", "Quality", "Unbiased"] {
            let row = rows.iter().find(|row| row.starts_with(&format!("Presets,{technique} {preset},")));
            let fields: Vec<&str> = row.map(|row| row.split(',').collect()).unwrap_or_default();
            assert!(
                fields.len() == 23 && fields.iter().skip(5).all(|f| f.parse::<f64>().is_ok_and(f64::is_finite)),
                "{row:?}"
            );
        }
    }
    // Four captured frames of 18 configurations below the head.
    assert_eq!(read("frames.csv").lines().filter(|line| !line.starts_with('#')).count(), 1 + 18 * 4);
    assert!(read("passes.csv").contains("Presets,Pt Balanced,pt_candidates,"));
    for file in ["error-over-time.svg", "error-over-frames.svg", "cost-by-pass.svg"] {
        assert!(read(file).starts_with("<svg"), "{file}");
        assert!(read("report.md").contains(file), "{file}");
    }
    assert!(read("report.html").contains("restir.technique = Technique::"));
    let document = fs::read_to_string(folder.path("trade.md")).expect("it was written");
    assert!(
        document.starts_with("a\n") && document.ends_with("\nb\n") && document.contains("Pt Balanced"),
        "{document}"
    );

    // The figures of an interrupted sweep stay, and the rest is measured.
    let run = |name: &str| folder.path("report/runs").join(name);
    let kept = fs::read_to_string(run("presets-di-balanced.json")).expect("it was written");
    fs::remove_file(run("presets-pt-balanced.json")).expect("it was written");
    folder.lab(&arguments).succeeded();
    assert_eq!(fs::read_to_string(run("presets-di-balanced.json")).expect("it was written"), kept);
    assert!(run("presets-pt-balanced.json").is_file());
    // Without a light there is nothing to measure.
    let dark = folder.gltf("dark.gltf", &Scene { emissive: [0.0; 3], ..Scene::default() });
    let dark = dark.display().to_string();
    let failed = folder.lab(&[&["presets", &dark], &short[..8], &["--out", "dark"]].concat());
    failed.failed(1, "a scene without light");
    assert!(failed.stderr.contains("--env"), "{}", failed.stderr);
    // Another sweep needs another folder.
    let other = folder.lab(&[&arguments[..], &["--set", "bounces=2"]].concat());
    other.failed(1, "another sweep in the folder");
    assert!(other.stderr.contains("another set"), "{}", other.stderr);
}
