//! Cost and error of each part of ReSTIR DI on this adapter, in the shape of Table 1 of Wyman and Panteleev 2021.

use bevy::math::UVec2;
use bevy_restir::Restir;
use bevy_restir_support::{arguments, progress::Progress};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Cost, Counts, Errors, Scene, pixels, scenes},
    error::{Error, Reference},
    output::{Output, describe},
    series::{self, Entry, Shown},
    table::{Row, Table, Unit},
};

/// Times, rays and errors of direct light by its settings, in the shape of Table 1 of Wyman and Panteleev 2021.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    size: UVec2,
    #[command(flatten)]
    counts: Counts,
    /// Number of independent frames over which errors are averaged.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    seeds: u32,
    /// Samples per pixel of the converged picture.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    samples: u32,
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("ablate")?;
    let mut table = Table { notes: vec![series::BITTERLI_NOTE.into()], ..Table::default() };
    for scene in scenes(&args.scenes)? {
        let measured = Measured::new(args, &scene).map_err(|error| format!("{}: {error}", scene.1))?;
        let Args { counts: Counts { warmup, frames }, seeds, samples, .. } = args;
        describe(
            &mut table,
            measured.adapter.clone(),
            args.size,
            format!(
                "times: medians over {frames} frames after {warmup}; errors: means over {seeds} seeds after {warmup} \
                 frames, against {samples} samples a pixel"
            ),
        );
        table.columns.push((scene.1, measured.rows()));
        args.output.write_so_far("ablate", &table)?;
    }
    args.output.write("ablate", &table)
}

/// The measurements of a scene.
struct Measured {
    adapter: String,
    lights: u64,
    triangles: u64,
    reference: Reference,
    /// Settings, their costs and their errors.
    results: Vec<(Restir, Cost, Option<Error>)>,
    /// The default frame with and without rays, at a quarter of the pixels and at four times as many.
    resolutions: Vec<[Cost; 2]>,
    reservoir_bytes: u64,
    /// Bytes of all buffers and textures: per pixel, and those that do not grow with the picture.
    pixel_bytes: f64,
    fixed_bytes: f64,
    /// Measured error of the reference tracer in the time of each of the [`competitors`], in their order.
    equal_time: Vec<Option<f64>>,
}

/// Settings that are compared with the reference tracer and plain candidates at equal time.
fn competitors() -> [(&'static str, Restir); 3] {
    [
        ("default", series::default()),
        ("the paper's pipeline", series::paper()),
        ("the preset Performance", series::performance()),
    ]
}

/// All settings to measure without duplicates, and whether their errors are needed.
fn plan(entries: &[Entry]) -> Vec<(Restir, bool)> {
    let mut plan: Vec<(Restir, bool)> = Vec::new();
    let mut want = |settings: &Restir, error: bool| match plan.iter_mut().find(|p| p.0 == *settings) {
        Some(planned) => planned.1 |= error,
        None => plan.push((settings.clone(), error)),
    };
    want(&series::default(), true);
    want(&series::without_rays(series::default()), false);
    for entry in entries {
        want(&entry.settings, entry.shown.contains(&Shown::Error));
    }
    for settings in [series::reference(), series::candidates_only()].iter().chain(competitors().iter().map(|r| &r.1)) {
        want(settings, true);
    }
    plan
}

/// Picture sizes with a quarter and with four times the pixels.
fn other_sizes(size: UVec2) -> [UVec2; 2] {
    [(size / 2).max(UVec2::ONE), size * 2]
}

/// Bytes per pixel of the allocations that grow with the picture, and bytes of the others, from the memory at two sizes.
fn bytes(small: &(f64, Vec<(&str, u64)>), large: &(f64, Vec<(&str, u64)>)) -> (f64, f64) {
    let held =
        |memory: &[(&str, u64)], name| -> f64 { memory.iter().filter(|m| m.0 == name).map(|m| m.1 as f64).sum() };
    let mut names: Vec<&str> = small.1.iter().map(|m| m.0).collect();
    names.sort_unstable();
    names.dedup();
    let (mut a_pixel, mut fixed) = (0.0, 0.0);
    for name in names {
        let (a, b) = (held(&small.1, name), held(&large.1, name));
        if a * large.0 == b * small.0 { a_pixel += a / small.0 } else { fixed += a }
    }
    (a_pixel, fixed)
}

impl Measured {
    fn new(args: &Args, scene: &Scene) -> Result<Self, String> {
        let (default, bare) = (series::default(), series::without_rays(series::default()));
        let plan = plan(&series::entries());
        let seeds = |error: bool| if error { args.seeds } else { 0 };
        let frames: u64 = plan.iter().map(|(s, error)| Bench::planned(&args.counts, s, seeds(*error))).sum();
        let progress = Progress::new(
            frames + u64::from(args.samples.next_multiple_of(2)) + 4 * Bench::planned(&args.counts, &default, 0),
        );

        let mut resolutions = Vec::new();
        let mut memory = Vec::new();
        for size in other_sizes(args.size) {
            let mut bench = Bench::of_scene(scene, size, default.clone(), &args.counts)?;
            let bare = bench.measure(&bare, None, &progress)?.0;
            resolutions.push([bench.measure(&default, None, &progress)?.0, bare]);
            memory.push((pixels(size), bench.report().memory));
        }
        let (pixel_bytes, fixed_bytes) = bytes(&memory[0], &memory[1]);

        let mut bench = Bench::of_scene(scene, args.size, default.clone(), &args.counts)?;
        let reference = bench.reference(&series::reference(), args.samples, &progress)?;
        let errors = Errors { reference: &reference, seeds: args.seeds };
        let mut results = Vec::new();
        let mut reservoir_bytes = 0;
        for (settings, error) in plan {
            let (cost, error) = bench.measure(&settings, error.then_some(&errors), &progress)?;
            if settings == default {
                reservoir_bytes = bench.report().reservoir_bytes_per_pixel;
            }
            results.push((settings, cost, error));
        }
        let report = bench.report();
        let mut measured = Self {
            adapter: bench.adapter(),
            lights: report.lights,
            triangles: report.triangles,
            results,
            resolutions,
            reservoir_bytes,
            pixel_bytes,
            fixed_bytes,
            equal_time: Vec::new(),
            reference,
        };
        // Whole samples of the reference tracer in the time of each competitor.
        let errors = Errors { reference: &measured.reference, seeds: args.seeds };
        let mut equal_time = Vec::new();
        for (_, settings) in competitors() {
            let samples = measured.samples_in(&settings).round() as u32;
            equal_time.push(match samples {
                0 => None,
                n => Some(bench.error(&series::reference(), &errors, n - 1, &progress)?.mean),
            });
        }
        measured.equal_time = equal_time;
        Ok(measured)
    }

    fn cost(&self, settings: &Restir) -> &Cost {
        const NONE: &Cost = &Cost::NONE;
        self.results.iter().find(|r| r.0 == *settings).map_or(NONE, |r| &r.1)
    }

    fn errors(&self, settings: &Restir) -> Error {
        self.results.iter().find(|r| r.0 == *settings).and_then(|r| r.2).unwrap_or(Error::UNKNOWN)
    }

    /// The squared error.
    fn error(&self, settings: &Restir) -> f64 {
        self.errors(settings).mean
    }

    /// Number of reference samples that take as long as a frame.
    fn samples_in(&self, settings: &Restir) -> f64 {
        self.cost(settings).lighting() / self.cost(&series::reference()).lighting()
    }

    /// The column of the scene.
    fn rows(&self) -> Vec<Row> {
        let mut rows = self.default_frame();
        rows.extend(series::entries().iter().map(|entry| self.row(entry)));
        rows.extend(self.equal_time_rows());
        rows.extend(self.resolution_rows());
        rows
    }

    fn default_frame(&self) -> Vec<Row> {
        const SCENE: &str = "Scene";
        const FRAME: &str = "Default settings";
        let default = series::default();
        let cost = self.cost(&default);
        let bare = self.cost(&series::without_rays(default.clone()));
        let ms = |label, value| Row::new(FRAME, label, &[("", Unit::Ms, value)]);
        vec![
            Row::new(SCENE, "lights (emissive triangles and others)", &[("", Unit::Count, self.lights as f64)]),
            Row::new(SCENE, "triangles", &[("", Unit::Count, self.triangles as f64)]),
            Row::new(SCENE, "error of the converged picture", &[("", Unit::Mse, self.reference.noise)]),
            ms("presample (5.2)", bare.presample()),
            ms("initial candidates, without rays (5.2)", bare.candidates()),
            ms("trace rays: total less total without rays", cost.lighting() - bare.lighting()),
            ms("reuse and shade, without rays", bare.reuse_and_shade()),
            ms("total lighting", cost.lighting()),
            Row::new(FRAME, "rays", &[("", Unit::RaysAPixel, cost.rays)]),
            Row::new(FRAME, "error", &self.error_figures(&default)),
            Row::new(FRAME, "reservoirs", &[("", Unit::BytesAPixel, self.reservoir_bytes as f64)]),
            Row::new(FRAME, "all that grows with the picture", &[("", Unit::BytesAPixel, self.pixel_bytes)]),
            Row::new(FRAME, "all that does not", &[("", Unit::MiB, self.fixed_bytes / f64::from(1 << 20))]),
        ]
    }

    fn error_figures(&self, settings: &Restir) -> [(&'static str, Unit, f64); 2] {
        let Error { mean, flip, .. } = self.errors(settings);
        [("", Unit::Mse, mean), ("", Unit::Flip, flip)]
    }

    fn row(&self, entry: &Entry) -> Row {
        let cost = self.cost(&entry.settings);
        // A label is needed only where several figures have the unit.
        let several = entry.shown.contains(&Shown::Candidates);
        let total = if several { "total" } else { "" };
        let figures: Vec<_> = entry
            .shown
            .iter()
            .flat_map(|shown| match shown {
                Shown::Presample => vec![("presample", Unit::Ms, cost.presample())],
                Shown::Candidates => vec![("candidates", Unit::Ms, cost.candidates())],
                Shown::Reuse => vec![("reuse", Unit::Ms, cost.reuse())],
                Shown::Lighting => vec![(total, Unit::Ms, cost.lighting())],
                Shown::Rays => vec![("", Unit::RaysAPixel, cost.rays)],
                Shown::Error => self.error_figures(&entry.settings).into(),
            })
            .collect();
        Row::new(entry.section, entry.label.clone(), &figures)
    }

    fn equal_time_rows(&self) -> Vec<Row> {
        const SECTION: &str = "Error of others in equal time, relative";
        let (reference, candidates) = (series::reference(), series::candidates_only());
        let mut rows = Vec::new();
        for ((name, settings), directly) in competitors().into_iter().zip(&self.equal_time) {
            let (ours, samples) = (self.error(&settings), self.samples_in(&settings));
            let frames = self.cost(&settings).lighting() / self.cost(&candidates).lighting();
            rows.extend([
                Row::new(
                    SECTION,
                    format!("{name}: a frame"),
                    &[
                        ("", Unit::Ms, self.cost(&settings).lighting()),
                        ("", Unit::Mse, ours),
                        ("reference", Unit::Samples, samples),
                    ],
                ),
                Row::new(
                    SECTION,
                    format!("{name}: the reference tracer"),
                    &[
                        ("scaled from one sample", Unit::Ratio, self.error(&reference) / samples / ours),
                        ("whole samples", Unit::Ratio, directly.unwrap_or(f64::NAN) / ours),
                    ],
                ),
                Row::new(
                    SECTION,
                    format!("{name}: candidates without reuse"),
                    &[("scaled from one frame", Unit::Ratio, self.error(&candidates) / frames / ours)],
                ),
            ]);
            rows.extend(series::bitterli().iter().map(|(kind, other)| {
                let time = self.cost(other).lighting() / self.cost(&settings).lighting();
                let error = self.error(other) / ours;
                Row::new(
                    SECTION,
                    format!("{name}: Bitterli et al. 2020, {kind}"),
                    &[
                        ("time of a frame", Unit::Ratio, time),
                        ("its error", Unit::Ratio, error),
                        ("in equal time", Unit::Ratio, time * error),
                    ],
                )
            }));
        }
        rows
    }

    fn resolution_rows(&self) -> Vec<Row> {
        let default = series::default();
        let bare = series::without_rays(default.clone());
        let [small, large] = [&self.resolutions[0], &self.resolutions[1]];
        let all = [[&small[0], &small[1]], [self.cost(&default), self.cost(&bare)], [&large[0], &large[1]]];
        let row = |label: &str, of: fn(&Cost, &Cost) -> f64| {
            let [a, b, c] = all.map(|[cost, bare]| of(cost, bare));
            let figures = [("1/4", Unit::Ms, a), ("1", Unit::Ms, b), ("4 times the pixels", Unit::Ms, c)];
            Row::new("Resolution", label, &figures)
        };
        vec![
            row("initial candidates, without rays", |_, bare| bare.candidates()),
            row("trace rays", |cost, bare| cost.lighting() - bare.lighting()),
            row("reuse and shade, without rays", |_, bare| bare.reuse_and_shade()),
            row("total lighting", |cost, _| cost.lighting()),
        ]
    }
}
