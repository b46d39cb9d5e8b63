//! `lab sweep`: fronts of time and error, from which it takes its advice, and the program as users call it.

use crate::support::{
    cli::{Folder, asset},
    gltf::Scene,
};
use bevy_restir::Restir;
use bevy_restir_support::{
    fields,
    front::{Budget, Point, at_time, best_within, budgets, fastest_within, front},
};
use std::fs;

#[path = "../../examples/lab/sweep/plan.rs"]
#[allow(dead_code, reason = "the program uses more of it")]
mod plan;

#[path = "../../examples/lab/sweep/eligibility.rs"]
mod eligibility;

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

/// The first two of the list are presets; the others are faster or more accurate by less than noise.
#[test]
fn noise_brings_no_point_to_the_front() {
    let all = points(&[(2.0, 0.5), (4.0, 0.2), (1.99, 0.495), (3.0, 0.495), (5.0, 0.197)]);
    assert_eq!(front(&all), [0, 1]);
    // Small steps that add up count.
    let all = points(&[(1.0, 0.5), (2.0, 0.495), (3.0, 0.485), (4.0, 0.48)]);
    assert_eq!(front(&all), [0, 2]);
}

#[test]
fn advice_lies_on_the_front_and_within_the_budget() {
    let all = points(&[(4.0, 0.2), (1.0, 0.9), (2.0, 0.5), (3.0, 0.6)]);
    assert_eq!(fastest_within(&all, 0.55), Some(2));
    assert_eq!(fastest_within(&all, 0.1), None);
    // Noise keeps the second one off the front, but the first one is not accurate enough.
    assert_eq!(fastest_within(&points(&[(1.0, 0.101), (1.05, 0.0999), (3.0, 0.05)]), 0.1), Some(1));
    assert_eq!(best_within(&all, 3.5), Some(2));
    assert_eq!(best_within(&all, 0.5), None);
}

#[test]
fn a_pick_is_compared_with_the_best_of_all_points_within_its_budget() {
    let all = points(&[(1.0, 0.8), (2.0, 0.4), (4.0, 0.2), (8.0, 0.1), (3.0, 0.1), (1.5, f64::NAN)]);
    let few = &all[..4];
    let ratio = |budget: Budget| {
        let (pick, best) = (budget.pick(few)?, budget.best(&all)?);
        Some(budget.cost(few[pick]) / budget.cost(all[best]))
    };
    // Within an error the times count: 2 of 2, and 8 instead of 3.  Within a time the errors do: 0.2 instead of 0.1.
    for (budget, expected) in [
        (Budget::Error(0.5), Some(1.0)),
        (Budget::Error(0.1), Some(8.0 / 3.0)),
        (Budget::Error(0.05), None),
        (Budget::Time(2.0), Some(1.0)),
        (Budget::Time(5.0), Some(2.0)),
        (Budget::Time(0.5), None),
    ] {
        assert_eq!(ratio(budget), expected, "{budget:?}");
    }
    // Without noise in mind, the slightest lead counts.
    let close = points(&[(1.0, 0.500), (1.0, 0.499)]);
    assert_eq!(Budget::Time(1.0).best(&close), Some(1));
    let between = Budget::between(few);
    assert_eq!(between.len(), 6);
    let is_within = |budget: &Budget| match *budget {
        Budget::Error(error) => (0.1..=0.8).contains(&error),
        Budget::Time(time) => (1.0..=8.0).contains(&time),
    };
    assert!(between.iter().all(is_within), "{between:?}");
    assert!(between.iter().all(|budget| budget.pick(few).is_some()), "{between:?}");
    assert_eq!(Budget::between(&[]), []);
}

/// Figures of `docs/trade.md`: bias, its standard error, bias of blocks and error.  Behind a door ajar, eight bounces miss a seventh of the light.
#[test]
fn settings_that_miss_much_light_are_not_recommended() {
    for (name, [bias, standard_error, block_bias, error], share, is_left_out) in [
        ("ajar, Gi Balanced", [-0.145, 0.027, 0.308, 0.165], 57, true),
        ("ajar, Pt Performance", [-0.380, 0.008, 0.594, 0.362], 97, true),
        ("ajar, Bdpt Quality", [-0.001, 0.009, 0.0, 0.0834], 0, false),
        ("blinds, Pt Performance", [-0.102, 0.003, 0.200, 0.162], 25, false),
        ("cornell, Pt Balanced", [-0.001, 0.002, 0.00922, 0.00924], 1, false),
        ("a bias that may be noise", [-0.05, 0.02, 0.4, 0.2], 80, false),
        ("an error without the worst pixels that is less than the bias", [-0.4, 0.01, 0.5, 0.1], 100, true),
        ("no error", [0.0; 4], 0, false),
    ] {
        let found = eligibility::share_of_bias(block_bias, error);
        assert_eq!((100.0 * found).round(), f64::from(share), "{name}");
        assert_eq!(eligibility::is_mostly_bias([bias, standard_error], found), is_left_out, "{name}");
    }
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
    // Beyond the ends the slope is that of the whole curve.
    let uneven = points(&[(1.0, 4.0), (2.0, 1.0), (4.0, 1.0)]);
    for (time, error) in [(0.5, 8.0), (1.0, 4.0), (3.0, 1.0), (4.0, 1.0), (8.0, 0.5)] {
        assert!((at_time(&uneven, time).expect("a curve") - error).abs() < 1e-12, "{time}");
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

/// It must take less than ten minutes on two cores.
#[test]
fn the_first_report_has_40_configurations_and_a_full_one_has_them_too() {
    use plan::Extent;
    let names = |extent, only_first: bool| -> Vec<String> {
        let all = plan::configurations(extent).into_iter();
        all.filter(|c| c.is_first || !only_first).map(|c| c.name()).collect()
    };
    let first = names(Extent::Settings, false);
    assert_eq!(first.len(), 40);
    assert_eq!(names(Extent::Full, true), first);
    assert!(names(Extent::Full, false).len() > 100);
    let of_presets = names(Extent::Presets, false);
    assert!(of_presets.iter().all(|name| first.contains(name)));
    // The reference tracer with two numbers of bounces, four presets of four techniques, and these without reuse.
    assert_eq!(of_presets.len(), 2 + 4 * 4 + 4);
    for technique in ["DI", "GI", "PT", "BDPT"] {
        let name = format!("ReSTIR {technique}, Balanced with a change: no reuse");
        assert!(of_presets.contains(&name), "{of_presets:?}");
    }
    assert!(plan::configurations(Extent::Settings).iter().any(|c| c.changes == ["resolution_scale=0.5"]));
}

#[test]
fn a_field_that_the_user_sets_is_not_changed_by_a_configuration() {
    let given = ["bounces=4".to_owned(), "jitter=Never".to_owned()];
    let all = plan::configurations(plan::Extent::Settings);
    let left_out: Vec<&str> = all.iter().filter(|c| c.overrides(&given)).map(|c| c.label.as_str()).collect();
    assert_eq!(left_out, ["2 bounces", "3 bounces", "1 neighbor, 3 bounces"]);
}

#[test]
fn numbers_out_of_range_are_errors_and_biased_choices_are_not() {
    let set = |text: &str| fields::set_in_range(&mut Restir::default(), text.split(' '));
    for valid in ["paths.reuse.confidence_cap=30", "firefly_limit=0", "direct.visibility=Decoupled", "seed=4294967295"]
    {
        assert_eq!(set(valid), Ok(()), "{valid}");
    }
    for (wrong, range) in [
        ("bounces=2 paths.reuse.confidence_cap=250", "0 to 30"),
        ("bounces=65", "0 to 64"),
        ("firefly_limit=0.5", "1.0"),
        ("paths.footprint=nan", "0 to 1000000"),
        ("direct.subset_size=16384 direct.subset_count=4096", "1 to 512"),
    ] {
        let error = set(wrong).expect_err(wrong);
        assert!(error.contains("out of range") && error.contains(range), "{wrong}: {error}");
    }
}

#[test]
fn wrong_arguments_of_a_sweep_give_one_line() {
    let folder = Folder::without_gpu("sweep_wrong");
    let scene = asset("cornell.glb").display().to_string();
    let wrong: [&[&str]; 14] = [
        &["sweep"],
        &["sweep", &scene, "--only", "no such name"],
        &["sweep", &scene, "--only", "8 bounces", "--set", "bounces=4"],
        // It is measured with --full.
        &["sweep", &scene, "--only", "16 bounces"],
        &["presets", &scene, "--only", "3 bounces"],
        &["sweep", &scene, "--seeds", "1"],
        &["sweep", &scene, "--reference-error", "0"],
        &["sweep", &scene, "--by", "eye"],
        &["presets", &scene, "--full"],
        &["sweep", &scene, "--set", "bounces"],
        &["sweep", &scene, "--set", "paths.reuse.color=1"],
        &["sweep", &scene, "--set", "technique=di"],
        &["sweep", &scene, "--set", "paths.reuse.confidence_cap=250"],
        &["motion", &scene, "--variant", "paths.reuse.confidence_cap=250"],
    ];
    for arguments in wrong {
        folder.lab(arguments).failed(2, &format!("{arguments:?}"));
    }
    for (name, color) in [("black.exr", 0.0), ("nan.exr", f32::NAN)] {
        exr::prelude::write_rgb_file(folder.path(name), 64, 64, |_, _| (color, color, color))
            .expect("it can be written");
    }
    let before = folder.files();
    let unusable: [&[&str]; 7] = [
        &["sweep", "missing.glb"],
        &["sweep", &scene, "--out", "black.exr"],
        &["sweep", &scene, "--out", "black.exr/report"],
        &["sweep", &scene, "--reference", "missing.exr"],
        &["sweep", &scene, "--reference", "black.exr"],
        &["sweep", &scene, "--reference", "nan.exr"],
        &["sweep", &scene, "--into", "missing.md"],
    ];
    for arguments in unusable {
        folder.lab(arguments).failed(1, &format!("{arguments:?}"));
    }
    assert_eq!(folder.files(), before);
}

/// There is nothing to compare.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_scene_without_light_gives_advice_and_leaves_no_folder() {
    let Some(folder) = Folder::new("dark") else { return };
    let dark = folder.gltf("dark.gltf", &Scene { emissive: [0.0; 3], ..Scene::default() }).display().to_string();
    for command in ["sweep", "presets", "equal-time"] {
        let failed = folder.lab(&[command, &dark, "--size", "8x8", "--samples", "2", "--out", "report"]);
        failed.failed(1, command);
        assert!(failed.stderr.contains("--env"), "{command}: {}", failed.stderr);
        assert_eq!(folder.files(), ["dark.gltf"], "{command}: a second call with --env needs the folder");
    }
}

/// The setting that the first report recommends is compared with the best of more than a hundred settings.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_the_advice_is_near_the_best_of_all_settings() {
    /// Times and errors are measured, so that the best of many owes some of its lead to chance.
    const TOLERANCE: f64 = 1.25;
    let Some(folder) = Folder::new("advice") else { return };
    let scene = asset("punctual.glb").display().to_string();
    let short = ["--size", "32x32", "--history", "8", "--samples", "1024", "--out", "report"];
    folder.lab(&[&["sweep", &scene, "--full"], &short[..]].concat()).succeeded();
    let text = fs::read_to_string(folder.path("report/advice.csv")).expect("it was written");
    let rows: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).skip(1).collect();
    assert_eq!(rows.len(), 6, "{text}");
    for row in rows {
        let ratio = row.rsplit(',').next().and_then(|ratio| ratio.parse::<f64>().ok());
        assert!(ratio.is_some_and(|ratio| ratio <= TOLERANCE), "{row}");
    }
}

/// The presets on the smallest picture: all files, one row for each configuration, and nothing measured twice.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_sweep_reports_every_preset_and_continues() {
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
    // Four captured frames of 22 configurations below the head.
    assert_eq!(read("frames.csv").lines().filter(|line| !line.starts_with('#')).count(), 1 + 22 * 4);
    assert!(read("passes.csv").contains("Presets,Pt Balanced,pt_indirect_candidates,"));
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
    assert!(document.contains("ReSTIR PT: no reuse"), "{document}");

    // The figures of an interrupted sweep stay, and the rest is measured.
    let run = |name: &str| folder.path("report/runs").join(name);
    let kept = fs::read_to_string(run("presets-di-balanced.json")).expect("it was written");
    fs::remove_file(run("presets-pt-balanced.json")).expect("it was written");
    folder.lab(&arguments).succeeded();
    assert_eq!(fs::read_to_string(run("presets-di-balanced.json")).expect("it was written"), kept);
    assert!(run("presets-pt-balanced.json").is_file());
    // Another sweep needs another folder.
    let other = folder.lab(&[&arguments[..], &["--set", "bounces=2"]].concat());
    other.failed(1, "another sweep in the folder");
    assert!(other.stderr.contains("another set"), "{}", other.stderr);
    // A sweep that starts over drops the figures of the other one, and writes the command without the option.
    folder.lab(&[&arguments[..], &["--set", "bounces=2", "--only", "Di Performance", "--fresh"]].concat()).succeeded();
    assert!(run("presets-di-performance.json").is_file() && !run("presets-pt-balanced.json").is_file());
    let document = fs::read_to_string(folder.path("trade.md")).expect("it was written");
    assert!(document.contains("--only 'Di Performance'`") && !document.contains("--fresh"), "{document}");
}
