//! A long run of a scene that changes all the time, in search of leaks, of light that drifts, and of numbers that should not exist.

mod ledger;
mod show;

use bevy::math::UVec2;
use bevy_restir::{RestirReport, RestirStatistics, Technique};
use bevy_restir_support::{
    arguments, fields,
    headless::{alive, captured, frame, until_ready},
    panics,
    progress::Progress,
    scene::View,
};

use crate::{
    bench::adapter_of,
    output::{Output, header},
    soundness::{self, FAULT, Watchdog, kind},
    table::{Row, Table, Unit},
};
use ledger::{Halves, Round};
use show::{ROUND, Show};

/// The table's name.
const NAME: &str = "soak";
/// Rounds below which there is nothing to compare.
const FEWEST: u32 = 12;
const MIB: f64 = (1 << 20) as f64;
/// The reason of the restarts of a history that the show's resizes cause.
const RESIZED: &str = "size";

/// Renders a scene in which objects and lights move, come and go, materials, meshes, images and settings are edited, bodies bend, a camera
/// comes and goes, and all cameras are resized, in rounds of 24 frames. After a warm-up of an eighth of the rounds it compares their second
/// half with the first: the plugin's memory may grow by 2 %, and the heap by 2 % and 1 MiB; the numbers of things that are alive must not
/// grow, and the light of each frame of a round may drift by about 5 standard errors. Guards, overflows and pixels that are not finite must
/// not occur.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Frames of each technique, rounded up to whole rounds of 24.
    #[arg(long, default_value_t = 2400, value_parser = clap::value_parser!(u32).range(i64::from(FEWEST * ROUND)..=1_000_000_000))]
    frames: u32,
    /// A technique, or all of them.
    #[arg(long, default_value = "pt", value_parser = techniques)]
    technique: Techniques,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "24x16", value_parser = arguments::size)]
    size: UVec2,
    /// Seed of the random edits.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Stops a technique at the first frame with a fault.
    #[arg(long)]
    first: bool,
    #[command(flatten)]
    output: Output,
}

#[derive(Clone, Debug)]
struct Techniques(Vec<Technique>);

fn techniques(text: &str) -> Result<Techniques, String> {
    let all = fields::values::<Technique>();
    let names: Vec<String> = all.iter().map(|technique| format!("{technique:?}").to_lowercase()).collect();
    if text == "all" {
        return Ok(Techniques(all));
    }
    let named = names.iter().zip(all).find(|(name, _)| *name == text);
    named.map(|(_, technique)| Techniques(vec![technique])).ok_or(format!("expected {}, or all", names.join(", ")))
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let watchdog = Watchdog::new();
    let rounds = args.frames.div_ceil(ROUND);
    let progress = Progress::new(args.technique.0.len() as u64 * u64::from(rounds * ROUND));
    let mut table = Table::default();
    let mut failed = 0;
    for &technique in &args.technique.0 {
        let name = format!("{technique:?}").to_lowercase();
        watchdog.watch(&name);
        let mut soak = Soak { rounds: Vec::new(), faults: Vec::new(), adapter: String::new(), resets: [0; 2] };
        let result = panics::caught(|| soak.run(technique, args, [&soundness::beat, &|| progress.step()]));
        if let Err(error) = result.and_then(|result| result) {
            soak.faults.push(error);
        } else {
            soak.compare(technique);
        }
        for fault in &soak.faults {
            println!("{FAULT}{name}: {fault}");
        }
        failed += soak.faults.len();
        table.notes.extend(soak.faults.iter().map(|fault| format!("{name}: {fault}")));
        table.header = header(core::mem::take(&mut soak.adapter), args.size);
        table.columns.push((name, soak.rows()));
    }
    table.header.push(format!("{} rounds of {ROUND} frames, seed {}", rounds, args.seed));
    args.output.write(NAME, &table)?;
    println!("{}", table.markdown());
    if failed > 0 { Err(format!("{failed} checks of the soak fail")) } else { Ok(()) }
}

/// The run of one technique.
struct Soak {
    rounds: Vec<Round>,
    /// One line for each check that fails.
    faults: Vec<String>,
    adapter: String,
    /// Restarts of the history of the camera that stays, apart from those of its resizes, after the warm-up and at the end.
    resets: [u64; 2],
}

impl Soak {
    fn run(&mut self, technique: Technique, args: &Args, after_frame: [&dyn Fn(); 2]) -> Result<(), String> {
        let mut show = Show::new(technique, args.size, args.seed)?;
        self.adapter = adapter_of(&show.app);
        until_ready(&mut show.app)?;
        let rounds = args.frames.div_ceil(ROUND);
        for number in 0..rounds {
            let mut round = Round::default();
            for phase in 0..ROUND {
                let at = number * ROUND + phase;
                show.change(at);
                let report = self.frame(&mut show, at, &mut round)?;
                after_frame.iter().for_each(|after| after());
                if args.first
                    && let Some(fault) = self.faults.pop()
                {
                    return Err(fault);
                }
                if phase + 1 == ROUND {
                    round.end(&show.app, &report, self.rounds.last());
                    let others = report.history_resets.iter().filter(|(reason, _)| *reason != RESIZED);
                    let resets = others.map(|(_, count)| count).sum();
                    if number as usize <= ledger::warm_up(rounds as usize) {
                        self.resets[0] = resets;
                    }
                    self.resets[1] = resets;
                }
            }
            self.rounds.push(round);
        }
        Ok(())
    }

    /// Renders a frame and looks at its pixels and counters.
    fn frame(&mut self, show: &mut Show, at: u32, round: &mut Round) -> Result<RestirReport, String> {
        show.app.world().resource::<View>().capture.request();
        round.milliseconds += frame(&mut show.app).0 / f64::from(ROUND);
        alive(&show.app).map_err(|error| format!("frame {at}: {error}"))?;
        if let Some(panic) = panics::take() {
            return Err(format!("frame {at}: {panic}"));
        }
        let report = show.app.world().resource::<RestirStatistics>().report();
        let picture = captured(&show.app).map_err(|error| format!("frame {at}: {error}"))?;
        let mut sum = 0.0;
        for pixel in picture.mean().flatten() {
            if !pixel.is_finite() || pixel < 0.0 {
                self.fault(at, &format!("a pixel is {pixel}"));
            } else {
                sum += f64::from(pixel);
            }
        }
        round.light.push(sum / f64::from(3 * picture.size.x * picture.size.y));
        round.device_bytes = round.device_bytes.max(report.memory_bytes() as f64);
        if let Some(fault) = soundness::fault(&report) {
            self.fault(at, &fault);
        }
        // Guards are not reset here: they are sums over the run and arrive late, so that a reset would drop some before a report has them.
        Ok(report)
    }

    /// Adds a fault of a frame, unless a frame before had it too.
    fn fault(&mut self, at: u32, fault: &str) {
        let is_known = |line: &String| line.split_once(": ").is_some_and(|(_, before)| kind(before) == kind(fault));
        if !self.faults.iter().any(is_known) {
            self.faults.push(format!("frame {at}: {fault}"));
        }
    }

    fn compare(&mut self, technique: Technique) {
        let halves = Halves::of(&self.rounds);
        let mut faults = halves.growth();
        let (errors, limit) = halves.light();
        for (frame, error) in errors.iter().enumerate().filter(|(_, error)| error.is_nan() || error.abs() > limit) {
            let which = if frame as u32 == ROUND { "a round".into() } else { format!("frame {frame} of a round") };
            faults.push(format!("the light of {which} drifts by {error:+.1} standard errors of at most {limit:.1}"));
        }
        if technique != Technique::Reference && self.resets[1] > self.resets[0] {
            let times = self.resets[1] - self.resets[0];
            faults.push(format!("the history of the camera that stays restarts {times} times"));
        }
        self.faults.extend(faults);
    }

    fn rows(&self) -> Vec<Row> {
        let halves = Halves::of(&self.rounds);
        let row = |section: &'static str, label: &str, unit, [before, after]: [f64; 2]| {
            Row::new(section, label, &[("first half", unit, before), ("second half", unit, after)])
        };
        let mean = |of: &dyn Fn(&Round) -> f64| {
            [halves.0, halves.1].map(|half| half.iter().map(of).sum::<f64>() / half.len() as f64)
        };
        let median =
            |of: &dyn Fn(&Round) -> Option<f64>| halves.medians(of).unwrap_or([f64::NAN; 2]).map(|bytes| bytes / MIB);
        let (errors, limit) = halves.light();
        let greatest = errors.iter().fold(0.0, |most: f64, error| most.max(error.abs()));
        let light = |round: &Round| round.light.iter().sum::<f64>() / f64::from(ROUND);
        let alive = |names: &str| {
            halves.most(|round| {
                let named = round.alive.iter().filter(|(name, _)| name.starts_with(names));
                named.map(|(_, number)| f64::from(*number)).sum()
            })
        };
        vec![
            row("Memory", "buffers and textures of the plugin", Unit::MiB, halves.most(|r| r.device_bytes / MIB)),
            row("Memory", "heap", Unit::MiB, median(&|round| Some(round.heap_bytes))),
            row("Memory", "process", Unit::MiB, median(&|round| round.resident_bytes)),
            row("Alive", "entities", Unit::Count, alive("entities")),
            row("Alive", "entries of the plugin's tables", Unit::Count, alive("table: ")),
            row("Alive", "buffers", Unit::Count, alive("buffers")),
            row("Alive", "bind groups", Unit::Count, alive("bind groups")),
            row("Light", "mean radiance", Unit::Radiance, mean(&light)),
            Row::new(
                "Light",
                "greatest drift, standard errors",
                &[("found", Unit::Plain, greatest), ("limit", Unit::Plain, limit)],
            ),
            row("Frame", "time", Unit::Ms, mean(&|round| round.milliseconds)),
            Row::new("Checks", "failed", &[("", Unit::Count, self.faults.len() as f64)]),
        ]
    }
}
