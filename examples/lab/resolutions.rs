//! Time per pixel by the size of the picture.

use bevy::math::UVec2;
use bevy_restir::Technique;
use bevy_restir_support::{arguments, progress::Progress, times::median};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Counts, pixels, scenes},
    output::{Output, provenance},
    series::plain,
    table::{Row, Table, Unit},
};

/// Time per pixel of each pass of ReSTIR PT by the size of the picture (Lin et al. 2026, supplement, Table 2).
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
    /// Sizes of the picture in pixels, one column each.
    #[arg(long, value_delimiter = ',', default_value = "128x72,256x144,512x288", value_parser = arguments::size)]
    sizes: Vec<UVec2>,
    #[command(flatten)]
    counts: Counts,
    /// How often all sizes are measured in turn, so that other work on the machine disturbs them alike.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    rounds: u32,
    /// Maximum number of scattering events of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: u32,
}

/// Name and milliseconds of the passes of a frame, and rays a pixel.
type Measured = (Vec<(&'static str, f64)>, f64);

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check("resolutions")?;
    let columns = args.sizes.iter().map(|size| (format!("{} x {}", size.x, size.y), Vec::new())).collect();
    let mut table = Table { columns, ..Table::default() };
    for scene in scenes(&args.scenes)? {
        let settings = plain(Technique::Pt, args.bounces);
        let of_size = |size: &UVec2| Bench::of_scene(&scene, *size, settings.clone(), &args.counts);
        let in_scene = |error| format!("{}: {error}", scene.1);
        let mut benches = args.sizes.iter().map(of_size).collect::<Result<Vec<_>, _>>().map_err(in_scene)?;
        let each = Bench::planned(&args.counts, &settings, 0);
        let progress = Progress::new(each * args.sizes.len() as u64 * u64::from(args.rounds));
        let mut rounds: Vec<Vec<Measured>> = vec![Vec::new(); benches.len()];
        for _ in 0..args.rounds {
            for (bench, measured) in benches.iter_mut().zip(&mut rounds) {
                let (cost, _) = bench.measure(&settings, None, &progress).map_err(in_scene)?;
                measured.push((cost.of_passes().collect(), cost.rays));
            }
        }
        if table.header.is_empty() {
            table.header = provenance(Some(benches[0].adapter()));
            let Counts { warmup, frames } = args.counts;
            table.header.push(format!(
                "{} bounces; times: medians over {} rounds, each the median over {frames} frames after {warmup}",
                args.bounces, args.rounds
            ));
        }
        let all: Vec<Measured> = rounds.into_iter().map(middle).collect();
        for (i, (_, rows)) in table.columns.iter_mut().enumerate() {
            rows.extend(column(&scene.1, &all, &args.sizes, i));
        }
    }
    args.output.write("resolutions", &table)
}

/// The median of each pass over the rounds.
fn middle(rounds: Vec<Measured>) -> Measured {
    let of = |pass: usize| median(&rounds.iter().map(|round| round.0[pass].1).collect::<Vec<_>>());
    let passes = rounds[0].0.iter().enumerate().map(|(i, (name, _))| (*name, of(i))).collect();
    (passes, rounds[0].1)
}

/// The figures of one size: microseconds a pixel, and the time of a frame relative to the size before.
fn column(scene: &str, all: &[Measured], sizes: &[UVec2], i: usize) -> Vec<Row> {
    let frame = |i: usize| all[i].0.iter().map(|(_, ms)| ms).sum::<f64>();
    let a_pixel =
        |label: &str, ms: f64| Row::new(scene.to_owned(), label, &[("", Unit::UsAPixel, 1e3 * ms / pixels(sizes[i]))]);
    let mut rows = vec![a_pixel("all", frame(i))];
    rows.extend(all[i].0.iter().map(|(name, ms)| a_pixel(name, *ms)));
    let grown = |of: f64, before: Option<f64>| before.map_or(f64::NAN, |before| of / before);
    let before = i.checked_sub(1);
    let figures = [
        ("pixels", Unit::Ratio, grown(pixels(sizes[i]), before.map(|i| pixels(sizes[i])))),
        ("a frame", Unit::Ratio, grown(frame(i), before.map(frame))),
    ];
    rows.push(Row::new(scene.to_owned(), "relative to the size before", &figures));
    rows.push(Row::new(scene.to_owned(), "rays", &[("", Unit::RaysAPixel, all[i].1)]));
    rows
}
