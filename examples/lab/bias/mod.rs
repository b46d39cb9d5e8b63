//! Sign and size of the bias of each setting that has one.

mod list;

use bevy::math::UVec2;
use bevy_restir::{Jitter, Preset, Restir, Technique};
use bevy_restir_support::{arguments, progress::Progress};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Counts, Scene, scenes},
    error::{Picture, Reference, mean},
    motion::{FRAMES, Motion, REST, spawn_object},
    output::{Output, describe},
    significance::mean_and_error,
    table::{Row, Table, Unit},
    variant,
};
use list::{SETTINGS, Setting};

/// Sign and size of the bias of each setting that has one: the mean of single frames of `Unbiased` with this setting alone, relative to the
/// reference tracer.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(default_values = [
        "assets/scenes/cornell.glb", "assets/scenes/glossy.glb", "assets/scenes/ajar.glb", "assets/scenes/glass_lamp.glb"
    ])]
    scenes: Vec<PathBuf>,
    /// Measures only settings whose section and name, as in "Pt, at rest: denoiser", contain this text.
    #[arg(long, default_value = "", hide_default_value = true)]
    only: String,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "64x64", value_parser = arguments::size)]
    size: UVec2,
    /// Number of independent runs.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    seeds: u32,
    /// Samples per pixel of the converged pictures.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    samples: u32,
    /// Frames of a run that build up history before those that count.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(..=1_000_000))]
    warmup: u32,
    /// Frames of a run that count, at rest; in motion, only the last frame counts.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Distance of the passing object from the camera, m.  The size and speed of the object scale with it.
    #[arg(long, default_value_t = 1.0, value_parser = arguments::positive::<f32>)]
    distance: f32,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "bias";

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let mut table = Table::default();
    for scene in scenes(&args.scenes)? {
        let (adapter, rows) = args.column(&scene).map_err(|error| format!("{}: {error}", scene.1))?;
        let Args { samples, seeds, frames, warmup, .. } = args;
        describe(
            &mut table,
            adapter,
            args.size,
            format!(
                "Unbiased without jitter and one change: difference of the mean from the reference tracer ({samples} samples a pixel), its standard \
                 error over {seeds} runs, and relMSE of single frames without the worst percent; {frames} frames of a run after {warmup}; in \
                 motion, the last frame of {}",
                FRAMES + REST + 1
            ),
        );
        table.columns.push((scene.1, rows));
        args.output.write_so_far(NAME, &table)?;
    }
    args.output.write(NAME, &table)
}

impl Args {
    /// Fails if no setting is named as `--only` asks.
    pub fn check(&self) -> Result<(), String> {
        let is_known = self.settings().next().is_some();
        is_known.then_some(()).ok_or(format!("--only: no setting is named {}", self.only))
    }

    fn settings(&self) -> impl Iterator<Item = &'static Setting> {
        SETTINGS.iter().filter(move |setting| setting.full_name().contains(&self.only))
    }

    /// The frames of a run that count.
    fn frames_of(&self, in_motion: bool) -> Vec<u32> {
        if in_motion { vec![FRAMES + REST] } else { (self.warmup..self.warmup + self.frames).collect() }
    }

    fn column(&self, scene: &Scene) -> Result<(String, Vec<Row>), String> {
        // The reference tracer would jitter, and single frames would not: edges would differ.
        let plain = Restir { jitter: Jitter::Never, ..Restir::preset(Preset::Unbiased) };
        let tracer = Restir { technique: Technique::Reference, ..plain.clone() };
        let mut bench = Bench::of_scene(scene, self.size, tracer.clone(), &Counts { warmup: 0, frames: 1 })?;
        let camera = bench.place();
        let mut rows = Vec::new();
        for in_motion in [false, true] {
            let settings: Vec<_> = self.settings().filter(|setting| setting.in_motion == in_motion).collect();
            if settings.is_empty() {
                continue;
            }
            if in_motion {
                let object = spawn_object(&mut bench);
                bench.set_mover(Some(object));
                bench.set_motion(Motion::Pass.places(camera, self.distance));
            }
            let frames = self.frames_of(in_motion);
            let each = frames.last().map_or(0, |last| u64::from(last + 1) * u64::from(self.seeds));
            let progress = Progress::new(u64::from(self.samples) + each * settings.len() as u64);
            let reference = bench.reference(&tracer, self.samples, &progress)?;
            for setting in settings {
                let changed = variant::of(&Restir { technique: setting.technique, ..plain.clone() }, setting.fields)?;
                let (runs, _) = bench.runs(&changed, self.seeds, &frames, &progress)?;
                rows.push(row(setting, &runs, &reference));
            }
        }
        Ok((bench.adapter(), rows))
    }
}

/// Difference of the mean from the reference, its standard error, and the error of single frames.
fn row(setting: &Setting, runs: &[Vec<Picture>], reference: &Reference) -> Row {
    let count = |of: f64| of / runs.iter().map(Vec::len).sum::<usize>() as f64;
    let means: Vec<f64> =
        runs.iter().map(|run| run.iter().map(|picture| mean(picture, |c| c)).sum::<f64>() / run.len() as f64).collect();
    let (ours, error) = mean_and_error(&means);
    let theirs = mean(reference.pixels(), |c| c);
    // Half the difference of the means of two halves estimates the standard error of their mean.
    let error = error.hypot(mean(reference.deviations(), |c| c));
    let squares = count(runs.iter().flatten().map(|picture| reference.error(picture).rel_mse_trimmed).sum());
    let figures = [
        ("difference", Unit::Percent, 100.0 * (ours / theirs - 1.0)),
        ("±", Unit::Percent, 100.0 * error / theirs),
        ("", Unit::RelMse, squares),
    ];
    Row::new(setting.section(), setting.name, &figures)
}
