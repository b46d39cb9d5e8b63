//! Error of ReSTIR PT by the criterion of reconnection and its constant.

use bevy_restir::{Restir, Technique};
use bevy_restir_support::progress::Progress;
use std::path::PathBuf;

use crate::{
    bench::{Bench, Errors, Scene, scenes},
    equal_time::Lengths,
    error::Error,
    output::describe,
    series,
    table::{Row, Table, Unit},
};

/// Errors of ReSTIR PT by the constant c of the footprint thresholds, and of the criteria that they are compared with (Lin et al. 2026,
/// supplement, 10 and 11).  Times are not measured.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Maximum number of scattering events of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: u32,
    #[command(flatten)]
    lengths: Lengths,
}

pub fn run(args: &Args) -> Result<(), String> {
    args.lengths.output.check("thresholds")?;
    let mut table = Table::default();
    for scene in scenes(&args.scenes)? {
        let rows = column(args, &scene, &mut table).map_err(|error| format!("{}: {error}", scene.1))?;
        table.columns.push((scene.1, rows));
        args.lengths.output.write_so_far("thresholds", &table)?;
    }
    args.lengths.output.write("thresholds", &table)
}

/// The figures of a scene.
fn column(args: &Args, scene: &Scene, table: &mut Table) -> Result<Vec<Row>, String> {
    let Lengths { size, counts, seeds, samples, .. } = &args.lengths;
    let reference = series::plain(Technique::Reference, args.bounces);
    let rows = series::thresholds(&series::plain(Technique::Pt, args.bounces));
    let mut bench = Bench::of_scene(scene, *size, reference.clone(), counts)?;
    let frames = u64::from(*seeds) * u64::from(counts.warmup + 1) * rows.len() as u64;
    let progress = Progress::new(u64::from(samples.next_multiple_of(2)) + frames);
    let truth = bench.reference(&reference, *samples, &progress)?;
    let errors = Errors { reference: &truth, seeds: *seeds };
    let mut measure = |settings: &Restir| bench.errors(settings, &errors, counts.warmup, &progress);
    let all = rows.iter().map(|(.., settings)| measure(settings)).collect::<Result<Vec<_>, _>>()?;
    describe(
        table,
        bench.adapter(),
        *size,
        format!(
            "{} bounces; errors: means over {seeds} seeds after {} frames, against {samples} samples a pixel; ±: standard error of the ratio",
            args.bounces, counts.warmup
        ),
    );
    Ok(rows.iter().zip(&all).map(|((section, label, _), errors)| row(section, label, errors, &all[0])).collect())
}

/// Errors, and the trimmed one relative to that of the default over the same seeds, with the standard error of this ratio.
fn row(section: &'static str, label: &str, errors: &[Error], default: &[Error]) -> Row {
    let Error { rel_mse, rel_mse_trimmed, flip, .. } = Error::average(errors);
    let base = Error::average(default).rel_mse_trimmed;
    let ratio = rel_mse_trimmed / base;
    let n = errors.len() as f64;
    let squares = errors.iter().zip(default).map(|(e, d)| (e.rel_mse_trimmed - ratio * d.rel_mse_trimmed).powi(2));
    let deviation = (squares.sum::<f64>() / (n * (n - 1.0))).sqrt() / base;
    let figures = [
        ("trimmed", Unit::RelMse, rel_mse_trimmed),
        ("all", Unit::RelMse, rel_mse),
        ("", Unit::Flip, flip),
        ("trimmed", Unit::Ratio, ratio),
        ("±", Unit::Ratio, deviation),
    ];
    Row::new(section, label, &figures)
}
