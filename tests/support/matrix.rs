//! Compares the rows of a pairwise covering set of settings with the reference.  This engine measures the long tables of
//! `docs/proof-matrix.md`.
//!
//! Results are stored in the target folder, by commit, so that a run continues where the last one stopped.  With `MATRIX_MINUTES=6` no
//! row starts after six minutes.  With `MATRIX_PART=0/2` a run measures every second row and leaves the others to a second process with
//! `MATRIX_PART=1/2`; two processes use two cores better where pictures are small.

use super::{
    app::*,
    equivalence::{Comparison, Restarts},
    gpu::gpu,
    proof::{Growing, Proof, Subject},
    small_scenes::*,
    stored_results::{Part, commit, folder_of, publish, read, write},
};
use bevy_restir::testing::plant_shader_defs;
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, HashSet},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

/// The index of the chosen value for each entry of [`Row::CHOICES`].
pub type Choices = [usize; 7];

/// A row of a matrix: one value for each choice.
pub trait Row: Copy {
    /// Names the matrix, its folder, and its marks in the document.
    const NAME: &'static str;
    /// Width and height of the pictures, in pixels.
    const SIZE: u32;
    /// The values of the first choice.
    const SCENES: &'static [&'static str];
    /// The choices by name, and the number of their values.  The first is the scene.
    const CHOICES: [(&'static str, usize); 7];
    /// The shader definition of an error that is planted in the first row, and its description.
    const PLANTED: (&'static str, &'static str);

    fn new(choices: Choices) -> Self;
    fn choices(&self) -> Choices;
    fn scene(&self) -> &'static str {
        Self::SCENES[self.choices()[0]]
    }
    /// The scene of this name, and the camera that looks at it.
    fn rig(name: &str) -> Option<Rig> {
        if name == "moving" { scene(Self::SIZE, moving) } else { Rig::load(name, Self::SIZE) }
    }
    /// Rows that are measured whatever pairs they cover, before all others.
    fn first_rows() -> Vec<Self> {
        Vec::new()
    }
    /// Whether this choice has an effect beside the other choices of the row.
    fn is_relevant(&self, choice: usize) -> bool;
    /// Whether the settings of the row are unbiased and can be measured.
    fn is_testable(&self) -> bool;
    /// Sets what all rows have in common, once for each scene.
    fn prepare(_rig: &mut Rig) {}
    /// The names of the chosen values.
    fn names(&self) -> Vec<String>;
    fn proof(&self) -> Proof<'static>;
    fn subject(&self) -> impl Subject;
}

/// A row counts if it is testable and its irrelevant choices have their first value, so that no two rows are equivalent.
fn is_distinct<R: Row>(row: &R) -> bool {
    row.is_testable() && (0..R::CHOICES.len()).all(|choice| row.is_relevant(choice) || row.choices()[choice] == 0)
}

fn pairs<R: Row>(row: &R) -> Vec<[usize; 4]> {
    let relevant: Vec<usize> = (0..R::CHOICES.len()).filter(|choice| row.is_relevant(*choice)).collect();
    let chosen = row.choices();
    let all = relevant.iter().enumerate().flat_map(|(i, a)| relevant[i + 1..].iter().map(move |b| (*a, *b)));
    all.map(|(a, b)| [a, chosen[a], b, chosen[b]]).collect()
}

/// The cells of the table that name the row; those of irrelevant choices are empty.
fn cells<R: Row>(row: &R) -> Vec<String> {
    let names = row.names().into_iter().enumerate();
    names.map(|(choice, name)| if row.is_relevant(choice) { name } else { "".into() }).collect()
}

/// [`Row::first_rows`], and rows with which they cover every possible pair of values.  The choice is greedy: early rows cover the most pairs.
pub fn covering_set<R: Row>() -> Vec<R> {
    let all: Vec<R> = (0..R::CHOICES.iter().map(|(_, n)| n).product())
        .map(|mut i: usize| {
            let choose = |(_, n): &(&str, usize)| {
                let choice = i % n;
                i /= n;
                choice
            };
            R::new(R::CHOICES.each_ref().map(choose))
        })
        .filter(is_distinct)
        .collect();
    let mut rows = R::first_rows();
    let covered: HashSet<[usize; 4]> = rows.iter().flat_map(pairs).collect();
    let mut missing: HashSet<[usize; 4]> = all.iter().flat_map(pairs).filter(|pair| !covered.contains(pair)).collect();
    while !missing.is_empty() {
        let new_pairs = |row: &&R| pairs(*row).iter().filter(|p| missing.contains(*p)).count();
        let best = *all.iter().max_by_key(new_pairs).expect("there are rows");
        for pair in pairs(&best) {
            missing.remove(&pair);
        }
        rows.push(best);
    }
    rows
}

/// A scene with its reference.
struct Stage {
    rig: Rig,
    truth: Option<Growing>,
}

impl Stage {
    fn new<R: Row>(scene: &str) -> Option<Self> {
        let mut rig = R::rig(scene)?;
        R::prepare(&mut rig);
        Some(Self { rig, truth: None })
    }

    /// The reference, read from the folder or rendered.
    fn truth(&mut self, folder: &Path, row: &impl Row) -> &mut Growing {
        let Self { rig, truth } = self;
        truth.get_or_insert_with(|| {
            let scene = row.scene();
            let path = folder.join(format!("reference {scene}.json"));
            Growing::new(read(&path).map(|v| restarts_from(&v)).unwrap_or_else(|| {
                let start = Instant::now();
                let truth = row.proof().truth(rig, 1000);
                eprintln!("{scene}, reference: {:.0} s", start.elapsed().as_secs_f64());
                let Restarts { images, regions, tiles, .. } = &truth;
                write(&path, &json!({ "images": images, "regions": regions, "tiles": tiles }));
                truth
            }))
        })
    }

    /// The comparison that counts for a row; before it, if the row failed at the first length, that failure.
    fn compare(&mut self, folder: &Path, row: &impl Row) -> Vec<Comparison> {
        self.truth(folder, row);
        let truth = self.truth.as_mut().expect("it was just made");
        let (result, first) = row.proof().judge(&mut self.rig, &row.subject(), truth, |_| ());
        first.into_iter().chain([result]).collect()
    }
}

fn floats(v: &Value) -> Vec<f64> {
    v.as_array().expect("an array").iter().map(|x| x.as_f64().expect("a number")).collect()
}

fn restarts_from(v: &Value) -> Restarts {
    let squares = |v: &Value| v.as_array().expect("an array").iter().map(floats).collect();
    Restarts {
        images: floats(&v["images"]),
        regions: squares(&v["regions"]),
        tiles: squares(&v["tiles"]),
        pixels: Vec::new(),
    }
}

fn to_json(c: &Comparison) -> Value {
    json!([c.difference, c.error, c.power, c.tost, c.regions, c.tiles])
}

fn comparison_from(v: &Value) -> Option<Comparison> {
    let numbers: Vec<f64> = v.as_array()?.iter().filter_map(Value::as_f64).collect();
    let &[difference, error, power, tost, regions, tiles] = numbers.as_slice() else { return None };
    Some(Comparison { difference, error, power, tost, regions, tiles })
}

/// Measures the rows that have no result yet, until the time is up.  True if all rows have results.
fn measure<R: Row>(folder: &Path, rows: &[R]) -> bool {
    let minutes = std::env::var("MATRIX_MINUTES").ok().and_then(|m| m.parse::<f64>().ok());
    let end = minutes.map(|m| Instant::now() + Duration::from_secs_f64(60.0 * m));
    let is_over = || end.is_some_and(|end| Instant::now() > end);
    let part = Part::from_environment("MATRIX_PART");
    let mut subjects: BTreeMap<&str, Stage> = BTreeMap::new();
    // The planted error comes first, because a suite that cannot fail proves nothing.
    let planted = first::<R>();
    for (i, row) in core::iter::once(&planted).chain(rows).enumerate() {
        let path = file_of(folder, row, i == 0);
        if path.exists() || !part.has(i) {
            continue;
        }
        if is_over() {
            return false;
        }
        let scene = row.scene();
        let subject = subjects.entry(scene).or_insert_with(|| Stage::new::<R>(scene).expect("there is an adapter"));
        subject.truth(folder, row);
        if is_over() {
            return false;
        }
        let start = Instant::now();
        let result = if i == 0 {
            plant_shader_defs(&mut subject.rig.app, &[R::PLANTED.0]);
            let found = row.proof().resampled(&mut subject.rig, &row.subject(), 2000);
            plant_shader_defs(&mut subject.rig.app, &[]);
            vec![found.compare(&subject.truth(folder, row).restarts, row.proof().margin)]
        } else {
            subject.compare(folder, row)
        };
        subject.rig.assert_sound();
        let shown: Vec<String> = result.iter().map(Comparison::to_string).collect();
        eprintln!("{i}/{}: {} {shown:?}, {:.0} s", rows.len(), name_of(row, i == 0), start.elapsed().as_secs_f64());
        write(&path, &Value::Array(result.iter().map(to_json).collect()));
    }
    true
}

/// The row of the first values.
fn first<R: Row>() -> R {
    R::new([0; 7])
}

fn name_of<R: Row>(row: &R, is_planted: bool) -> String {
    if is_planted { R::PLANTED.1.into() } else { cells(row).join(" ") }
}

fn file_of(folder: &Path, row: &impl Row, is_planted: bool) -> PathBuf {
    folder.join(format!("{}.json", name_of(row, is_planted)))
}

fn results(folder: &Path, row: &impl Row, is_planted: bool) -> Option<Vec<Comparison>> {
    read(&file_of(folder, row, is_planted))?.as_array()?.iter().map(comparison_from).collect()
}

/// The table of results, and a list of the rows that failed.
fn table<R: Row>(folder: &Path, rows: &[R], commit: &str, adapter: &str) -> (String, Vec<String>) {
    let mut faults = Vec::new();
    let mut sorted = rows.to_vec();
    sorted.sort_by_key(Row::choices);
    let mut lines = String::new();
    let mut count = 0;
    for row in &sorted {
        let Some(tries) = results(folder, row, false) else { continue };
        count += 1;
        let last = tries.last().expect("there is one");
        if !(last.is_equal() && last.is_powerful()) {
            faults.push(format!("{}: {tries:?}", name_of(row, false)));
        }
        let margin = 100.0 * row.proof().margin;
        let again = if tries.len() == 1 { "" } else { " (four times the length)" };
        lines += &format!("| {} | {margin} % | {}{again} |\n", cells(row).join(" | "), figures(last));
    }
    let names: Vec<&str> = R::CHOICES.iter().map(|(name, _)| *name).collect();
    let mut text = format!(
        "Commit {commit}, {adapter}: {count} of {} rows.\n\n\
        | {} | margin | difference | σ | power | TOST p | regions p | tiles p |\n|{}|\n{lines}",
        rows.len(),
        names.join(" | "),
        vec!["---"; names.len() + 7].join("|")
    );
    let planted = first::<R>();
    if let Some(found) = results(folder, &planted, true) {
        if !found[0].is_different() {
            faults.push(format!("{}: {found:?}", R::PLANTED.1));
        }
        let cells = cells(&planted)[1..].join(" | ");
        let margin = 100.0 * planted.proof().margin;
        text += &format!("| {}, {} | {cells} | {margin} % | {} |\n", planted.scene(), R::PLANTED.1, figures(&found[0]));
    }
    (text, faults)
}

fn figures(c: &Comparison) -> String {
    format!(
        "{:+.3} % | {:+.1} | {:.3} | {:.1e} | {:.1e} | {:.1e}",
        100.0 * c.difference,
        c.sigma(),
        c.power,
        c.tost,
        c.regions,
        c.tiles
    )
}

/// Measures the missing rows, publishes the table, and fails if a row failed.
pub fn run<R: Row>() {
    let Some(gpu) = gpu() else { return };
    let (commit, rows) = (commit(), covering_set::<R>());
    let folder = folder_of(R::NAME, &commit);
    let is_complete = measure(&folder, &rows);
    let (table, faults) = table(&folder, &rows, &commit, &gpu.name);
    publish(R::NAME, &table);
    eprintln!("{table}");
    if !is_complete {
        eprintln!("The time is up: the next run continues from here.");
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
