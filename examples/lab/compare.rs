//! What ReSTIR PT and DI + GI cost and bring against the reference tracer in equal time.

use bevy::math::UVec2;
use bevy_restir::{Restir, Technique};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Cost, Counts, Errors, Scene, scenes},
    error::{Error, Reference},
    headless::{self, progress::Progress},
    output::{Output, header},
    table::{Row, Table, Unit},
};

/// Costs by stage, and errors in equal time, of the techniques that carry all light.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; the environment is that which `references.json` beside them names, or none.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
    /// Pixels.
    #[arg(long, default_value = "128x128", value_parser = headless::size)]
    size: UVec2,
    /// Scattering events of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: u32,
    #[command(flatten)]
    counts: Counts,
    /// Independent frames that an error is the mean of.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    seeds: u32,
    /// Samples a pixel of the converged picture.
    #[arg(long, default_value_t = 4096, value_parser = clap::value_parser!(u32).range(2..))]
    samples: u32,
}

/// What is held against the reference tracer.
const RIVALS: [(&str, Technique); 2] = [("ReSTIR PT", Technique::Pt), ("ReSTIR DI + GI", Technique::Gi)];

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("compare")?;
    let mut table = Table { header: Vec::new(), columns: Vec::new(), notes: Vec::new() };
    for scene in scenes(&args.scenes)? {
        let (adapter, rows) = column(args, &scene).map_err(|error| format!("{}: {error}", scene.1))?;
        if table.header.is_empty() {
            let Args { counts: Counts { warmup, frames }, seeds, samples, bounces, .. } = args;
            table.header = header(adapter, args.size);
            table.header.push(format!(
                "{bounces} bounces; times: medians over {frames} frames after {warmup}; errors: means over {seeds} seeds after \
                 {warmup} frames, against {samples} samples a pixel"
            ));
        }
        table.columns.push((scene.1, rows));
    }
    args.output.write("compare", &table)
}

/// Name of the adapter, and the figures of a scene.
fn column(args: &Args, scene: &Scene) -> Result<(String, Vec<Row>), String> {
    let settings = |technique| Restir {
        technique,
        bounces: args.bounces,
        jitter: false,
        energy_compensation: false,
        ..Restir::default()
    };
    let reference = settings(Technique::Reference);
    let planned = |technique| Bench::planned(&args.counts, &settings(technique), args.seeds);
    let frames = u64::from(args.samples.next_multiple_of(2))
        + planned(Technique::Reference)
        + RIVALS.iter().map(|(_, technique)| planned(*technique)).sum::<u64>();
    let progress = Progress::new(frames);

    let mut bench = Bench::of_scene(scene, args.size, reference.clone(), &args.counts)?;
    let truth = bench.reference(&reference, args.samples, &progress)?;
    let errors = Errors { reference: &truth, seeds: args.seeds };
    let (sample, one) = measured(&mut bench, &reference, &errors, &progress)?;
    let mut rows = scene_rows(&bench, &truth, &sample, one);
    for (name, technique) in RIVALS {
        let (cost, error) = measured(&mut bench, &settings(technique), &errors, &progress)?;
        let reservoirs = bench.report().reservoir_bytes_per_pixel;
        let samples = cost.lighting() / sample.lighting();
        let whole = match samples.round() as u32 {
            0 => Error { mean: f64::NAN, median: f64::NAN },
            n => bench.error(&reference, &errors, n - 1, &progress)?,
        };
        rows.extend(stages(name, &cost));
        rows.extend([
            Row::new(name, "rays", &[("", Unit::RaysAPixel, cost.rays)]),
            Row::new(name, "reservoirs", &[("", Unit::BytesAPixel, reservoirs as f64)]),
            Row::new(name, "error", &[("", Unit::Mse, error.mean), ("median of blocks", Unit::Mse, error.median)]),
            Row::new(name, "the reference tracer in equal time", &[("", Unit::Samples, samples)]),
            Row::new(
                name,
                "its error, relative: scaled from one sample",
                &[("", Unit::Ratio, one.mean / samples / error.mean)],
            ),
            Row::new(
                name,
                "its error, relative: of whole samples",
                &[("", Unit::Ratio, whole.mean / error.mean), ("median", Unit::Ratio, whole.median / error.median)],
            ),
        ]);
    }
    Ok((bench.adapter(), rows))
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

fn scene_rows(bench: &Bench, truth: &Reference, sample: &Cost, one: Error) -> Vec<Row> {
    const SCENE: &str = "Scene";
    const REFERENCE: &str = "The reference tracer";
    let report = bench.report();
    vec![
        Row::new(SCENE, "lights (emissive triangles and others)", &[("", Unit::Count, report.lights as f64)]),
        Row::new(SCENE, "triangles", &[("", Unit::Count, report.triangles as f64)]),
        Row::new(SCENE, "error of the converged picture", &[("", Unit::Mse, truth.noise)]),
        Row::new(REFERENCE, "a sample", &[("", Unit::Ms, sample.lighting()), ("", Unit::RaysAPixel, sample.rays)]),
        Row::new(REFERENCE, "error", &[("", Unit::Mse, one.mean), ("median of blocks", Unit::Mse, one.median)]),
    ]
}

/// A row a pass: initial candidates, temporal and spatial reuse, what puts light together (the shape of paper 000, Table 1).
fn stages(name: &'static str, cost: &Cost) -> Vec<Row> {
    let all = core::iter::once(("all", cost.lighting()));
    all.chain(cost.of_passes()).map(|(pass, ms)| Row::new(name, pass, &[("", Unit::Ms, ms)])).collect()
}
