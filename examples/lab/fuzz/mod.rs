//! Random scenes, settings and edits, in search of panics, errors of the renderer, hangs and illegal numbers.

mod apps;
mod case;
mod memory;
mod stage;

use bevy::math::UVec2;
use bevy_restir::{RayBackend, Technique};
use bevy_restir_support::{
    arguments,
    files::{create_folder, write_text},
    panics,
    progress::Progress,
};
use std::{ops::RangeInclusive, path::PathBuf};

use crate::soundness::{FAULT, Watchdog, kind};
use apps::Apps;
use case::{Case, Edit};

/// Greatest number of attempts to make a failing case smaller.
const SHRINKING: u32 = 200;

/// Renders random scenes with random settings and edits.  A case fails by a panic, an error of the renderer, a hang, a pixel that is not
/// finite, a raised guard, memory that the plugin has and does not state (where the device tells its allocations), or an entry of a table
/// that is left when the case has ended.  Each failing case is made smaller, as long as it fails in the same way, and written to the folder
/// with the command that repeats it.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Number of cases.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Number of the first case; the others follow it.  `--seed N --count 1` repeats case N.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Size of the largest pictures in pixels.
    #[arg(long, default_value = "24x16", value_parser = arguments::size)]
    size: UVec2,
    /// Compiles shaders for the features of each scene, in an app of its own, instead of once for all features.
    #[arg(long)]
    specialized: bool,
    /// Also renders the scene at the end of each case by its technique and by the reference tracer: with the preset `Unbiased`, and with the
    /// case's own settings, of which those that bias are unbiased. A case fails if two means differ by more than chance explains.
    #[arg(long)]
    against_reference: bool,
    /// Renders each case by software rays and by ray queries. A case fails if the pictures differ by more than rounding and chance explain;
    /// those with numbers at the edges of what an app may write are not compared. The device must have ray queries.
    #[arg(long, conflicts_with = "backend")]
    both_backends: bool,
    /// The technique of all cases.  Default: each case draws its own, and each technique has many shaders to compile.
    #[arg(long, value_parser = arguments::choice::<Technique>())]
    technique: Option<Technique>,
    /// How rays are traced.
    #[arg(long, default_value = "auto", value_parser = arguments::choice::<RayBackend>())]
    backend: RayBackend,
    /// Makes the case smaller before it runs: the steps that an earlier run has found, such as 3.1.0. It needs `--count 1`.
    #[arg(long, value_parser = steps, default_value = "", hide_default_value = true)]
    shrink: Steps,
    /// Stops at the first case that fails, and makes it no smaller.
    #[arg(long)]
    first: bool,
    /// Folder of the cases that fail.
    #[arg(long, default_value = "target/lab/fuzz")]
    out: PathBuf,
}

/// Numbers of the smaller cases of [`Case::smaller`], one after the other.
#[derive(Clone, Debug, Default)]
struct Steps(Vec<usize>);

fn steps(text: &str) -> Result<Steps, String> {
    let numbers = text.split('.').filter(|_| !text.is_empty()).map(|number| number.parse().ok());
    numbers
        .collect::<Option<Vec<usize>>>()
        .map(Steps)
        .ok_or("expected numbers with dots between them, such as 3.1.0".into())
}

impl core::fmt::Display for Steps {
    fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
        f.write_str(&self.0.iter().map(usize::to_string).collect::<Vec<_>>().join("."))
    }
}

impl Args {
    /// Fails if `--shrink` names no smaller form of a single case.
    pub fn check(&self) -> Result<(), String> {
        if self.shrink.0.is_empty() {
            return Ok(());
        }
        if self.count != 1 {
            return Err("--shrink needs --count 1".into());
        }
        let is_known = self.case(self.seed).is_some();
        is_known.then_some(()).ok_or(format!("--shrink: case {} has no smaller form {}", self.seed, self.shrink))
    }

    /// A case, made smaller as `--shrink` asks.
    fn case(&self, seed: u64) -> Option<Case> {
        self.shrink.0.iter().try_fold(self.whole_case(seed), |case, &step| case.smaller().into_iter().nth(step))
    }

    /// The case of a seed, before it is made smaller.
    fn whole_case(&self, seed: u64) -> Case {
        let mut case = Case::new(seed, self.size);
        let Some(technique) = self.technique else { return case };
        case.settings.technique = technique;
        for (_, edit) in &mut case.edits {
            if let Edit::Settings(settings) = edit {
                settings.technique = technique;
            }
        }
        case
    }

    /// The command that repeats cases.
    fn command(&self, seed: u64, count: u64, shrink: &Steps) -> String {
        let mut text = format!("lab fuzz --count {count} --seed {seed} --size {}x{}", self.size.x, self.size.y);
        for (name, is_given) in [
            ("specialized", self.specialized),
            ("against-reference", self.against_reference),
            ("both-backends", self.both_backends),
        ] {
            if is_given {
                text += &format!(" --{name}");
            }
        }
        if self.backend != RayBackend::default() {
            text += &format!(" --backend {:?}", self.backend).to_lowercase();
        }
        if let Some(technique) = self.technique {
            text += &format!(" --technique {technique:?}").to_lowercase();
        }
        if !shrink.0.is_empty() {
            text += &format!(" --shrink {shrink}");
        }
        text
    }
}

/// Runs cases in the same apps until one of them breaks an app.
struct Runner<'a> {
    args: &'a Args,
    apps: Option<Apps>,
    watchdog: Watchdog,
}

impl Runner<'_> {
    /// Runs a case and returns the reason why it fails, or `None` if it passes; an error if no app can be created.
    fn failure(&mut self, case: &Case) -> Result<Option<String>, String> {
        let Args { specialized, against_reference, .. } = *self.args;
        let mut apps = match self.apps.take() {
            Some(apps) => apps,
            None => Apps::new(self.args)?,
        };
        let run = || {
            let result = apps.run(case, against_reference);
            (apps, result)
        };
        Ok(match panics::caught(run) {
            Ok((apps, result)) => {
                // An app whose renderer failed cannot go on.
                self.apps = (!specialized && !apps.have_failed()).then_some(apps);
                result.err()
            }
            Err(panic) => Some(panic),
        })
    }

    /// Prints how a failure is repeated, and writes the smallest case that still fails.  `seeds`: those of the first case of the app and of
    /// the case that fails.
    fn explain(&mut self, case: Case, seeds: RangeInclusive<u64>, mut reason: String) -> Result<(), String> {
        let (&first, &seed) = (seeds.start(), seeds.end());
        let args = self.args;
        if first != seed {
            // State that earlier cases have left in the app may be the cause.
            self.apps = None;
            let Some(alone) = self.failure(&case)? else {
                let command = args.command(first, seed - first + 1, &Steps::default());
                println!("{FAULT}case {seed}: {reason}; it fails only after others and is repeated by: {command}");
                return Ok(());
            };
            reason = alone;
        }
        println!("{FAULT}case {seed}: {reason}; it is repeated by: {}", args.command(seed, 1, &args.shrink));
        let Smallest { case, reason, steps } = self.smallest(case, reason, &args.shrink)?;
        let command = args.command(seed, 1, &steps);
        let text = format!("{reason}\nIt is repeated by: {command}\n\n{case:#?}\n");
        write_text(&args.out.join(format!("case-{seed}.txt")), &text)
    }

    /// The smallest case found that still fails in the same way.
    fn smallest(&mut self, case: Case, reason: String, taken: &Steps) -> Result<Smallest, String> {
        let mut smallest = Smallest { case, reason, steps: taken.clone() };
        let mut attempts = 0;
        'smaller: loop {
            for (step, smaller) in smallest.case.smaller().into_iter().enumerate() {
                attempts += 1;
                if attempts > SHRINKING {
                    return Ok(smallest);
                }
                if let Some(reason) = self.failure(&smaller)?.filter(|reason| kind(reason) == kind(&smallest.reason)) {
                    smallest.steps.0.push(step);
                    smallest = Smallest { case: smaller, reason, steps: smallest.steps };
                    continue 'smaller;
                }
            }
            return Ok(smallest);
        }
    }
}

/// A case that fails, why, and how it was made.
struct Smallest {
    case: Case,
    reason: String,
    steps: Steps,
}

pub fn run(args: &Args) -> Result<(), String> {
    create_folder(&args.out)?;
    let mut runner = Runner { args, apps: None, watchdog: Watchdog::new() };
    let progress = Progress::new(args.count.into());
    let mut failed = 0;
    // The first case of the present app.
    let mut first = args.seed;
    for seed in (args.seed..).take(args.count as usize) {
        runner.watchdog.watch(format!("case {seed}"));
        if runner.apps.is_none() {
            first = seed;
        }
        let case = args.case(seed).ok_or(format!("case {seed} has no smaller form {}", args.shrink))?;
        let failure = runner.failure(&case)?;
        progress.step();
        let Some(reason) = failure else {
            println!("case {seed} ({:?}, {}x{}): passes", case.settings.technique, case.size.x, case.size.y);
            continue;
        };
        if args.first {
            println!("{FAULT}case {seed}: {reason}");
            return Err(format!("case {seed} fails"));
        }
        failed += 1;
        runner.explain(case, first..=seed, reason)?;
    }
    if failed > 0 {
        return Err(format!("{failed} of {} cases fail; {} has their smallest forms", args.count, args.out.display()));
    }
    println!("{} cases, none fails", args.count);
    Ok(())
}
