//! Mutants: wrong edits of the shaders.  Each must make a test of the first tier fail.
//!
//! A mutant runs in a process of its own: this test program again, with the tests that should find it.  The process makes the edit
//! where it loads shaders (`bevy_restir_support::mutant`).

mod resampling;
mod scene;

use crate::techniques::{bdpt, confidence, previous_frame, pt};
use bevy_restir::testing::shader_library::MODULES;
use std::process::{Command, Stdio};

/// A wrong edit of a shader.
struct Mutant {
    name: &'static str,
    /// The path below `shaders/`.
    file: &'static str,
    /// A text that occurs once in the file, and its replacement.
    old: &'static str,
    new: &'static str,
    /// Parts of the names of tests of the first tier; at least one of the tests must fail.
    tests: &'static [&'static str],
}

const fn mutant(
    name: &'static str,
    file: &'static str,
    old: &'static str,
    new: &'static str,
    tests: &'static [&'static str],
) -> Mutant {
    Mutant { name, file, old, new, tests }
}

/// All of them: one for each formula family, criterion, MIS kind, read of the last frame, and packing.
fn all() -> impl Iterator<Item = &'static Mutant> {
    resampling::MUTANTS.iter().chain(scene::MUTANTS)
}

#[test]
fn every_mutant_edits_one_place() {
    for mutant in all() {
        let (_, text) = MODULES.iter().find(|(path, _)| *path == mutant.file).expect(mutant.file);
        assert_eq!(text.matches(mutant.old).count(), 1, "{}: {}", mutant.name, mutant.old);
        assert_ne!(mutant.old, mutant.new, "{}", mutant.name);
    }
}

/// Edits that tests of the later tiers plant themselves, as (name, file, text, replacement): here it shows at once if a shader has changed.
#[test]
fn every_planted_edit_changes_one_place() {
    let edits = [
        &confidence::WRONG[..],
        &previous_frame::WRONG,
        &pt::reconnection_choice::UNTESTED,
        &bdpt::light_reuse::WRONG,
        &bdpt::light_reuse::PLANTED,
    ];
    for (name, file, old, _) in edits.into_iter().flatten() {
        let (_, text) = MODULES.iter().find(|(path, _)| path == file).expect(file);
        assert_eq!(text.matches(old).count(), 1, "{name}: {old}");
    }
}

/// `MUTANT=NAME` runs one of them.
#[test]
#[ignore = "an hour: ./run test --full"]
fn full_length_tests_find_every_mutant() {
    let only = std::env::var("MUTANT").ok();
    let mut missed = Vec::new();
    for mutant in all().filter(|mutant| only.as_ref().is_none_or(|name| name == mutant.name)) {
        let start = std::time::Instant::now();
        let found = mutant.tests.iter().find(|test| !passes(mutant, test));
        let seconds = start.elapsed().as_secs_f64();
        println!("| {} | {} | {} | {seconds:.0} s |", mutant.name, mutant.file, found.unwrap_or(&"NOT FOUND"));
        if found.is_none() {
            missed.push(mutant.name);
        }
    }
    assert!(missed.is_empty(), "not found: {missed:?}");
}

/// Whether the tests of this name pass with the edit.
fn passes(mutant: &Mutant, test: &str) -> bool {
    let program = std::env::current_exe().expect("this program has a path");
    let output = Command::new(program)
        .args([test, "--skip", "mutants::"])
        .env("MUTANT_FILE", mutant.file)
        .env("MUTANT_OLD", mutant.old)
        .env("MUTANT_NEW", mutant.new)
        .env_remove("PROOF_ROWS")
        .stderr(Stdio::null())
        .output()
        .expect("the program runs");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(!text.contains("running 0 tests"), "{}: no test is named {test}", mutant.name);
    output.status.success()
}
