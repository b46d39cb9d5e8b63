//! A flight through a scene under `RestirBudget`.

use bevy::{
    math::{Quat, UVec2},
    transform::components::Transform,
};
use bevy_restir::{Restir, RestirBudget, pass_names};
use bevy_restir_support::{
    arguments,
    headless::{alive, frame},
    progress::Progress,
    scene::View,
    times::{Times, median},
};
use std::f32::consts::TAU;

use crate::{
    bench::{Bench, Counts, scenes},
    output::{Output, describe},
    subject::Subject,
    table::{Row, Table, Unit},
};

/// Times of a flight through a scene with and without a budget.  The camera turns from side to side, so that costs rise and fall.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    size: UVec2,
    #[command(flatten)]
    counts: Counts,
    /// Least `resolution_scale` that the budget may choose where the fewest samples still take too long.
    #[arg(long, value_name = "SCALE", default_value_t = 1.0, value_parser = arguments::resolution_scale)]
    least_resolution_scale: f32,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "budget";
/// Limits, as shares of the greatest median time without a budget.
const LIMITS: [f64; 4] = [0.9, 0.8, 0.7, 0.6];
/// Turn of the camera to each side, radians.
const TURN: f32 = 0.6;
/// Number of successive times whose median counts, so that outliers do not.
const SMOOTH: usize = 9;

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let least_resolution_scale = args.least_resolution_scale;
    let mut table = Table::default();
    for scene in scenes(&args.subject.scenes)? {
        let settings = args.subject.settings();
        let mut bench = Bench::of_scene(&scene, args.size, settings.clone(), &args.counts)?;
        let progress = Progress::new((1 + LIMITS.len() as u64) * u64::from(args.counts.warmup + args.counts.frames));
        describe(
            &mut table,
            bench.adapter(),
            args.size,
            format!(
                "{:?}, {:?}: {} frames of a flight after {} at its start; medians of {SMOOTH} successive times",
                args.subject.technique, args.subject.preset, args.counts.frames, args.counts.warmup
            ),
        );
        let free = fly(&mut bench, &settings, &args.counts, RestirBudget::default(), &progress)?;
        if free.times.len() < SMOOTH {
            return Err(format!("{} GPU times arrived; a budget needs at least {SMOOTH}", free.times.len()));
        }
        let most = free.smooth().fold(0.0, f64::max);
        let row = |section: &str, label: &str, unit, figure| Row::new(section.to_owned(), label, &[("", unit, figure)]);
        let mut rows = vec![
            row("without a budget", "median time", Unit::Ms, median(&free.times)),
            row("without a budget", "greatest time", Unit::Ms, most),
        ];
        for share in LIMITS {
            let limit = share * most;
            let budget = RestirBudget { gpu_ms: limit as f32, least_resolution_scale };
            let flight = fly(&mut bench, &settings, &args.counts, budget, &progress)?;
            let greatest = flight.smooth().fold(0.0, f64::max);
            let section = format!("limit: {share} of the greatest time");
            rows.extend([
                row(&section, "limit", Unit::Ms, limit),
                row(&section, "median time", Unit::Ms, median(&flight.times)),
                row(&section, "greatest time over the limit", Unit::Ratio, greatest / limit),
                row(&section, "frames above 1.1 times the limit", Unit::Relative, flight.share_above(1.1 * limit)),
                row(&section, "mean step", Unit::Plain, mean(flight.steps.iter().map(|step| f64::from(*step)))),
                row(&section, "mean resolution scale", Unit::Plain, mean(flight.scales.iter().map(|s| f64::from(*s)))),
                row(&section, "changes of the step", Unit::Count, flight.changes() as f64),
            ]);
        }
        table.columns.push((scene.1, rows));
        args.output.write_so_far(NAME, &table)?;
    }
    args.output.write(NAME, &table)
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

/// GPU time, ms, step and resolution scale of each frame.
struct Flight {
    times: Vec<f64>,
    steps: Vec<u32>,
    scales: Vec<f32>,
}

impl Flight {
    fn smooth(&self) -> impl Iterator<Item = f64> + '_ {
        self.times.windows(SMOOTH).map(median)
    }

    fn share_above(&self, ms: f64) -> f64 {
        let above = self.smooth().filter(|time| *time > ms).count();
        above as f64 / self.smooth().count().max(1) as f64
    }

    fn changes(&self) -> usize {
        self.steps.windows(2).filter(|pair| pair[0] != pair[1]).count()
    }
}

fn fly(
    bench: &mut Bench,
    settings: &Restir,
    counts: &Counts,
    budget: RestirBudget,
    progress: &Progress,
) -> Result<Flight, String> {
    let start = bench.place();
    // Without a limit it has no effect.
    bench.app().insert_resource(budget);
    let mut passes = Times::default();
    let mut flight = Flight { times: Vec::new(), steps: Vec::new(), scales: Vec::new() };
    for i in 0..counts.warmup + counts.frames {
        let along = i.saturating_sub(counts.warmup) as f32 / counts.frames as f32;
        let turn = Quat::from_rotation_y(TURN * (TAU * along).sin());
        let camera = bench.app().world().resource::<View>().camera;
        let place = Transform { rotation: turn * start.rotation, ..start };
        bench.app().world_mut().entity_mut(camera).insert(place);
        frame(bench.app());
        alive(bench.app())?;
        progress.step();
        passes.clear();
        let report = bench.report();
        // Frames with fewer pixels have a pass more.
        let reduced = settings.reduced_within(report.budget_step, budget.least_resolution_scale);
        passes.sample(bench.app().world(), &reduced);
        let names = pass_names(&reduced, report.features);
        let time: f64 = names.iter().flat_map(|name| passes.of(name)).sum();
        if i >= counts.warmup && time > 0.0 {
            flight.times.push(time);
            flight.steps.push(report.budget_step);
            flight.scales.push(reduced.resolution_scale);
        }
    }
    bench.app().world_mut().remove_resource::<RestirBudget>();
    let camera = bench.app().world().resource::<View>().camera;
    bench.app().world_mut().entity_mut(camera).insert(start);
    // The plugin forgets what it has learned about a budget in a frame without one.
    frame(bench.app());
    alive(bench.app())?;
    Ok(flight)
}
