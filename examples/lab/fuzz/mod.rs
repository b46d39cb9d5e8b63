//! Random scenes, settings and edits, in search of panics, errors of the renderer, hangs and illegal numbers.

mod case;
mod stage;

use bevy::math::UVec2;
use bevy_restir_support::{arguments, files::write_text, panics, progress::Progress};
use std::{fs, path::PathBuf};

use crate::soundness::Watchdog;
use case::Case;
use stage::Stage;

/// Greatest number of attempts to make a failing case smaller.
const SHRINKING: u32 = 200;

/// Renders random scenes with random settings and edits.  A case fails by a panic, an error of the renderer, a hang, a pixel that is not
/// finite, or a raised guard.  Each failing case is made smaller and written to the folder.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Number of cases.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    count: u32,
    /// Number of the first case; the others follow it.  `--seed N --count 1` repeats case N.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "24x16", value_parser = arguments::size)]
    size: UVec2,
    /// Compiles shaders for the features of each scene, in an app of its own, instead of once for all features.
    #[arg(long)]
    specialized: bool,
    /// Also compares the mean of the picture that is left in the end with that of the reference tracer, with unbiased settings of the case's
    /// technique. A case fails if they differ by 5 standard errors.
    #[arg(long)]
    against_reference: bool,
    /// Folder of the cases that fail.
    #[arg(long, default_value = "target/lab/fuzz")]
    out: PathBuf,
}

/// Runs cases in one app until one of them breaks it.
struct Runner<'a> {
    args: &'a Args,
    stage: Option<Stage>,
    watchdog: Watchdog,
}

impl Runner<'_> {
    /// Runs a case and returns the reason why it fails, or `None` if it passes; an error if no app can be created.
    fn failure(&mut self, case: &Case) -> Result<Option<String>, String> {
        self.watchdog.beat();
        let mut stage = match self.stage.take() {
            Some(stage) => stage,
            None => Stage::new(self.args.size, !self.args.specialized)?,
        };
        let run = || {
            let mut result = stage.run(case);
            if self.args.against_reference && result.is_ok() {
                result = stage.compare(case);
            }
            (stage, result)
        };
        Ok(match panics::caught(run) {
            Ok((stage, result)) => {
                // An app whose renderer failed cannot go on.
                self.stage = (!self.args.specialized && !stage.has_failed()).then_some(stage);
                result.err()
            }
            Err(panic) => Some(panic),
        })
    }

    /// The smallest case found that still fails.
    fn smallest(&mut self, case: Case) -> Result<Case, String> {
        let mut smallest = case;
        let mut attempts = 0;
        'smaller: loop {
            for smaller in smallest.smaller() {
                attempts += 1;
                if attempts > SHRINKING {
                    return Ok(smallest);
                }
                if self.failure(&smaller)?.is_some() {
                    smallest = smaller;
                    continue 'smaller;
                }
            }
            return Ok(smallest);
        }
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    fs::create_dir_all(&args.out).map_err(|e| format!("{}: {e}", args.out.display()))?;
    panics::record();
    let mut runner = Runner { args, stage: None, watchdog: Watchdog::new() };
    let progress = Progress::new(args.count.into());
    let mut failed = 0;
    for seed in (args.seed..).take(args.count as usize) {
        runner.watchdog.watch(format!("case {seed}"));
        let case = Case::new(seed);
        if let Some(reason) = runner.failure(&case)? {
            failed += 1;
            println!("case {seed}: {reason}; it is repeated by: lab fuzz --count 1 --seed {seed}");
            let smallest = runner.smallest(case)?;
            write_text(&args.out.join(format!("case-{seed}.txt")), &format!("{reason}\n\n{smallest:#?}\n"))?;
        }
        progress.step();
    }
    if failed > 0 {
        return Err(format!("{failed} of {} cases fail; {} has their smallest forms", args.count, args.out.display()));
    }
    println!("{} cases, none fails", args.count);
    Ok(())
}
