//! Mutants: wrong edits of the shaders.  Each must make a test of the first or second tier fail, and two of three one of the first.
//!
//! A mutant runs in a process of its own: this test program again, with the tests that should find it.  The process makes the edit
//! where it loads shaders (`bevy_restir_support::mutant`).  Results are stored by commit, so that a run continues where the last one
//! stopped, and become a table of `docs/proof-matrix.md`.

mod light_paths;
mod lights;
mod picture;
mod resampling;
mod shifts;
mod surfaces;

use crate::{
    support::{
        app::SHADER_ERROR,
        gpu::gpu,
        stored_results::{Part, commit, folder_of, publish, read, write},
    },
    techniques::{bdpt, confidence, previous_frame, pt},
};
use bevy_restir::testing::shader_library::MODULES;
use serde_json::{Value, json};
use std::{
    borrow::Cow,
    collections::BTreeSet,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Instant,
};

/// A wrong edit of a shader.
#[derive(Clone)]
struct Mutant {
    name: Cow<'static, str>,
    /// The path below `shaders/`.
    file: &'static str,
    /// A text that occurs once in the file, and its replacement.
    old: &'static str,
    new: &'static str,
    /// Parts of the names of tests of the first two tiers, those that take less time first; at least one of the tests must fail.
    tests: &'static [&'static str],
}

const fn mutant(
    name: &'static str,
    file: &'static str,
    old: &'static str,
    new: &'static str,
    tests: &'static [&'static str],
) -> Mutant {
    Mutant { name: Cow::Borrowed(name), file, old, new, tests }
}

/// An edit that tests of the later tiers plant: its name, file, text and replacement.
type Edit = (&'static str, &'static str, &'static str, &'static str);

/// Such edits that the first two tiers find, too: their kind, and the tests that find them.
const PLANTED: [(&str, &[Edit], &[&str]); 6] = [
    ("read of the last frame", &previous_frame::WRONG, &["reads_of_the_last_frame_equal_those_of_that_frame"]),
    ("condition of the shift", &pt::reconnection_choice::UNTESTED, &["paths_that_are_often_replayed"]),
    ("confidence", &confidence::WRONG, &["confidence_follows_its_recursion"]),
    (
        "replay of light paths in the last frame",
        &bdpt::light_reuse::WRONG,
        &["light_paths_of_the_last_frame_are_replayed"],
    ),
    (
        "reuse of light paths",
        &[bdpt::light_reuse::PLANTED[0]],
        &["debug_views_show_reservoirs_of_light_paths", "reused_caustics_equal"],
    ),
    (
        "reconnected light path",
        &bdpt::reconnected::WRONG,
        &["the_shift_of_reconnected_light_paths_is_a_change_of_variables"],
    ),
];

/// All of them: one for each formula family, criterion, MIS kind, guard, read of the last frame, and packing.
fn all() -> Vec<Mutant> {
    let planted = PLANTED.iter().flat_map(|&(kind, edits, tests)| {
        edits.iter().map(move |&(name, file, old, new)| {
            let name = Cow::Owned(format!("{kind}: {name}"));
            Mutant { name, file, old, new, tests }
        })
    });
    [resampling::MUTANTS, shifts::MUTANTS, lights::MUTANTS, surfaces::MUTANTS, light_paths::MUTANTS, picture::MUTANTS]
        .concat()
        .into_iter()
        .chain(planted)
        .collect()
}

/// Asserts that an edit changes one place of its shader.
fn assert_changes_one_place(name: &str, file: &str, old: &str) {
    let (_, text) = MODULES.iter().find(|(path, _)| *path == file).expect(file);
    assert_eq!(text.matches(old).count(), 1, "{name}: {old}");
}

#[test]
fn every_mutant_edits_one_place() {
    let (mut edits, mut files) = (BTreeSet::new(), BTreeSet::new());
    for mutant in all() {
        assert_changes_one_place(&mutant.name, mutant.file, mutant.old);
        assert_ne!(mutant.old, mutant.new, "{}", mutant.name);
        assert!(edits.insert((mutant.file, mutant.old, mutant.new)), "{}: another mutant has this edit", mutant.name);
        assert!(files.insert(mutant.file_name()), "{}: another mutant has this name", mutant.name);
    }
}

/// The remaining edits that tests of the later tiers plant: here it shows at once if a shader has changed.
#[test]
fn every_planted_edit_changes_one_place() {
    for (name, file, old, _) in bdpt::light_reuse::PLANTED {
        assert_changes_one_place(name, file, old);
    }
}

/// The processes of mutants run no tests of the third tier: a mutant that names only such tests could never be found.
#[test]
fn every_mutant_names_tests_of_the_first_two_tiers() {
    let listed = |arguments: &[&str]| {
        let output = this_program().args(arguments).output().expect("the program runs");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        text.lines().filter_map(|line| line.strip_suffix(": test")).map(str::to_owned).collect::<BTreeSet<String>>()
    };
    let both_tiers = listed(&[&["--list"], ONE_MUTANT].concat());
    let ignored = listed(&["--list", "--ignored"]);
    let first: Vec<&String> = both_tiers.difference(&ignored).collect();
    assert!(first.len() > 100, "{first:?}");
    // A module often has the name of one of its tests: it is meant only where no test has the name.
    let last = |path: &str| path.rsplit("::").next().unwrap_or_default().to_owned();
    let names: Vec<String> = both_tiers.iter().map(|path| last(path)).collect();
    let is_named = |path: &str, test: &str| match names.iter().any(|name| name.contains(test)) {
        true => last(path).contains(test),
        false => path.contains(test),
    };
    let mut later = 0;
    for mutant in all() {
        for test in mutant.tests {
            assert!(both_tiers.iter().any(|path| is_named(path, test)), "{}: there is no {test}", mutant.name);
        }
        later += usize::from(!mutant.tests.iter().any(|test| first.iter().any(|path| is_named(path, test))));
    }
    eprintln!("{later} of {} mutants are left to the second tier", all().len());
    assert!(3 * later <= all().len(), "the first tier is said to find two of three");
}

/// Arguments with which a process of a mutant chooses among the tests.
const ONE_MUTANT: &[&str] = &["--include-ignored", "--skip", "mutants::", "--skip", "full_length"];

/// The marks of the table in the document, and the folder of the results.
const NAME: &str = "mutants";

/// `MUTANT=NAME` runs one of them, even if it has a result, and leaves the table as it is.  With `MUTANT_PART=0/2` a process runs every
/// second one and leaves the others to a second process with `MUTANT_PART=1/2`.
#[test]
#[ignore = "an hour: ./run test --full"]
fn full_length_tests_find_every_mutant() {
    let Some(gpu) = gpu() else { return };
    let (all, commit) = (all(), commit());
    let folder = folder_of(NAME, &commit);
    let (only, part) = (std::env::var("MUTANT").ok(), Part::from_environment("MUTANT_PART"));
    let is_wanted = |i: usize, mutant: &Mutant| match &only {
        Some(name) => mutant.name == *name,
        None => part.has(i) && !mutant.path(&folder).exists(),
    };
    let wanted: Vec<&Mutant> = all.iter().enumerate().filter(|(i, m)| is_wanted(*i, m)).map(|(_, m)| m).collect();
    assert!(only.is_none() || !wanted.is_empty(), "no mutant has the name {only:?}");
    for mutant in wanted {
        let result = mutant.result();
        eprint!("{}", line(&result));
        write(&mutant.path(&folder), &result);
    }
    let results: Vec<Value> = all.iter().filter_map(|mutant| read(&mutant.path(&folder))).collect();
    let missed: Vec<&Value> = results.iter().filter(|result| result["found by"].is_null()).collect();
    let table = format!(
        "Commit {commit}, {}: {} of {} mutants have run, and {} were not found.\n\n\
        | mutant | file | found by | seconds |\n|---|---|---|---|\n{}",
        gpu.name,
        results.len(),
        all.len(),
        missed.len(),
        results.iter().map(line).collect::<String>()
    );
    if only.is_none() {
        publish(NAME, &table);
    }
    assert!(missed.is_empty(), "not found: {missed:#?}");
}

/// The line of the table for a result.
fn line(result: &Value) -> String {
    let [name, file] = ["name", "file"].map(|key| result[key].as_str().unwrap_or_default());
    let found = result["found by"].as_str().map_or("**not found**".to_owned(), |test| format!("`{test}`"));
    format!("| {name} | {file} | {found} | {} |\n", result["seconds"])
}

impl Mutant {
    /// The name of the file of its result.
    fn file_name(&self) -> String {
        self.name.replace(|c: char| !c.is_alphanumeric(), "_") + ".json"
    }

    fn path(&self, folder: &Path) -> PathBuf {
        folder.join(self.file_name())
    }

    /// Runs its tests, one after the other, until one of them fails.
    fn result(&self) -> Value {
        let start = Instant::now();
        let found = self.tests.iter().find(|test| !self.passes(test));
        let seconds = start.elapsed().as_secs();
        json!({ "name": self.name, "file": self.file, "found by": found, "seconds": seconds })
    }

    /// Whether the tests of this name pass with the edit.
    fn passes(&self, test: &str) -> bool {
        let output = this_program()
            .arg(test)
            .args(ONE_MUTANT)
            .env("MUTANT_FILE", self.file)
            .env("MUTANT_OLD", self.old)
            .env("MUTANT_NEW", self.new)
            .env_remove("PROOF_ROWS")
            .stderr(Stdio::null())
            .output()
            .expect("the program runs");
        let text = String::from_utf8_lossy(&output.stdout);
        assert!(!text.contains(SHADER_ERROR), "{} is no mutant: {text}", self.name);
        output.status.success()
    }
}

/// This test program.
fn this_program() -> Command {
    Command::new(std::env::current_exe().expect("this program has a path"))
}
