//! The long form of `direct_scenes`: a pairwise covering set of scenes, reuse, MIS kinds, bias corrections, shading, light choice and
//! visibility, each row held against the reference; the table of `docs/proof.md`.
//!
//! A row is kept in the target folder with the commit that it was measured at, so that a run goes on where another ended: with
//! `DIRECT_MATRIX_MINUTES=6` no row begins after six minutes.

use crate::support::{
    app::*,
    direct::*,
    equivalence::{Comparison, Restarts},
    gpu::gpu,
    proof::Proof,
};
use bevy_restir::{BiasCorrection, Direct, Mis, ReuseOrder, VisibilityReuse, plant_shader_defs};
use serde_json::{Value, json};
use std::{
    collections::{BTreeMap, HashSet},
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

const SCENES: [&str; 6] = ["cornell", "glossy", "many_lights", "punctual", "furnace", "moving"];
const REUSE: [&str; 6] = ["none", "temporal", "spatial", "both", "classic", "two rounds"];
const MIS: [Mis; 5] = [Mis::DefensivePairwise, Mis::Pairwise, Mis::Balance, Mis::Valid, Mis::DefensivePairwiseGris];
const CORRECTIONS: [BiasCorrection; 2] = [BiasCorrection::HeuristicsAndUnbiasedMis, BiasCorrection::UnbiasedMis];
const VISIBILITY: [VisibilityReuse; 2] = [VisibilityReuse::Resampled, VisibilityReuse::Shading];
/// Choices that a row makes: scene, reuse, MIS kind, bias correction, decoupled shading or not, presampled or not, visibility.
const CHOICES: [usize; 7] = [SCENES.len(), REUSE.len(), MIS.len(), CORRECTIONS.len(), 2, 2, VISIBILITY.len()];

/// A choice of each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Row([usize; CHOICES.len()]);

impl Row {
    fn scene(self) -> &'static str {
        SCENES[self.0[0]]
    }

    fn reuse(self) -> &'static str {
        REUSE[self.0[1]]
    }

    /// Without reuse there is nothing to weigh and one sample to shade.
    fn asks(self, choice: usize) -> bool {
        self.reuse() != "none" || !(2..=4).contains(&choice)
    }

    /// It makes sense and is unbiased: only the BSDF finds lights in the furnace's mirrors.  And it can be shown: weights that know no
    /// targets make pixels a thousand times too bright, and rare, where targets differ by as much, across edges and near lights that move.
    fn is_wanted(self) -> bool {
        let is_unbiased = self.scene() != "furnace" || self.0[6] == 0;
        let is_calm = MIS[self.0[2]] != Mis::Valid || (self.0[3] == 0 && self.0[6] == 0 && self.scene() != "moving");
        is_unbiased && is_calm && (0..CHOICES.len()).all(|choice| self.asks(choice) || self.0[choice] == 0)
    }

    fn pairs(self) -> impl Iterator<Item = [usize; 4]> {
        let asked = move |a: &usize| self.asks(*a);
        (0..CHOICES.len())
            .filter(asked)
            .flat_map(move |a| (a + 1..CHOICES.len()).filter(asked).map(move |b| [a, self.0[a], b, self.0[b]]))
    }

    /// Neighbours across edges, weights that know no targets, or targets that see nothing: rare bright pixels, of which the mean of few
    /// restarts is a skewed number.
    fn is_noisy(self) -> bool {
        MIS[self.0[2]] == Mis::Valid || self.0[3] != 0 || self.0[6] != 0
    }

    /// Its mean cannot be told from few restarts: where lobes are narrow 1/|Z| leaves most pixels dark and makes up for it in very few.
    fn has_heavy_tails(self) -> bool {
        MIS[self.0[2]] == Mis::Valid && matches!(self.scene(), "furnace" | "glossy")
    }

    fn direct(self) -> Direct {
        let [_, _, mis, correction, shading, lights, visibility] = self.0;
        // Near neighbours and short histories make fewer of those.
        let (radius, confidence_cap) = if self.is_noisy() { (10.0, 4.0) } else { (30.0, 20.0) };
        let radius = pixels(radius, 64);
        let direct = Direct {
            mis: MIS[mis],
            bias_correction: CORRECTIONS[correction],
            decoupled_shading: shading == 0,
            subset_count: if lights == 0 { 128 } else { 0 },
            visibility: VISIBILITY[visibility],
            // It sees what it finds: with targets that see nothing it would be biased.
            bsdf_candidate: visibility == 0,
            radius,
            confidence_cap,
            ..Default::default()
        };
        match self.reuse() {
            "none" => Direct { temporal: false, spatial_taps: 0, disocclusion_taps: 0, ..direct },
            "temporal" => Direct { spatial_taps: 0, disocclusion_taps: 0, ..direct },
            "spatial" => Direct { temporal: false, spatial_taps: 3, ..direct },
            "classic" => Direct { order: ReuseOrder::TemporalThenSpatial, spatial_taps: 2, rounds: 2, ..direct },
            "two rounds" => Direct { rounds: 2, ..direct },
            _ => direct,
        }
    }

    /// What it chose, one cell of a table each.
    fn cells(self) -> [String; CHOICES.len()] {
        let names = [
            self.scene().into(),
            self.reuse().into(),
            format!("{:?}", MIS[self.0[2]]),
            format!("{:?}", CORRECTIONS[self.0[3]]),
            ["decoupled", "kept"][self.0[4]].into(),
            ["presampled", "all"][self.0[5]].into(),
            format!("{:?}", VISIBILITY[self.0[6]]),
        ];
        let mut choice = 0..;
        names.map(|name| if choice.next().is_some_and(|c| self.asks(c)) { name } else { "".into() })
    }
}

/// Rows in which every pair of choices that goes together is met: greedy, so that the first rows meet most.
fn covering_set() -> Vec<Row> {
    let all: Vec<Row> = (0..CHOICES.iter().product())
        .map(|mut i: usize| {
            Row(CHOICES.map(|n| {
                let choice = i % n;
                i /= n;
                choice
            }))
        })
        .filter(|row| row.is_wanted())
        .collect();
    let mut missing: HashSet<[usize; 4]> = all.iter().flat_map(|row| row.pairs()).collect();
    let mut rows = Vec::new();
    while !missing.is_empty() {
        let best = *all.iter().max_by_key(|row| row.pairs().filter(|p| missing.contains(p)).count()).expect("some are");
        best.pairs().for_each(|pair| {
            missing.remove(&pair);
        });
        rows.push(best);
    }
    rows
}

/// Lengths that give a power of 0.95 and more at the margin: 0.2 % where that is affordable.
fn proof(row: Row) -> Proof<'static> {
    let quiet = |margin| if row.is_noisy() { 0.01 } else { margin };
    match row.scene() {
        "cornell" => Proof { margin: quiet(0.002), ..Proof::of((24, 24), (40, 40)) },
        "furnace" => Proof { margin: quiet(0.002), ..Proof::of((40, 40), (40, 40)) },
        "glossy" => Proof::of((24, 24), (40, 80)),
        "many_lights" => Proof::of((40, 24), (40, 200)),
        "punctual" => Proof::of((24, 24), (40, 60)),
        _ => Proof { pose: Some(&pose_moving), ..Proof::of((200, 1), (40, 40)) },
    }
}

/// A scene, and its truth for the first seeds and for those that what fails is run on again.
struct Subject {
    rig: Rig,
    truths: [Option<Restarts>; 2],
}

impl Subject {
    fn new(scene: &str) -> Option<Self> {
        let rig = if scene == "moving" { self::scene(64, moving) } else { Rig::load(scene, 64) };
        Some(Self { rig: rig?, truths: [None, None] })
    }

    /// From the folder, or rendered.
    fn truth(&mut self, folder: &Path, row: Row, turn: usize) -> &Restarts {
        if self.truths[turn].is_none() {
            let scene = row.scene();
            let path = folder.join(format!("reference {scene} {turn}.json"));
            let truth = read(&path).map(|v| restarts_from(&v)).unwrap_or_else(|| {
                let start = Instant::now();
                let truth = proof(row).truth(&mut self.rig, 1000 + 5000 * turn as u32);
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
    fn compare(&mut self, folder: &Path, row: Row, turn: usize) -> Comparison {
        let proof = proof(row);
        let ours = proof.resampled(&mut self.rig, &row.direct(), 3000 + 5000 * turn as u32);
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

const PLANTED: &str = "planted error of 0.3 %";

/// Measures what no file holds, until the time is up; true where all is there.
fn measure(folder: &Path, rows: &[Row]) -> bool {
    let minutes = std::env::var("DIRECT_MATRIX_MINUTES").ok().and_then(|m| m.parse::<f64>().ok());
    let end = minutes.map(|m| Instant::now() + Duration::from_secs_f64(60.0 * m));
    let is_over = || end.is_some_and(|end| Instant::now() > end);
    let mut subjects: BTreeMap<&str, Subject> = BTreeMap::new();
    // The planted error first: a suite that cannot fail proves nothing.
    let planted = Row([0; CHOICES.len()]);
    for (i, row) in core::iter::once(planted).chain(rows.iter().copied()).enumerate() {
        let path = file_of(folder, row, i == 0);
        if path.exists() {
            continue;
        }
        if is_over() {
            return false;
        }
        let scene = row.scene();
        let subject = subjects.entry(scene).or_insert_with(|| Subject::new(scene).expect("there is an adapter"));
        subject.truth(folder, row, 0);
        if is_over() {
            return false;
        }
        let start = Instant::now();
        let result = if i == 0 {
            plant_shader_defs(&mut subject.rig.app, &["PLANT_SLIGHTLY_SCALED_UCW"]);
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

fn name_of(row: Row, is_planted: bool) -> String {
    if is_planted { PLANTED.into() } else { row.cells().join(" ") }
}

fn file_of(folder: &Path, row: Row, is_planted: bool) -> PathBuf {
    folder.join(format!("{}.json", name_of(row, is_planted)))
}

fn results(folder: &Path, row: Row, is_planted: bool) -> Option<Vec<Comparison>> {
    read(&file_of(folder, row, is_planted))?.as_array()?.iter().map(comparison_from).collect()
}

/// The table of what was measured, and what is wrong in it.
fn table(folder: &Path, rows: &[Row], commit: &str, adapter: &str) -> (String, Vec<String>) {
    let mut faults = Vec::new();
    let mut sorted = rows.to_vec();
    sorted.sort_by_key(|row| row.0);
    let mut lines = String::new();
    let mut count = 0;
    for row in sorted {
        let Some(tries) = results(folder, row, false) else { continue };
        count += 1;
        let last = tries.last().expect("there is one");
        if !last.is_equal() && !row.has_heavy_tails() {
            faults.push(format!("{}: {tries:?}", name_of(row, false)));
        }
        let margin = 100.0 * proof(row).margin;
        let again = match (row.has_heavy_tails() && !last.is_equal(), tries.len()) {
            (true, _) => " (heavy tails: not shown)",
            (_, 1) => "",
            _ => " (second run)",
        };
        lines += &format!("| {} | {margin} % | {}{again} |\n", row.cells().join(" | "), figures(last));
    }
    let mut text = format!(
        "Commit {commit}, {adapter}: {count} of {} rows.\n\n\
        | scene | reuse | MIS | correction | shaded | lights | visibility | margin | difference | σ | power | TOST p | regions p | tiles p |\n\
        |---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n{lines}",
        rows.len()
    );
    if let Some(found) = results(folder, Row([0; CHOICES.len()]), true) {
        if !found[0].is_different() {
            faults.push(format!("{PLANTED}: {found:?}"));
        }
        text +=
            &format!("| cornell, {PLANTED} | none | | | | presampled | Resampled | 0.2 % | {} |\n", figures(&found[0]));
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
fn publish(table: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/proof.md");
    let text = fs::read_to_string(&path).expect("the document is there");
    let (begin, end) = ("<!-- direct matrix -->\n", "<!-- /direct matrix -->");
    let (before, rest) = text.split_once(begin).expect("it has the mark");
    let (_, after) = rest.split_once(end).expect("it has the other mark");
    fs::write(&path, format!("{before}{begin}{table}{end}{after}")).expect("the document can be written");
}

#[test]
#[ignore = "half an hour: ./run test --full"]
fn full_length_direct_matrix() {
    let Some(gpu) = gpu() else { return };
    let (commit, rows) = (commit(), covering_set());
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("direct_matrix").join(&commit);
    fs::create_dir_all(&folder).expect("the target folder can be written");
    let is_complete = measure(&folder, &rows);
    let (table, faults) = table(&folder, &rows, &commit, &gpu.name);
    publish(&table);
    eprintln!("{table}");
    if !is_complete {
        eprintln!("The time is up: the next run goes on from here.");
    }
    assert!(faults.is_empty(), "{faults:#?}");
}
