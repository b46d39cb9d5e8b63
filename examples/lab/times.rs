//! Times of a frame by technique and preset.

use bevy::math::UVec2;
use bevy_restir::{Preset, Restir, Technique};
use bevy_restir_support::{arguments, progress::Progress};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Cost, Counts, Scene, pixels, scenes},
    output::{Output, describe},
    table::{Row, Table, Unit},
};

/// Time of a frame, rays and memory of every technique and preset, at rest and with a camera that turns.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "1920x1080", value_parser = arguments::size)]
    size: UVec2,
    /// Number of frames of a run; the times of the second half count.
    #[arg(long, default_value_t = 48, value_parser = clap::value_parser!(u32).range(4..=16_000_000))]
    frames: u32,
    /// Measures only techniques and presets whose names, as in "Pt Balanced", contain this text.
    #[arg(long, default_value = "", hide_default_value = true)]
    only: String,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "times";
/// Turn of the camera in a frame, radians.
const TURN: f32 = 0.005;

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let mut table = Table::default();
    for scene in scenes(&args.scenes)? {
        let (adapter, rows) = args.column(&scene).map_err(|error| format!("{}: {error}", scene.1))?;
        describe(
            &mut table,
            adapter,
            args.size,
            format!(
                "lighting of a frame at rest / while the camera turns by {TURN} radians a frame: medians of the last {} of {} frames",
                args.frames.div_ceil(2),
                args.frames
            ),
        );
        table.columns.push((scene.1, rows));
    }
    args.output.write(NAME, &table)
}

impl Args {
    /// Fails if nothing is named as `--only` asks.
    pub fn check(&self) -> Result<(), String> {
        let is_known = !self.configurations().is_empty();
        is_known.then_some(()).ok_or(format!("--only: no technique and preset are named {}", self.only))
    }

    fn configurations(&self) -> Vec<(Technique, Preset)> {
        let all = Technique::ALL.into_iter().flat_map(|technique| Preset::ALL.map(|preset| (technique, preset)));
        all.filter(|(technique, preset)| format!("{technique:?} {preset:?}").contains(&self.only)).collect()
    }

    fn column(&self, scene: &Scene) -> Result<(String, Vec<Row>), String> {
        let counts = Counts { warmup: self.frames, frames: 1 };
        let all = self.configurations();
        let first = Restir { technique: all[0].0, ..Restir::preset(all[0].1) };
        let mut bench = Bench::of_scene(scene, self.size, first, &counts)?;
        let progress = Progress::new(2 * u64::from(self.frames) * all.len() as u64);
        let (mut times, mut work, mut passes) = (Vec::new(), Vec::new(), Vec::new());
        for (technique, preset) in all {
            let settings = Restir { technique, ..Restir::preset(preset) };
            let costs = self.costs(&mut bench, &settings, &progress)?;
            let [still, moving] = costs.each_ref().map(|cost| ("", Unit::Ms, cost.lighting()));
            let name = format!("{technique:?}");
            times.push(Row::new(name.clone(), format!("{preset:?}"), &[still, moving]));
            if preset == Preset::Balanced {
                work.push(self.work(&name, &costs[0], bench.bytes()));
                passes.extend(of_passes(&name, &costs));
            }
        }
        Ok((bench.adapter(), [times, work, passes].concat()))
    }

    /// Rays and memory of a technique.
    fn work(&self, technique: &str, cost: &Cost, bytes: u64) -> Row {
        let figures = [
            ("", Unit::RaysAPixel, cost.rays),
            ("", Unit::Rate, cost.rays * pixels(self.size) / (1e3 * cost.lighting())),
            ("", Unit::MiB, bytes as f64 / f64::from(1 << 20)),
        ];
        Row::new("Balanced: rays, rays in a second of lighting, memory", technique, &figures)
    }

    /// The cost of a frame at rest and in motion.
    fn costs(&self, bench: &mut Bench, settings: &Restir, progress: &Progress) -> Result<[Cost; 2], String> {
        let place = bench.place();
        let turned = |left: u32| {
            let mut place = place;
            place.rotate_y(TURN * left as f32);
            place
        };
        let last = [self.frames - 1];
        bench.set_motion(Vec::new());
        let (_, still) = bench.runs(settings, 1, &last, progress)?;
        // Frames of the reference tracer are added up, so that its camera does not move.
        if settings.technique == Technique::Reference {
            let moving = still.unknown();
            return Ok([still, moving]);
        }
        bench.set_motion((0..self.frames).rev().map(turned).collect());
        let (_, moving) = bench.runs(settings, 1, &last, progress)?;
        Ok([still, moving])
    }
}

/// Milliseconds of each pass, at rest and in motion.
fn of_passes(technique: &str, [still, moving]: &[Cost; 2]) -> Vec<Row> {
    let row = |((name, still), (_, moving)): ((&'static str, f64), (&'static str, f64))| {
        Row::new(format!("Passes of {technique}, Balanced"), name, &[("", Unit::Ms, still), ("", Unit::Ms, moving)])
    };
    still.every_pass().zip(moving.every_pass()).map(row).collect()
}
