//! The trade of speed for accuracy on one scene: time and error of every technique, preset and setting that matters, and advice.

mod advice;
mod content;
mod eligibility;
mod measure;
mod page;
mod plan;
mod plots;
mod report;

use bevy::{log::warn, math::UVec2};
use bevy_restir::Restir;
use bevy_restir_support::{
    arguments,
    environment::{self, Environment},
    exr_file, fields,
    files::{self, write_text},
    front::Point,
    picture::write_png,
    progress::Progress,
    times::median,
};
use serde_json::{Value, json};
use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    bench::{Bench, Counts, Scene, lit, scenes},
    compare,
    error::Picture,
    output, panels, variant,
};
use measure::{Errors, Protocol, Record, Truth};
use plan::{Configuration, Extent};

/// Time, error, bias, flicker and memory of every technique and preset and of the settings that matter, on one scene.  Writes plots,
/// pictures, tables and advice as report.html and report.md, and all figures as csv.  About 40 configurations; a sweep that was
/// interrupted continues when it is run again.
#[derive(clap::Args, Debug)]
pub struct SweepArgs {
    #[command(flatten)]
    common: Args,
    /// Measures more settings and combinations of them, too, and everything under a moving camera, and compares the advice of the first
    /// report with the best of all settings.
    #[arg(long)]
    full: bool,
}

/// Time, error and bias of the presets on one scene, beside the reference tracer and the techniques without reuse.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A glTF file; `references.json` beside it may name its environment.
    scene: PathBuf,
    /// Replaces the environment: radiance R,G,B or an equirectangular .hdr or .exr file.
    #[arg(long, value_parser = environment::parse)]
    env: Option<Environment>,
    /// Folder of the report; without it target/lab/sweep/SCENE.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Starts over: drops what an earlier sweep has left in the folder.
    #[arg(long)]
    fresh: bool,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "64x64", value_parser = arguments::size)]
    size: UVec2,
    /// Number of independent runs of each configuration.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=1024))]
    seeds: u32,
    /// Frames of history before the frame whose error counts.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(2..=4096))]
    history: u32,
    /// Measures only configurations whose section and label contain this text, besides the reference tracer.
    #[arg(long)]
    only: Option<String>,
    /// The converged picture, a linear .exr file of the size of the sweep, instead of one that is rendered.  There are then no figures
    /// under a moving camera.
    #[arg(long)]
    reference: Option<PathBuf>,
    /// Relative squared error that the converged picture may have.
    #[arg(long, default_value_t = 1e-3, value_parser = arguments::positive::<f64>)]
    reference_error: f64,
    /// Greatest number of samples per pixel of the converged picture.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    samples: u32,
    /// A field of `Restir` that all configurations have, as `PATH=VALUE`; repeatable.  Configurations that change this field themselves are
    /// left out.  Without `--reference` the configurations have no jitter, so that errors are those of the light and not of edges.
    #[arg(long, value_name = "PATH=VALUE", value_parser = assignment)]
    set: Vec<String>,
    /// The error by which the report judges.
    #[arg(long, value_enum, default_value = "trimmed")]
    by: ErrorMetric,
    /// A markdown file.  The advice and the table of presets replace its text between `<!-- lab sweep SCENE -->` and
    /// `<!-- /lab sweep SCENE -->`.
    #[arg(long)]
    into: Option<PathBuf>,
}

/// A measure of error.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
enum ErrorMetric {
    /// relMSE without the worst percent of the pixels.
    Trimmed,
    /// Mean of the squared errors, each relative to the squared reference.
    RelMse,
    /// Mean of the absolute errors, each relative to the reference.
    Mape,
    /// Difference as a viewer sees it (Andersson et al. 2020).
    Flip,
    /// Mean squared error, relative to the squared mean.
    Mse,
}

impl ErrorMetric {
    fn of(self, errors: &Errors) -> f64 {
        match self {
            Self::Trimmed => errors.rel_mse_trimmed,
            Self::RelMse => errors.rel_mse,
            Self::Mape => errors.mape,
            Self::Flip => errors.flip,
            Self::Mse => errors.mse,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Trimmed => "relMSE without the worst percent",
            Self::RelMse => "relMSE",
            Self::Mape => "MAPE",
            Self::Flip => "FLIP",
            Self::Mse => "MSE",
        }
    }
}

/// Checks an assignment to a field of all configurations and of the converged picture.
fn assignment(text: &str) -> Result<String, String> {
    fields::set(&mut Restir::default(), text)?;
    variant::parse_without(text, &["technique"])
}

/// A configuration with its figures.
struct Entry {
    configuration: Configuration,
    record: Record,
}

/// A whole sweep.
struct Sweep {
    scene: String,
    /// The command, the adapter, the commit, seeds and lengths.
    header: Vec<String>,
    /// Changes that the user asked for in all configurations.
    shared: Vec<String>,
    by: ErrorMetric,
    /// In the order of the plan.
    all: Vec<Entry>,
}

impl Entry {
    /// The errors that belong to the time: one sample of the reference tracer is compared, as one frame of the others is.
    fn errors(&self) -> Errors {
        match self.record.frames.first() {
            Some((_, first)) if self.is_reference() => *first,
            _ => self.record.late(),
        }
    }

    fn point(&self, by: ErrorMetric) -> Point {
        Point { time: self.record.lighting(), error: by.of(&self.errors()) }
    }

    fn is_reference(&self) -> bool {
        self.configuration.section == plan::REFERENCE
    }
}

impl Sweep {
    /// All configurations but those of the reference tracer.
    fn competitors(&self) -> impl Iterator<Item = &Entry> {
        self.all.iter().filter(|m| !m.is_reference())
    }

    /// Times and errors of the reference tracer with more and more samples, with the bounces of `Unbiased`.
    fn reference_curve(&self) -> Vec<Point> {
        let found = self.all.iter().rfind(|m| m.is_reference());
        let frames = found.iter().flat_map(|m| m.record.frames.iter().map(|f| (m.record.lighting(), f)));
        frames.map(|(ms, (n, errors))| Point { time: ms * f64::from(n + 1), error: self.by.of(errors) }).collect()
    }
}

impl SweepArgs {
    fn extent(&self) -> Extent {
        if self.full { Extent::Full } else { Extent::Settings }
    }

    /// Fails if there is nothing to measure.
    pub fn check(&self) -> Result<(), String> {
        self.common.plan(self.extent()).map(|_| ())
    }
}

pub fn run(args: &SweepArgs) -> Result<(), String> {
    sweep(&args.common, args.extent())
}

pub fn run_presets(args: &Args) -> Result<(), String> {
    sweep(args, Extent::Presets)
}

fn sweep(args: &Args, extent: Extent) -> Result<(), String> {
    let scene = scenes(core::slice::from_ref(&args.scene))?.remove(0);
    measured(args, extent, &scene).map_err(|error| format!("{}: {error}", scene.1))
}

/// Reads the picture of `--reference`.
fn read_reference(path: &Path) -> Result<(UVec2, Picture), String> {
    let (size, picture) = compare::read_reference(path)?;
    // The message of `lit` gives advice about the scene, which does not apply to a file.
    lit(&picture).map_err(|_| format!("{}: it is black, and no error can be relative to it", path.display()))?;
    Ok((size, picture))
}

fn measured(args: &Args, extent: Extent, scene: &Scene) -> Result<(), String> {
    let plan = args.plan(extent)?;
    let out = args.out.clone().unwrap_or_else(|| Path::new("target/lab/sweep").join(&scene.1));
    let name = format!("sweep {}", scene.1);
    files::check_in(&out, &["report.html", "report.md"])?;
    output::check_into(args.into.as_deref(), &name)?;
    let given = args.reference.as_deref().map(read_reference).transpose()?;
    if let Some((size, _)) = given.as_ref().filter(|given| given.0 != args.size) {
        return Err(format!("the reference has {} x {} pixels; --size {}x{} fits it", size.x, size.y, size.x, size.y));
    }

    let shared = args.shared();
    let counts = Counts { warmup: args.history, frames: 1 };
    let mut bench = Bench::of_scene(scene, args.size, plan[0].settings(&shared)?, &counts)?;
    if let Some(wanted) = &args.env {
        environment::light(bench.app().world_mut(), wanted)?;
    }
    // The header names the commit at the start of the run.
    let header = output::header(bench.adapter(), args.size);
    let folder = Folder::open(&out, &args.identity(scene, &bench), args.fresh)?;
    let truth = match given {
        Some((_, picture)) => Truth::given(&bench, picture),
        None => folder.truth(args, &shared, &mut bench)?,
    };
    if let Some(text) = args.noise_warning(&truth) {
        warn!("restir: {text}");
    }
    let image = panels::grid(args.size, 1, &[&truth.still], panels::exposure_for(args.size, &truth.still), 1);
    write_png(&out.join("pictures/reference.png"), image)?;
    let protocol = Protocol { truth: &truth, size: args.size, seeds: args.seeds, history: args.history };
    let frames_of = |c: &Configuration| match folder.record(c) {
        None => protocol.planned(c) + protocol.planned_again(),
        Some(record) if !record.is_timed() => protocol.planned_again(),
        Some(_) => 0,
    };
    let progress = Progress::new(plan.iter().map(frames_of).sum());
    let mut all = Vec::new();
    for configuration in plan {
        let record = match folder.record(&configuration) {
            Some(record) => record,
            None => {
                let (record, picture) = protocol.run(&mut bench, &configuration, &shared, &progress)?;
                folder.keep(&configuration, &record, &picture, &truth.still, args.size)?;
                record
            }
        };
        all.push(Entry { configuration, record });
    }
    // In reverse order, so that a slow period of the machine does not affect the same configurations twice.
    for Entry { configuration, record } in all.iter_mut().rev().filter(|m| !m.record.is_timed()) {
        protocol.time_again(&mut bench, configuration, &shared, record, &progress)?;
        folder.keep_record(configuration, record)?;
    }
    let spread = same_speed(&mut all);
    let mut header = args.header(header, &truth, spread);
    if !all.iter().any(|m| m.record.has_gpu_times) {
        let text = "times are those of the CPU that records the passes, because the device measures no GPU times";
        header.push(text.into());
    }
    let sweep = Sweep { scene: scene.1.clone(), header, shared: args.set.clone(), by: args.by, all };
    report::write(&sweep, &out)?;
    page::write(&sweep, &out)?;
    output::write_into(args.into.as_deref(), &name, &report::short(&sweep))?;
    advice::judged(&sweep).iter().for_each(|judged| println!("{}", judged.line()));
    println!("{}", out.join("report.html").display());
    Ok(())
}

/// Scales all times to the median speed of the machine during the sweep.  Returns the greatest and the least speed, relative to it.
fn same_speed(all: &mut [Entry]) -> [f64; 2] {
    let yardsticks: Vec<f64> = all.iter().map(|m| m.record.yardstick).collect();
    let middle = median(&yardsticks);
    let mut range = [1.0f64; 2];
    for Entry { record, .. } in all {
        let speed = middle / record.yardstick;
        range = [range[0].max(speed), range[1].min(speed)];
        record.scale_times(speed);
    }
    range
}

impl Args {
    /// Fails if there is nothing to measure.
    pub fn check(&self) -> Result<(), String> {
        self.plan(Extent::Presets).map(|_| ())
    }

    /// The configurations to measure.
    fn plan(&self, extent: Extent) -> Result<Vec<Configuration>, String> {
        let mut plan = plan::configurations(extent);
        // The converged picture has the value of `--set`.  With another one a configuration would have other light.
        plan.retain(|c| !c.overrides(&self.set));
        if let Some(text) = &self.only {
            plan.retain(|c| c.section == plan::REFERENCE || c.name().contains(text));
        }
        for configuration in &mut plan {
            configuration.moves &= self.reference.is_none();
        }
        if plan.iter().all(|c| c.section == plan::REFERENCE) {
            let text = self.only.as_deref().unwrap_or_default();
            return Err(format!("no configuration is named {text}; those that change a field of --set are left out"));
        }
        Ok(plan)
    }

    /// Changes that all configurations have.
    fn shared(&self) -> Vec<String> {
        let jitter = self.reference.is_none().then(|| "jitter=Never".into());
        jitter.into_iter().chain(self.set.iter().cloned()).collect()
    }

    /// The inputs of a sweep.  A sweep continues an interrupted one only if all of them are equal.
    fn identity(&self, scene: &Scene, bench: &Bench) -> Value {
        json!({
            "scene": scene.0,
            "size": [self.size.x, self.size.y],
            "seeds": self.seeds,
            "history": self.history,
            "reference": self.reference,
            "reference_error": self.reference_error,
            "samples": self.samples,
            "set": self.set,
            "env": self.env.as_ref().map(|env| format!("{env:?}")),
            "adapter": bench.adapter(),
            // The shaders are part of the program. A commit of documents changes nothing.
            "program": std::env::current_exe().ok().and_then(|path| content::of_file(&path)),
            "content of the scene": content::of_scene(&scene.0),
            "content of references.json": content::of_file(&scene.0.with_file_name("references.json")),
            "content of the reference": self.reference.as_deref().and_then(content::of_file),
            "content of the environment": match &self.env {
                Some(Environment::File(path)) => content::of_file(path),
                _ => None,
            },
        })
    }

    fn header(&self, mut header: Vec<String>, truth: &Truth, [fastest, slowest]: [f64; 2]) -> Vec<String> {
        header.push(format!(
            "errors of the frame after {} others, means over the seeds 1 to {}; times: medians of all lighting passes, the shorter of two",
            self.history, self.seeds
        ));
        header.push(format!(
            "times are scaled to equal speed of the machine, which varied from {slowest:.2} to {fastest:.2} of its median"
        ));
        header.push(match &self.reference {
            Some(path) => format!("compared with {}", path.display()),
            None => format!(
                "compared with {} samples a pixel of the reference tracer, whose own relMSE is {:.1e}",
                truth.figures.samples, truth.figures.noise
            ),
        });
        header.extend(self.noise_warning(truth));
        header
    }

    /// A warning if the converged picture is noisier than it may be: few samples predict its noise, and `--samples` limits them.
    fn noise_warning(&self, truth: &Truth) -> Option<String> {
        /// Noise up to this multiple of `--reference-error` is no cause for a warning.
        const TOLERANCE: f64 = 1.2;
        let measure::TruthFigures { noise, samples, .. } = truth.figures;
        let cure = if samples < self.samples { "smaller --reference-error" } else { "greater --samples" };
        (noise > TOLERANCE * self.reference_error).then(|| {
            format!(
                "the converged picture has a relMSE of {noise:.1e} instead of {:.1e} (--reference-error), which adds to all errors; a {cure} \
                 reduces it",
                self.reference_error
            )
        })
    }
}

/// Takes a missing file as removed.
fn is_missing(error: std::io::Error) -> std::io::Result<()> {
    if error.kind() == std::io::ErrorKind::NotFound { Ok(()) } else { Err(error) }
}

/// The folder of a sweep.
struct Folder<'a>(&'a Path);

impl<'a> Folder<'a> {
    /// Creates the folder, or continues the sweep in it if that is the same.
    fn open(path: &'a Path, identity: &Value, fresh: bool) -> Result<Self, String> {
        let file = path.join("sweep.json");
        // A folder without this file does not belong to a sweep: nothing in it is removed.
        if fresh && file.is_file() {
            let with_path = |error: std::io::Error| format!("{}: {error}", path.display());
            fs::remove_dir_all(path.join("runs")).or_else(is_missing).map_err(with_path)?;
            for name in ["reference.json", "sweep.json"] {
                fs::remove_file(path.join(name)).or_else(is_missing).map_err(with_path)?;
            }
        }
        if let Ok(text) = fs::read_to_string(&file) {
            let found: Value = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", file.display()))?;
            let differs = |key: &&String| found[*key] != identity[*key];
            if let Some(key) = identity.as_object().and_then(|all| all.keys().find(differs)) {
                return Err(format!(
                    "{}: it holds a sweep with another {key} ({} instead of {}); --fresh starts over, --out chooses another folder",
                    path.display(),
                    found[key],
                    identity[key]
                ));
            }
        }
        for folder in ["runs", "pictures"] {
            let folder = path.join(folder);
            fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        }
        write_text(&file, &identity.to_string())?;
        Ok(Self(path))
    }

    /// Removes what [`Self::open`] has written if nothing was measured: a sweep with other inputs, such as a light, may then have the folder.
    fn undo(&self) {
        // Only empty folders are removed.
        if fs::remove_dir(self.0.join("runs")).is_ok() {
            let _ = fs::remove_file(self.0.join("sweep.json"));
            let _ = fs::remove_dir(self.0.join("pictures"));
            let _ = fs::remove_dir(self.0);
        }
    }

    fn run(&self, configuration: &Configuration) -> PathBuf {
        self.0.join("runs").join(configuration.id()).with_extension("json")
    }

    /// The figures of a configuration, where they were measured.
    fn record(&self, configuration: &Configuration) -> Option<Record> {
        let text = fs::read_to_string(self.run(configuration)).ok()?;
        let record: Record = serde_json::from_str(&text).ok()?;
        (record.moving.is_some() || !configuration.moves).then_some(record)
    }

    /// Keeps the figures, and a picture beside four times its error.
    fn keep(
        &self,
        configuration: &Configuration,
        record: &Record,
        picture: &Picture,
        truth: &Picture,
        size: UVec2,
    ) -> Result<(), String> {
        write_png(&self.0.join(report::picture(configuration)), panels::with_error(size, picture, truth))?;
        self.keep_record(configuration, record)
    }

    fn keep_record(&self, configuration: &Configuration, record: &Record) -> Result<(), String> {
        let text = serde_json::to_string(record).map_err(|e| e.to_string())?;
        write_text(&self.run(configuration), &text)
    }

    /// The converged pictures; they are rendered unless the folder contains them.
    fn truth(&self, args: &Args, shared: &[String], bench: &mut Bench) -> Result<Truth, String> {
        let files = ["reference.exr", "reference-before.exr"].map(|name| self.0.join(name));
        let about = self.0.join("reference.json");
        if let Some(text) = fs::read_to_string(&about).ok().filter(|_| files.iter().all(|f| f.is_file())) {
            let figures: measure::TruthFigures =
                serde_json::from_str(&text).map_err(|e| format!("{}: {e}", about.display()))?;
            let [still, before] = [compare::read(&files[0])?.1, compare::read(&files[1])?.1];
            return Ok(Truth::kept(bench, still, before, figures));
        }
        let truth = measure::truth(bench, shared, args.reference_error, args.samples).inspect_err(|_| self.undo())?;
        for (file, picture) in files.iter().zip([&truth.still, &truth.before]) {
            let pixels: Vec<[f32; 3]> = picture.iter().map(|p| p.map(|c| c as f32)).collect();
            exr_file::write(file, args.size, &pixels)?;
        }
        write_text(&about, &serde_json::to_string(&truth.figures).map_err(|e| e.to_string())?)?;
        Ok(truth)
    }
}
