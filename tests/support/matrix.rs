//! Pairwise covering sets of choices, each row held against the reference: the engine of the long tables of `docs/proof.md`.
//!
//! A row is kept in the target folder with the commit that it was measured at, so that a run goes on where another ended: with
//! `MATRIX_MINUTES=6` no row begins after six minutes.  With `MATRIX_PART=0/2` it is every second row only: one that is small leaves
//! half of the machine to another process with `MATRIX_PART=1/2`.

use super::{
    app::*,
    direct::*,
    equivalence::{Comparison, Restarts},
    gpu::gpu,
    proof::{Proof, Subject},
};
use bevy_restir::plant_shader_defs;
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, HashSet},
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

/// A row of a matrix: one of each of its choices.
pub trait Row: Copy {
    /// Of the matrix: its folder, and its marks in the document.
    const NAME: &'static str;
    /// Pixels a side.
    const SIZE: u32;
    /// Names of the choices, and how many there are of each.  The first is the scene.
    const CHOICES: &'static [(&'static str, usize)];
    /// An error that is planted in the row of first choices, what it is, and the margin that it is more than.
    const PLANTED: (&'static str, &'static str);

    fn new(choices: &[usize]) -> Self;
    fn choices(&self) -> &[usize];
    fn scene(&self) -> &'static str;
    /// The choice means something beside the others.
    fn asks(&self, choice: usize) -> bool;
    /// It makes sense and is unbiased.
    fn is_wanted(&self) -> bool;
    /// Its mean cannot be told from few restarts.
    fn has_heavy_tails(&self) -> bool {
        false
    }
    /// Of what it chose.
    fn names(&self) -> Vec<String>;
    fn proof(&self) -> Proof<'static>;
    fn subject(&self) -> impl Subject;
}

fn is_met<R: Row>(row: &R) -> bool {
    row.is_wanted() && (0..R::CHOICES.len()).all(|choice| row.asks(choice) || row.choices()[choice] == 0)
}

fn pairs<R: Row>(row: &R) -> Vec<[usize; 4]> {
    let asked: Vec<usize> = (0..R::CHOICES.len()).filter(|choice| row.asks(*choice)).collect();
    let chosen = row.choices();
    let all = asked.iter().enumerate().flat_map(|(i, a)| asked[i + 1..].iter().map(move |b| (*a, *b)));
    all.map(|(a, b)| [a, chosen[a], b, chosen[b]]).collect()
}

/// What it chose, one cell of a table each.
fn cells<R: Row>(row: &R) -> Vec<String> {
    let names = row.names().into_iter().enumerate();
    names.map(|(choice, name)| if row.asks(choice) { name } else { "".into() }).collect()
}

/// Rows in which every pair of choices that goes together is met: greedy, so that the first rows meet most.
fn covering_set<R: Row>() -> Vec<R> {
    let all: Vec<R> = (0..R::CHOICES.iter().map(|(_, n)| n).product())
        .map(|mut i: usize| {
            let choose = |(_, n): &(&str, usize)| {
                let choice = i % n;
                i /= n;
                choice
            };
            R::new(&R::CHOICES.iter().map(choose).collect::<Vec<_>>())
        })
        .filter(is_met)
        .collect();
    let mut missing: HashSet<[usize; 4]> = all.iter().flat_map(pairs).collect();
    let mut rows = Vec::new();
    while !missing.is_empty() {
        let news = |row: &&R| pairs(*row).iter().filter(|p| missing.contains(*p)).count();
        let best = *all.iter().max_by_key(news).expect("some are");
        for pair in pairs(&best) {
            missing.remove(&pair);
        }
        rows.push(best);
    }
    rows
}

/// A scene, and its truth for the first seeds and for those that what fails is run on again.
struct Stage {
    rig: Rig,
    truths: [Option<Restarts>; 2],
}

impl Stage {
    fn new(scene: &str, size: u32) -> Option<Self> {
        let rig = if scene == "moving" { self::scene(size, moving) } else { Rig::load(scene, size) };
        Some(Self { rig: rig?, truths: [None, None] })
    }

    /// From the folder, or rendered.
    fn truth(&mut self, folder: &Path, row: &impl Row, turn: usize) -> &Restarts {
        if self.truths[turn].is_none() {
            let scene = row.scene();
            let path = folder.join(format!("reference {scene} {turn}.json"));
            let truth = read(&path).map(|v| restarts_from(&v)).unwrap_or_else(|| {
                let start = Instant::now();
                let truth = row.proof().truth(&mut self.rig, 1000 + 5000 * turn as u32);
                eprintln!("{scene}, reference: {:.0} s", start.elapsed().as_secs_f64());
                let Restarts { images, regions, tiles, .. } = &truth;
                write(&path, &json!({ "images": images, "regions": regions, "tiles": tiles }));
                truth
            });
            self.truths[turn] = Some(truth);
        }
        self.truths[turn].as_ref().expect("it was just made")
    }

    /// Of seeds of their own in every turn.
    fn compare(&mut self, folder: &Path, row: &impl Row, turn: usize) -> Comparison {
        let proof = row.proof();
        let ours = proof.resampled(&mut self.rig, &row.subject(), 3000 + 5000 * turn as u32);
        ours.compare(self.truth(folder, row, turn), proof.margin)
    }
}

fn read(path: &Path) -> Option<Value> {
    serde_json::from_str(&fs::read_to_string(path).ok()?).ok()
}

fn write(path: &Path, value: &Value) {
    // Under another name first: a run may end at any time.
    let unfinished = path.with_extension("unfinished");
    fs::write(&unfinished, value.to_string()).expect("the target folder can be written");
    fs::rename(unfinished, path).expect("the target folder can be written");
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

/// The last commit that changed what is measured; with a mark of its own for what is not committed.
fn commit() -> String {
    let git = |arguments: &[&str]| {
        let measured = ["--", "src", "shaders", "assets", "tests", "Cargo.lock"];
        let output = Command::new("git")
            .args(arguments)
            .args(measured)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .ok()
            .filter(|output| output.status.success());
        output.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default()
    };
    let (head, changes) = (git(&["log", "-1", "--format=%h"]), git(&["diff", "HEAD"]));
    if changes.is_empty() {
        return head;
    }
    let mut hasher = DefaultHasher::new();
    changes.hash(&mut hasher);
    format!("{head} with changes {:08x}", hasher.finish() as u32)
}

/// Measures what no file holds, until the time is up; true where all is there.
fn measure<R: Row>(folder: &Path, rows: &[R]) -> bool {
    let minutes = std::env::var("MATRIX_MINUTES").ok().and_then(|m| m.parse::<f64>().ok());
    let end = minutes.map(|m| Instant::now() + Duration::from_secs_f64(60.0 * m));
    let is_over = || end.is_some_and(|end| Instant::now() > end);
    let part = std::env::var("MATRIX_PART").ok();
    let part = part.as_deref().and_then(|part| part.split_once('/'));
    let [part, parts] =
        part.map_or([0, 1], |(k, n)| [k, n].map(|v| v.parse().expect("MATRIX_PART is two numbers: 0/2")));
    let mut subjects: BTreeMap<&str, Stage> = BTreeMap::new();
    // The planted error first: a suite that cannot fail proves nothing.
    let planted = first::<R>();
    for (i, row) in core::iter::once(&planted).chain(rows).enumerate() {
        let path = file_of(folder, row, i == 0);
        if path.exists() || i % parts != part {
            continue;
        }
        if is_over() {
            return false;
        }
        let scene = row.scene();
        let subject = subjects.entry(scene).or_insert_with(|| Stage::new(scene, R::SIZE).expect("there is an adapter"));
        subject.truth(folder, row, 0);
        if is_over() {
            return false;
        }
        let start = Instant::now();
        let result = if i == 0 {
            plant_shader_defs(&mut subject.rig.app, &[R::PLANTED.0]);
            let found = subject.compare(folder, row, 0);
            plant_shader_defs(&mut subject.rig.app, &[]);
            vec![found]
        } else {
            let mut tries = vec![subject.compare(folder, row, 0)];
            if !tries[0].is_equal() {
                tries.push(subject.compare(folder, row, 1));
            }
            tries
        };
        subject.rig.assert_sound();
        let shown: Vec<String> = result.iter().map(Comparison::to_string).collect();
        eprintln!("{i}/{}: {} {shown:?}, {:.0} s", rows.len(), name_of(row, i == 0), start.elapsed().as_secs_f64());
        write(&path, &Value::Array(result.iter().map(to_json).collect()));
    }
    true
}

/// The row of first choices.
fn first<R: Row>() -> R {
    R::new(&vec![0; R::CHOICES.len()])
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

/// The table of what was measured, and what is wrong in it.
fn table<R: Row>(folder: &Path, rows: &[R], commit: &str, adapter: &str) -> (String, Vec<String>) {
    let mut faults = Vec::new();
    let mut sorted = rows.to_vec();
    sorted.sort_by_key(|row| row.choices().to_vec());
    let mut lines = String::new();
    let mut count = 0;
    for row in &sorted {
        let Some(tries) = results(folder, row, false) else { continue };
        count += 1;
        let last = tries.last().expect("there is one");
        if !last.is_equal() && !row.has_heavy_tails() {
            faults.push(format!("{}: {tries:?}", name_of(row, false)));
        }
        let margin = 100.0 * row.proof().margin;
        let again = match (row.has_heavy_tails() && !last.is_equal(), tries.len()) {
            (true, _) => " (heavy tails: not shown)",
            (_, 1) => "",
            _ => " (second run)",
        };
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

/// Writes it between its marks.
fn publish(name: &str, table: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/proof.md");
    let text = fs::read_to_string(&path).expect("the document is there");
    let (begin, end) = (format!("<!-- {name} -->\n"), format!("<!-- /{name} -->"));
    let (before, rest) = text.split_once(&begin).expect("it has the mark");
    let (_, after) = rest.split_once(&end).expect("it has the other mark");
    fs::write(&path, format!("{before}{begin}{table}{end}{after}")).expect("the document can be written");
}

/// Measures what is not yet measured, and publishes all.
pub fn run<R: Row>() {
    let Some(gpu) = gpu() else { return };
    let (commit, rows) = (commit(), covering_set::<R>());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(R::NAME.replace(' ', "_")).join(&commit);
    fs::create_dir_all(&folder).expect("the target folder can be written");
    let is_complete = measure(&folder, &rows);
    let (table, faults) = table(&folder, &rows, &commit, &gpu.name);
    publish(R::NAME, &table);
    eprintln!("{table}");
    if !is_complete {
        eprintln!("The time is up: the next run goes on from here.");
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
