//! `lab extremes`, `lab bias` and `lab motion`: the rows and figures of their tables.

use crate::support::cli::{Folder, asset};
use bevy_restir::{Preset, Restir};
use bevy_restir_support::fields;
use std::fs;

#[path = "../../examples/lab/bias/list.rs"]
#[allow(dead_code, reason = "the program uses more of it")]
mod list;

/// Figures of the row with this label, one list for each quantity.
fn figures(table: &str, label: &str) -> Vec<Vec<f64>> {
    let numbers = |fields: &str| fields.split(',').skip(2).map(|field| field.parse().unwrap_or(f64::NAN)).collect();
    table.lines().filter_map(|line| Some(numbers(line.split_once(&format!(",{label},"))?.1))).collect()
}

/// A closed room whose walls glow has the light of a geometric series, whatever its bounces and its height, and a plane under a sun has that of
/// a closed form.
#[test]
#[ignore = "second tier: ./run test --more"]
fn extremes_have_a_row_for_each_value() {
    let Some(folder) = Folder::new("extremes") else { return };
    let short = ["--size", "16x16", "--seeds", "4", "--frames", "4", "--techniques", "reference,di", "--out", "tables"];
    folder.lab(&[&["extremes", "--axes", "bounces,gap,sun"], &short[..]].concat()).succeeded();
    let table = fs::read_to_string(folder.path("tables/extremes.csv")).expect("the table was written");
    let exact = [
        "1 bounce",
        "2 bounces",
        "4 bounces",
        "8 bounces",
        "16 bounces",
        "32 bounces",
        "64 bounces",
        "room 0.1 m high",
        "sun at 45°",
        "sun at 0.1°",
    ];
    for label in exact {
        // The last two rows with this label: the first may be among those that differ.
        let rows = figures(&table, label);
        let [.., differences, errors] = &rows[..] else { panic!("{label}: {table}") };
        assert_eq!((differences.len(), errors.len()), (2, 2), "{label}: {table}");
        for (difference, error) in differences.iter().zip(errors) {
            // Percent; four runs estimate their own noise badly.
            assert!(difference.abs() < 6.0 && *error < 4.0, "{label}: {difference} ± {error}: {table}");
        }
    }
    assert!(!figures(&table, "room 1e-5 m high").is_empty(), "{table}");
}

/// Light without shadows is brighter, and the preset itself is not biased.
#[test]
#[ignore = "second tier: ./run test --more"]
fn the_bias_of_a_setting_has_its_sign_and_size() {
    let Some(folder) = Folder::new("bias") else { return };
    let scene = asset("cornell.glb").display().to_string();
    let short =
        ["--size", "16x16", "--seeds", "4", "--warmup", "2", "--frames", "4", "--samples", "512", "--out", "tables"];
    let measured = |name: &str| {
        folder.lab(&[&["bias", &scene, "--only", &format!("Pt, at rest: {name}")], &short[..]].concat()).succeeded();
        let table = fs::read_to_string(folder.path("tables/bias.csv")).expect("the table was written");
        let figures = figures(&table, name).concat();
        let [difference, error, squares] = figures[..] else { panic!("{table}") };
        assert!(error > 0.0 && error < 5.0 && squares > 0.0, "{table}");
        (difference, error)
    };
    // Percent.
    let (unchanged, error) = measured(list::UNCHANGED);
    assert!(unchanged.abs() < 2.5, "{unchanged} ± {error}");
    let (bright, error) = measured("direct.visibility: Ignored");
    assert!(bright > 1.0 && bright > 3.0 * error, "{bright} ± {error}");
}

/// A row whose settings are clamped or those of another row would have a wrong label.
#[test]
fn biased_settings_are_valid_and_differ() {
    let mut seen: Vec<(String, bool, Restir)> = Vec::new();
    for setting in &list::SETTINGS {
        let plain = Restir { technique: setting.technique, ..Restir::preset(Preset::Unbiased) };
        let (name, mut changed) = (setting.full_name(), plain.clone());
        assert_eq!(fields::set_in_range(&mut changed, setting.fields.split_whitespace()), Ok(()), "{name}");
        assert!(changed.clone().validate().is_empty(), "{name}");
        assert_eq!(changed == plain, setting.name == list::UNCHANGED, "{name}");
        let known = seen.iter().find(|known| known.0 == name || (known.1 == setting.in_motion && known.2 == changed));
        assert!(known.is_none(), "{name} is {:?}", known.map(|known| &known.0));
        seen.push((name, setting.in_motion, changed));
    }
}

/// Without `--variant`, methods for surfaces that come into view are compared, and motions have plots.
#[test]
#[ignore = "second tier: ./run test --more"]
fn errors_of_new_surfaces_are_curves() {
    let Some(folder) = Folder::new("motion") else { return };
    let scene = asset("cornell.glb").display().to_string();
    let short = ["--size", "24x24", "--seeds", "1", "--samples", "16", "--technique", "di", "--out", "tables"];
    folder.lab(&[&["motion", &scene, "--preset", "unbiased"], &short[..]].concat()).succeeded();
    let table = fs::read_to_string(folder.path("tables/motion.csv")).expect("the table was written");
    let section =
        "an object passes: share of the pixels; errors with Unbiased; without dual motion vectors; one neighbor";
    assert!(table.contains(section), "{table}");
    // A share and four errors, for each of three motions.
    let rows = figures(&table, "in view for 0 frames");
    assert_eq!(rows.len(), 3 * 5, "{table}");
    assert!(rows.iter().skip(10).all(|row| row[0] > 0.0), "the object uncovers surfaces: {table}");
    let plot = fs::read_to_string(folder.path("tables/motion-cornell-pass.svg")).expect("it was written");
    assert!(plot.starts_with("<svg") && plot.contains("without dual motion vectors"), "{plot}");
}
