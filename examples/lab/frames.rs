//! Errors of single frames with a long history: the frames that a user sees.

use bevy::math::UVec2;
use bevy_restir::{Jitter, Preset, Restir, Technique};
use bevy_restir_support::progress::Progress;

use crate::{
    bench::{Bench, Counts, Scene, lit, pixels, reference_bounces, scenes},
    compare,
    difference::Difference,
    error::{Picture, Reference, mean},
    output::{Output, describe},
    subject::Subject,
    table::{Row, Table, Unit},
    variant,
};

/// Errors of single frames of an unchanged preset, and the time and the memory of a frame.  Beside each scene must be its reference NAME.exr, and
/// `references.json` with its number of bounces.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Fields of `Restir` as `"PATH=VALUE PATH=VALUE"`, measured beside the preset; repeatable.
    #[arg(long, value_parser = variant::parse)]
    variant: Vec<String>,
    /// Number of independent frames over which figures are averaged.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    seeds: u32,
    /// Samples a pixel of the reference tracer through the centers of pixels, as frames see the scene, for the row of energy.
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    centers: u32,
    #[command(flatten)]
    counts: Counts,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "frames";
/// Side of a tile in pixels; no figure of this table depends on it.
const TILE: usize = 8;

pub fn run(args: &Args) -> Result<(), String> {
    let Counts { warmup, frames } = args.counts;
    args.output.check(NAME)?;
    let mut table = Table::default();
    for scene in scenes(&args.subject.scenes)? {
        let measured = args.column(&scene).map_err(|error| format!("{}: {error}", scene.1))?;
        describe(
            &mut table,
            measured.adapter,
            measured.size,
            format!(
                "{:?}, {:?}: the frame after {warmup} others, means over {} seeds; times: medians over {frames} frames after {warmup}",
                args.subject.technique, args.subject.preset, args.seeds
            ),
        );
        table.columns.push((scene.1, measured.rows));
        args.output.write_so_far(NAME, &table)?;
    }
    args.output.write(NAME, &table)
}

/// The figures of a scene.
struct Measured {
    adapter: String,
    size: UVec2,
    rows: Vec<Row>,
}

impl Args {
    fn column(&self, scene: &Scene) -> Result<Measured, String> {
        let (size, reference) = compare::read(&scene.0.with_extension("exr"))?;
        lit(&reference)?;
        let settings = self.settings(scene)?;
        let mut bench = Bench::of_scene(scene, size, settings[0].1.clone(), &self.counts)?;
        let Counts { warmup, frames } = self.counts;
        let frames_each = u64::from(self.seeds) * u64::from(warmup + 1) + u64::from(warmup) + u64::from(frames);
        let progress = Progress::new(settings.len() as u64 * frames_each + 2 * u64::from(self.centers.div_ceil(2)));
        let centers = Restir { technique: Technique::Reference, jitter: Jitter::Never, ..settings[0].1.clone() };
        let centers = bench.reference(&centers, self.centers, &progress)?;
        let mut rows = Vec::new();
        for (name, settings) in &settings {
            let pictures = bench.pictures(settings, self.seeds, self.counts.warmup, &progress)?;
            let energy = energy(&pictures, &centers);
            let figures: Vec<Difference> =
                pictures.into_iter().map(|picture| Difference::new(picture, &reference, size, TILE)).collect();
            let (cost, _) = bench.measure(settings, None, &progress)?;
            let memory = of_camera(&bench.report().memory) as f64 / pixels(size);
            let average = |of: fn(&Difference) -> f64| figures.iter().map(of).sum::<f64>() / figures.len() as f64;
            let row = |label: &str, figures: &[_]| Row::new(name.clone(), label, figures);
            rows.extend([
                row("relMSE without the worst percent", &[("", Unit::Relative, average(|d| d.rel_mse_trimmed))]),
                row("relMSE", &[("", Unit::Relative, average(|d| d.rel_mse))]),
                row("MAPE", &[("", Unit::Relative, average(|d| d.mape))]),
                row("FLIP", &[("", Unit::Plain, average(|d| d.flip))]),
                row("black pixels", &[("", Unit::Relative, average(|d| d.black))]),
                row("energy", &[("", Unit::Relative, energy[0])]),
                row("standard error of energy", &[("", Unit::Relative, energy[1])]),
                row("lighting", &[("", Unit::Ms, cost.lighting())]),
                row("memory", &[("", Unit::BytesAPixel, memory)]),
            ]);
        }
        Ok(Measured { adapter: bench.adapter(), size, rows })
    }

    /// The preset with the number of bounces of the reference, and the variants.  The references are
    /// without energy compensation.
    fn settings(&self, scene: &Scene) -> Result<Vec<(String, Restir)>, String> {
        let bounces = reference_bounces(scene)?;
        let plain = Restir { bounces, energy_compensation: false, ..self.subject.settings() };
        with_variants(self.subject.preset, plain, &self.variant)
    }
}

/// Bytes of the camera's buffers and textures, which follow those of the scene in a report, without the subsets of lights: their size does not
/// depend on the picture.
fn of_camera(memory: &[(&'static str, u64)]) -> u64 {
    let own = memory.iter().skip_while(|(name, _)| *name != "view uniforms");
    own.filter(|(name, _)| *name != "light subsets").map(|(_, bytes)| bytes).sum()
}

/// The relative difference of the mean light of frames from a converged picture, and its standard error.
fn energy(frames: &[Picture], converged: &Reference) -> [f64; 2] {
    let light = mean(converged.pixels(), |c| c);
    let off: Vec<f64> = frames.iter().map(|frame| mean(frame, |c| c) / light - 1.0).collect();
    let average = off.iter().sum::<f64>() / off.len() as f64;
    let spread = off.iter().map(|x| (x - average).powi(2)).sum::<f64>() / (off.len() as f64 - 1.0);
    // The halves of the converged picture differ by twice their deviations.
    let of_converged = mean(converged.deviations(), |c| c) / light;
    [average, (spread / off.len() as f64).sqrt().hypot(of_converged)]
}

/// The settings of a preset, and their variants, each with its name.  `variants`: assignments to fields of `Restir`, separated by spaces.
pub fn with_variants(preset: Preset, plain: Restir, variants: &[String]) -> Result<Vec<(String, Restir)>, String> {
    let mut all = vec![(format!("{preset:?}"), plain.clone())];
    for text in variants {
        all.push((text.clone(), variant::of(&plain, text)?));
    }
    Ok(all)
}
