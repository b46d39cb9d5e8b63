//! Cost and error of the techniques with all bounces, compared with the reference tracer at equal time.

use bevy::math::UVec2;
use bevy_restir::{Restir, RestirReport, Technique};
use bevy_restir_support::{arguments, progress::Progress};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Cost, Counts, Errors, scenes},
    error::{Error, Reference, WithoutEmitters},
    output::{Output, describe},
    series,
    table::{Row, Table, Unit},
    variant,
};

/// Cost by stage, and error at equal time, of the techniques that compute global illumination.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Maximum number of scattering events of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: u32,
    /// A field of `Restir`, for all techniques and the reference tracer; repeatable.  `--bounces` sets the bounces.
    #[arg(long, value_name = "PATH=VALUE", value_parser = shared)]
    set: Vec<String>,
    #[command(flatten)]
    lengths: Lengths,
}

/// Checks an assignment to a field of all techniques.
fn shared(text: &str) -> Result<String, String> {
    variant::parse_without(text, &["technique", "bounces"])
}

/// Picture and lengths of measurements at equal time.
#[derive(clap::Args, Debug)]
pub struct Lengths {
    #[command(flatten)]
    pub output: Output,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    pub size: UVec2,
    #[command(flatten)]
    pub counts: Counts,
    /// Number of independent frames over which errors are averaged.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    pub seeds: u32,
    /// Samples per pixel of the converged picture.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    pub samples: u32,
}

/// Cost by stage and error of ReSTIR PT, step by step from that of 2022 to the default (Lin et al. 2026, supplement, Table 1, without the two
/// steps that are no settings).
#[derive(clap::Args, Debug)]
pub struct Steps {
    #[command(flatten)]
    args: Args,
    /// Fields of `Restir` as `"PATH=VALUE PATH=VALUE"`, measured instead of those steps; repeatable.
    #[arg(long, value_parser = variant::parse)]
    variant: Vec<String>,
}

/// Settings that are compared with the reference tracer.
pub struct Competitor {
    pub name: String,
    pub settings: Restir,
}

/// How the cost of a frame is split into rows.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// One row per pass.
    Passes,
    /// The columns of Table 1 of Lin et al. 2026, supplement.
    Stages,
}

/// Compares the techniques.
pub fn run(args: &Args) -> Result<(), String> {
    let competitor =
        |(name, technique): (&str, _)| Ok(Competitor { name: name.into(), settings: args.settings(technique)? });
    let techniques =
        [("ReSTIR PT", Technique::Pt), ("ReSTIR BDPT", Technique::Bdpt), ("ReSTIR DI + GI", Technique::Gi)];
    let competitors = techniques.into_iter().map(competitor).collect::<Result<Vec<_>, String>>()?;
    table("equal-time", args, &competitors, Detail::Passes)
}

impl Steps {
    /// Measures each step of Lin et al. 2026, or each variant of the command line.
    pub fn run(&self) -> Result<(), String> {
        let default = self.args.settings(Technique::Pt)?;
        let competitors = if self.variant.is_empty() {
            series::steps(&default)
                .into_iter()
                .map(|(name, settings)| Competitor { name: name.into(), settings })
                .collect()
        } else {
            let competitor =
                |text: &String| Ok(Competitor { name: text.clone(), settings: variant::of(&default, text)? });
            self.variant.iter().map(competitor).collect::<Result<Vec<_>, String>>()?
        };
        table("steps", &self.args, &competitors, Detail::Stages)
    }
}

impl Args {
    fn settings(&self, technique: Technique) -> Result<Restir, String> {
        variant::of(&series::plain(technique, self.bounces), &self.set.join(" "))
    }
}

fn table(name: &str, args: &Args, competitors: &[Competitor], detail: Detail) -> Result<(), String> {
    let Lengths { output, size, counts, .. } = &args.lengths;
    output.check(name)?;
    let mut table = Table::default();
    let reference = args.settings(Technique::Reference)?;
    for scene in scenes(&args.scenes)? {
        let bench = Bench::of_scene(&scene, *size, reference.clone(), counts);
        let rows = bench.and_then(|mut bench| {
            let rows = column(&args.lengths, &mut bench, &reference, competitors, detail)?;
            args.lengths.describe(&mut table, &bench, args.bounces);
            Ok(rows)
        });
        table.columns.push((scene.1.clone(), rows.map_err(|error| format!("{}: {error}", scene.1))?));
        output.write_so_far(name, &table)?;
    }
    output.write(name, &table)
}

impl Lengths {
    /// Writes the header of a table, if it has none.
    pub fn describe(&self, table: &mut Table, bench: &Bench, bounces: u32) {
        let Self { counts: Counts { warmup, frames }, seeds, samples, .. } = self;
        describe(
            table,
            bench.adapter(),
            self.size,
            format!(
                "{bounces} bounces; times: medians over {frames} frames after {warmup}; errors: means over {seeds} seeds after \
                 {warmup} frames, against {samples} samples a pixel; without emitters: without the pixels that see a lamp or the \
                 sky directly, and those beside them"
            ),
        );
    }
}

/// Samples of the light that the camera sees directly: with jitter, the edge of a lamp covers a part of a pixel.
const EMISSION_SAMPLES: u32 = 64;

/// The figures of a scene.
pub fn column(
    lengths: &Lengths,
    bench: &mut Bench,
    reference: &Restir,
    competitors: &[Competitor],
    detail: Detail,
) -> Result<Vec<Row>, String> {
    let planned = |settings| Bench::planned(&lengths.counts, settings, lengths.seeds);
    let frames = u64::from(EMISSION_SAMPLES)
        + u64::from(lengths.samples.next_multiple_of(2))
        + planned(reference)
        + competitors.iter().map(|competitor| planned(&competitor.settings)).sum::<u64>();
    let progress = Progress::new(frames);

    let emission = Restir { bounces: 0, ..reference.clone() };
    let emission = bench.pictures(&emission, 1, EMISSION_SAMPLES - 1, &progress)?;
    let truth = bench.reference(reference, lengths.samples, &progress)?.without_emitters(&emission[0]);
    let errors = Errors { reference: &truth, seeds: lengths.seeds };
    let (sample, one) = measured(bench, reference, &errors, &progress)?;
    let mut rows = scene_rows(bench, &truth, &sample, one);
    let mut first: Option<(&str, f64, Error)> = None;
    for Competitor { name, settings } in competitors {
        let (cost, error) = measured(bench, settings, &errors, &progress)?;
        let RestirReport { reservoir_bytes_per_pixel, light_paths, light_vertices, splats, .. } = bench.report();
        let samples = cost.lighting() / sample.lighting();
        if !samples.is_finite() {
            return Err("the driver measured no time".into());
        }
        let whole = match samples.round() as u32 {
            0 => Error::UNKNOWN,
            n => bench.error(reference, &errors, n - 1, &progress)?,
        };
        let row = |label: &str, figures: &[_]| Row::new(name.clone(), label, figures);
        rows.extend(match detail {
            Detail::Passes => passes(name, &cost),
            Detail::Stages => vec![stages(name, &cost)],
        });
        if light_paths > 0 {
            let [paths, vertices, splats] = [light_paths, light_vertices, splats].map(|count| count as f64);
            let figures =
                [("", Unit::Count, paths), ("vertices", Unit::Count, vertices), ("seen", Unit::Count, splats)];
            rows.push(row("light paths", &figures));
        }
        rows.extend([
            row("rays", &[("", Unit::RaysAPixel, cost.rays)]),
            row("reservoirs", &[("", Unit::BytesAPixel, reservoir_bytes_per_pixel as f64)]),
        ]);
        rows.extend(errors_of(name, &error));
        rows.push(row("the reference tracer in equal time", &[("", Unit::Samples, samples)]));
        rows.extend(relative_errors_of_the_tracer(name, samples, &one, &whole, &error));
        let (first_name, first_ms, first_error) = *first.get_or_insert((name.as_str(), cost.lighting(), error));
        if first_name != name {
            rows.extend(errors_in_equal_time(name, first_name, first_ms / cost.lighting(), &first_error, &error));
        }
    }
    Ok(rows)
}

fn measured(
    bench: &mut Bench,
    settings: &Restir,
    errors: &Errors,
    progress: &Progress,
) -> Result<(Cost, Error), String> {
    let (cost, error) = bench.measure(settings, Some(errors), progress)?;
    Ok((cost, error.unwrap_or_default()))
}

/// Errors of a technique.
fn errors_of(name: &str, error: &Error) -> [Row; 3] {
    let row = |label: &str, figures: &[_]| Row::new(name.to_owned(), label, figures);
    let figures = |mean, median, mape| {
        [("", Unit::Mse, mean), ("median of blocks", Unit::Mse, median), ("MAPE", Unit::Relative, mape)]
    };
    let WithoutEmitters { mean, median, mape } = error.without_emitters;
    [
        row("error", &figures(error.mean, error.median, error.mape)),
        row("error without emitters", &figures(mean, median, mape)),
        row(
            "relative error",
            &[
                ("all", Unit::RelMse, error.rel_mse),
                ("without the worst 1 %", Unit::RelMse, error.rel_mse_trimmed),
                ("", Unit::Flip, error.flip),
            ],
        ),
    ]
}

/// Errors of the reference tracer relative to those of a technique in whose time it takes this many samples: from that of one sample, and of
/// whole samples.
fn relative_errors_of_the_tracer(name: &str, samples: f64, one: &Error, whole: &Error, error: &Error) -> [Row; 3] {
    let row = |label: &str, mean: f64, median: f64| {
        Row::new(name.to_owned(), label, &[("", Unit::Ratio, mean), ("median", Unit::Ratio, median)])
    };
    let (ours, theirs) = (error.without_emitters, whole.without_emitters);
    [
        row(
            "its error, relative: scaled from one sample",
            one.mean / samples / error.mean,
            one.median / samples / error.median,
        ),
        row("its error, relative: of whole samples", whole.mean / error.mean, whole.median / error.median),
        row(
            "its error without emitters, relative: of whole samples",
            theirs.mean / ours.mean,
            theirs.median / ours.median,
        ),
    ]
}

/// Errors of another technique relative to those of a row, times the ratio of their times: how much of the error the other technique would have
/// in the time of this row, if its error fell as the reciprocal of its time.
fn errors_in_equal_time(name: &str, other_name: &str, time: f64, other: &Error, error: &Error) -> [Row; 2] {
    let row = |which: &str, figures: &[_]| {
        Row::new(name.to_owned(), format!("{other_name} in equal time: {which}, relative"), figures)
    };
    let (ours, theirs) = (error.without_emitters, other.without_emitters);
    [
        row(
            "its error",
            &[
                ("", Unit::Ratio, time * other.mean / error.mean),
                ("median", Unit::Ratio, time * other.median / error.median),
                ("relMSE without the worst 1 %", Unit::Ratio, time * other.rel_mse_trimmed / error.rel_mse_trimmed),
            ],
        ),
        row(
            "its error without emitters",
            &[
                ("", Unit::Ratio, time * theirs.mean / ours.mean),
                ("median", Unit::Ratio, time * theirs.median / ours.median),
            ],
        ),
    ]
}

fn scene_rows(bench: &Bench, truth: &Reference, sample: &Cost, one: Error) -> Vec<Row> {
    const SCENE: &str = "Scene";
    const REFERENCE: &str = "The reference tracer";
    let report = bench.report();
    vec![
        Row::new(SCENE, "lights (emissive triangles and others)", &[("", Unit::Count, report.lights as f64)]),
        Row::new(SCENE, "triangles", &[("", Unit::Count, report.triangles as f64)]),
        Row::new(SCENE, "error of the converged picture", &[("", Unit::Mse, truth.noise)]),
        Row::new(SCENE, "pixels without emitters", &[("", Unit::Percent, 100.0 * truth.share_without_emitters())]),
        Row::new(REFERENCE, "a sample", &[("", Unit::Ms, sample.lighting()), ("", Unit::RaysAPixel, sample.rays)]),
        Row::new(REFERENCE, "error", &[("", Unit::Mse, one.mean), ("median of blocks", Unit::Mse, one.median)]),
    ]
}

/// One row per pass.
fn passes(name: &str, cost: &Cost) -> Vec<Row> {
    let all = core::iter::once(("all", cost.lighting()));
    all.chain(cost.of_passes()).map(|(pass, ms)| Row::new(name.to_owned(), pass, &[("", Unit::Ms, ms)])).collect()
}

/// Whether a pass resamples paths; direct light may have passes of its own.
fn is_of_paths(pass: &str) -> bool {
    ["pt_", "gi_", "bdpt_"].iter().any(|prefix| pass.starts_with(prefix))
}

/// Whether a pass traces light paths, or resamples those that the camera sees, as ReSTIR BDPT does.
fn is_of_light_paths(pass: &str) -> bool {
    pass == "light_paths" || pass.starts_with("splats") || pass.starts_with("reconnected")
}

/// The columns of Table 1 of Lin et al. 2026, supplement: a frame, initial candidates, temporal and spatial reuse, direct light and
/// the rest.  Light paths have a column of their own where there are any.
fn stages(name: &str, cost: &Cost) -> Row {
    let of = |counts: fn(&str) -> bool| -> f64 { cost.of_passes().filter(|(n, _)| counts(n)).map(|(_, ms)| ms).sum() };
    let figures = [
        ("frame", cost.lighting()),
        ("initial", of(|name| is_of_paths(name) && name.ends_with("_candidates"))),
        ("temporal", of(|name| is_of_paths(name) && name.ends_with("_reuse"))),
        ("spatial", of(|name| is_of_paths(name) && (name.contains("_reuse_") || name.contains("_pair_")))),
        ("light paths", of(is_of_light_paths)),
        ("DI + other", of(|name| !is_of_paths(name) && !is_of_light_paths(name))),
    ];
    let shown = figures.into_iter().filter(|(name, ms)| *name != "light paths" || *ms > 0.0);
    Row::new(name.to_owned(), "", &shown.map(|(name, ms)| (name, Unit::Ms, ms)).collect::<Vec<_>>())
}
