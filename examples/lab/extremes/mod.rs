//! Mean light at extremes of distance, scale, radiance, roughness, bounces, gaps and a sun's elevation.

mod stage;

use bevy::{math::UVec2, prelude::*};
use bevy_restir::{Preset, RayBackend, Restir, RestirStatistics, Technique};
use bevy_restir_support::{
    arguments,
    exposure::unit_exposure,
    headless::{alive, frame},
    progress::Progress,
    scene::{self, CameraSetup, View},
};
use std::path::Path;

use crate::{
    bench::{Bench, Counts, lit},
    blocks,
    difference::{Difference, is_finite},
    error::{Picture, mean},
    output::{Output, header},
    significance::{mean_and_error, student},
    table::{Row, Table, Unit},
    things,
};
use stage::{Axis, Stage, Truth};

/// Mean light at extremes: distance from the origin, scale, radiance, roughness, number of bounces, thin gaps and grazing suns.  One row a
/// value, one column a technique.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Techniques to measure.
    #[arg(long, value_delimiter = ',', default_value = "reference,di,gi,pt,bdpt", value_parser = arguments::choice::<Technique>())]
    techniques: Vec<Technique>,
    /// Extremes to measure; without it all.
    #[arg(long, value_delimiter = ',', value_enum)]
    axes: Vec<Axis>,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "32x32", value_parser = arguments::size)]
    size: UVec2,
    /// Number of independent runs.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    seeds: u32,
    /// Frames of a run, whose mean counts; the reference tracer has four times as many.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// How rays are traced.
    #[arg(long, default_value = "auto", value_parser = arguments::choice::<RayBackend>())]
    backend: RayBackend,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "extremes";
/// A row differs if a mean is off by more than this share and by more than chance explains: by this number of standard errors, or more where
/// few runs estimate them.
const SHARE: f64 = 0.01;
const ERRORS: f64 = 3.0;
/// The section of the rows that differ.
const DIFFERENT: &str = "Rows that differ";
/// Frames until the counters of a frame have arrived from the GPU.
const LATE: u32 = 3;

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let mut theater = Theater::new(args)?;
    let axes = if args.axes.is_empty() { Axis::ALL.to_vec() } else { args.axes.clone() };
    theater.measure(&axes)?;
    let mut header = header(theater.bench.adapter(), args.size);
    header.push(format!(
        "difference of the mean and its standard error over {} runs of {} frames (reference tracer: {}), in percent; Unbiased, {} rays",
        args.seeds,
        args.frames,
        4 * args.frames,
        theater.bench.report().backend
    ));
    let mut notes = vec![format!(
        "A row differs if a mean is off by more than {} % and {:.1} standard errors, or if a pixel is black that must not be, is not finite or \
         raises a guard.  Rows have the same random numbers, so that their noise is alike.",
        100.0 * SHARE,
        args.limit()
    )];
    if !theater.columns.iter().any(|(_, rows)| rows.iter().any(|row| row.section == DIFFERENT)) {
        notes.push("No row differs.".into());
    }
    args.output.write(NAME, &Table { header, columns: theater.columns, notes })
}

impl Args {
    /// Standard errors that chance hardly exceeds.
    fn limit(&self) -> f64 {
        student(ERRORS, f64::from(self.seeds) - 1.0)
    }
}

/// Light of a technique in a scene.
struct Measured {
    /// Mean radiance of each run.
    means: Vec<f64>,
    /// Mean over the runs.
    picture: Picture,
    /// Pixels of a frame whose radiance was not finite.
    non_finite: u64,
    /// Pixels that raised guards, over all frames.
    guards: Vec<(&'static str, u64)>,
}

/// One app in which all scenes are built, one after the other.
struct Theater<'a> {
    args: &'a Args,
    bench: Bench,
    /// The things of the present scene.
    spawned: Vec<Entity>,
    /// Columns of the table, one for each technique.
    columns: Vec<(String, Vec<Row>)>,
}

impl<'a> Theater<'a> {
    fn new(args: &'a Args) -> Result<Self, String> {
        let mut app = Bench::app_in(Path::new("."), args.backend)?;
        let ordinary = stage::ordinary();
        let settings = settings(args.techniques[0], ordinary.bounces);
        let setup = CameraSetup { size: args.size, exposure: unit_exposure(), environment: None, settings };
        scene::spawn_camera(app.world_mut(), ordinary.camera, setup);
        let spawned = ordinary.things.iter().map(|thing| things::spawn(app.world_mut(), thing)).collect();
        let bench = Bench::new(app, args.size, Counts { warmup: 0, frames: 1 })?;
        let columns = args.techniques.iter().map(|technique| (format!("{technique:?}"), Vec::new())).collect();
        Ok(Self { args, bench, spawned, columns })
    }

    /// Fills the columns.
    fn measure(&mut self, axes: &[Axis]) -> Result<(), String> {
        let values = || axes.iter().flat_map(|axis| axis.values().iter().map(|value| (*axis, *value)));
        let techniques = self.args.techniques.clone();
        let of_run = |technique: &Technique| u64::from(self.frames(*technique));
        let frames = u64::from(self.args.seeds) * techniques.iter().map(of_run).sum::<u64>();
        let progress = Progress::new(frames * (1 + values().count() as u64));
        let mut ordinary = Vec::new();
        for technique in &techniques {
            let measured = self.light(*technique, stage::ordinary().bounces, &progress)?;
            lit(&measured.picture)?;
            ordinary.push(measured);
        }
        let mut all = vec![Vec::new(); techniques.len()];
        let mut different = all.clone();
        for (axis, value) in values() {
            let stage = axis.stage(value);
            self.build(&stage)?;
            let mut cells = Vec::new();
            for (technique, ordinary) in techniques.iter().zip(&ordinary) {
                let measured = self.light(*technique, stage.bounces, &progress)?;
                let right = match stage.truth {
                    Truth::Ordinary(gain) => Right::Paired(ordinary, gain),
                    Truth::Exact { paths, .. } if technique.has_indirect_light() => Right::Exact(paths),
                    Truth::Exact { direct, .. } => Right::Exact(direct),
                    Truth::Reference if *technique == Technique::Reference => Right::Itself,
                    Truth::Reference => {
                        let bounces = if technique.has_indirect_light() { stage.bounces } else { 1 };
                        Right::Other(self.light(Technique::Reference, bounces, &Progress::hidden())?)
                    }
                };
                cells.push(Cell::new(&measured, &right, self.args.size));
            }
            let differs = cells.iter().any(|cell| cell.differs(self.args.limit()));
            for ((cell, all), different) in cells.iter().zip(&mut all).zip(&mut different) {
                all.extend(cell.rows(axis.section(), &axis.label(value)));
                if differs {
                    different.extend(cell.rows(DIFFERENT, &axis.label(value)));
                }
            }
        }
        for ((column, different), all) in self.columns.iter_mut().zip(different).zip(all) {
            column.1 = [different, all].concat();
        }
        Ok(())
    }

    /// Frames of a run.
    fn frames(&self, technique: Technique) -> u32 {
        if technique == Technique::Reference { 4 * self.args.frames } else { self.args.frames }
    }

    /// Replaces the scene and moves the camera.
    fn build(&mut self, stage: &Stage) -> Result<(), String> {
        let app = self.bench.app();
        self.spawned.drain(..).for_each(|thing| things::despawn(app.world_mut(), thing));
        self.spawned = stage.things.iter().map(|thing| things::spawn(app.world_mut(), thing)).collect();
        let camera = app.world().resource::<View>().camera;
        app.world_mut().entity_mut(camera).insert(stage.camera.clone());
        // A report may be older than the things.
        (0..LATE).for_each(|_| _ = frame(app));
        alive(app)
    }

    /// Measures a technique in the present scene.
    fn light(&mut self, technique: Technique, bounces: u32, progress: &Progress) -> Result<Measured, String> {
        self.bench.app().world().resource::<RestirStatistics>().reset_guards();
        let before = self.frames(technique) - 1;
        let pictures = self.bench.pictures(&settings(technique, bounces), self.args.seeds, before, progress)?;
        (0..LATE).for_each(|_| _ = frame(self.bench.app()));
        let report = self.bench.report();
        let mean_of = |pixel: usize, channel: usize| {
            pictures.iter().map(|picture| picture[pixel][channel]).sum::<f64>() / pictures.len() as f64
        };
        let pixel = |pixel: usize| core::array::from_fn(|channel| mean_of(pixel, channel));
        let non_finite = pictures.iter().flatten().filter(|pixel| !is_finite(pixel)).count() as u64;
        Ok(Measured {
            means: pictures.iter().map(|picture| mean(picture, |c| c)).collect(),
            picture: (0..pictures[0].len()).map(pixel).collect(),
            non_finite: non_finite + report.non_finite_pixels,
            guards: report.raised_guards(),
        })
    }
}

/// The unbiased mean of frames.
fn settings(technique: Technique, bounces: u32) -> Restir {
    Restir { technique, bounces, accumulate: true, ..Restir::preset(Preset::Unbiased) }
}

/// The light that a measurement is compared with.
enum Right<'a> {
    /// That of the same technique, with the same random numbers, times a number.
    Paired(&'a Measured, f64),
    Other(Measured),
    Exact(f64),
    /// It is the reference itself: only its noise is known.
    Itself,
}

/// A technique in a scene.
struct Cell {
    /// Relative difference of the mean, and its standard error.
    difference: f64,
    error: f64,
    /// Pixels that are black although the right ones are not.
    black: f64,
    non_finite: u64,
    guards: Vec<(&'static str, u64)>,
}

impl Cell {
    fn new(measured: &Measured, right: &Right, size: UVec2) -> Self {
        let (ours, noise) = mean_and_error(&measured.means);
        let (difference, error) = match right {
            Right::Paired(ordinary, gain) => {
                let changes = measured.means.iter().zip(&ordinary.means).map(|(ours, theirs)| ours / gain - theirs);
                let ((change, error), (theirs, _)) =
                    (mean_and_error(&changes.collect::<Vec<_>>()), mean_and_error(&ordinary.means));
                (change / theirs, error / theirs)
            }
            Right::Other(reference) => {
                let (theirs, error) = mean_and_error(&reference.means);
                (ours / theirs - 1.0, noise.hypot(error) / theirs)
            }
            Right::Exact(theirs) => (ours / theirs - 1.0, noise / theirs),
            Right::Itself => (f64::NAN, noise / ours),
        };
        let even;
        let lit = match right {
            Right::Paired(Measured { picture, .. }, _) | Right::Other(Measured { picture, .. }) => picture,
            Right::Exact(theirs) => {
                even = vec![[*theirs; 3]; measured.picture.len()];
                &even
            }
            Right::Itself => &measured.picture,
        };
        let share = Difference::new(measured.picture.clone(), lit, size, blocks::SIDE).black;
        let black = (share * lit.len() as f64).round();
        Self { difference, error, black, non_finite: measured.non_finite, guards: measured.guards.clone() }
    }

    /// `limit`: standard errors that chance hardly exceeds.
    fn differs(&self, limit: f64) -> bool {
        let is_off = self.difference.abs() > SHARE && self.difference.abs() > limit * self.error;
        // Compared with a black picture, the difference is infinite or NaN.
        is_off || !self.difference.is_finite() || self.black > 0.0 || self.non_finite > 0 || !self.guards.is_empty()
    }

    /// The difference, and a row for each kind of pixels that should not exist.
    fn rows(&self, section: &'static str, label: &str) -> Vec<Row> {
        let percent =
            [("difference", Unit::Percent, 100.0 * self.difference), ("±", Unit::Percent, 100.0 * self.error)];
        let mut counts = vec![("black pixels".to_owned(), self.black), ("not finite".into(), self.non_finite as f64)];
        counts.extend(self.guards.iter().map(|(name, pixels)| (format!("guard {name}"), *pixels as f64)));
        let raised = counts.into_iter().filter(|(_, pixels)| *pixels > 0.0);
        let count = |(name, pixels)| Row::new(section, format!("{label}: {name}"), &[("", Unit::Count, pixels)]);
        core::iter::once(Row::new(section, label, &percent)).chain(raised.map(count)).collect()
    }
}
