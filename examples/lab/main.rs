//! Makes the tables and pictures of the documentation: `cargo run --example lab -- ablate SCENE.glb ...`.

mod ablate;
mod bench;
mod bias;
mod blocks;
mod broken_files;
mod budget;
mod characters;
mod compare;
mod demo;
mod difference;
mod equal_time;
mod error;
mod extremes;
mod features;
mod frames;
mod fuzz;
mod heap;
mod instances;
mod lights;
mod materials;
mod motion;
mod output;
mod panels;
mod plants;
mod plot;
mod rays;
mod resolutions;
mod scale;
mod series;
mod significance;
mod soak;
mod soundness;
mod subject;
mod sweep;
mod table;
mod things;
mod thresholds;
mod times;
mod translucent;
mod variant;

use bevy_restir_support::{arguments, headless, panics};
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Measures the techniques, makes the tables and pictures of the documentation, and searches for failures (fuzz, soak, broken-files).
#[derive(Parser, Debug)]
#[command(name = "lab", version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    Rays(rays::Args),
    Ablate(ablate::Args),
    Scale(scale::Args),
    EqualTime(equal_time::Args),
    Steps(equal_time::Steps),
    Thresholds(thresholds::Args),
    Resolutions(resolutions::Args),
    Times(times::Args),
    Subsurface(translucent::Args),
    Materials(materials::Args),
    Frames(frames::Args),
    Features(features::Args),
    Motion(motion::Args),
    Bias(bias::Args),
    Extremes(extremes::Args),
    Budget(budget::Args),
    Characters(characters::Args),
    Instances(instances::Args),
    Sweep(sweep::SweepArgs),
    Presets(sweep::Args),
    Compare(compare::Args),
    Fuzz(fuzz::Args),
    Soak(soak::Args),
    BrokenFiles(broken_files::Args),
    Plants(plants::Args),
    Demo(demo::Args),
}

fn main() -> ExitCode {
    let args: Args = match arguments::parse() {
        Ok(args) => args,
        Err(code) => return code,
    };
    headless::quiet_drivers();
    // Reads the commit now: it may change during a long run.
    output::commit();
    if let Err(error) = check(&args.command) {
        eprintln!("error: {error}");
        return ExitCode::from(2);
    }
    panics::record();
    let result = panics::caught(|| run(&args.command)).and_then(|result| result);
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", error.lines().next().unwrap_or_default());
            ExitCode::from(1)
        }
    }
}

/// Fails where arguments do not fit each other, before anything is read or measured.
fn check(command: &Command) -> Result<(), String> {
    match command {
        Command::Times(args) => args.check(),
        Command::Features(args) => args.check(),
        Command::Bias(args) => args.check(),
        Command::Sweep(args) => args.check(),
        Command::Presets(args) => args.check(),
        Command::Compare(args) => args.check(),
        Command::Fuzz(args) => args.check(),
        Command::Plants(args) => args.check(),
        _ => Ok(()),
    }
}

fn run(command: &Command) -> Result<(), String> {
    match command {
        Command::Rays(args) => rays::run(args),
        Command::Ablate(args) => ablate::run(args),
        Command::Scale(args) => scale::run(args),
        Command::EqualTime(args) => equal_time::run(args),
        Command::Steps(steps) => steps.run(),
        Command::Thresholds(args) => thresholds::run(args),
        Command::Resolutions(args) => resolutions::run(args),
        Command::Times(args) => times::run(args),
        Command::Subsurface(args) => translucent::run(args),
        Command::Materials(args) => materials::run(args),
        Command::Frames(args) => frames::run(args),
        Command::Features(args) => features::run(args),
        Command::Motion(args) => motion::run(args),
        Command::Bias(args) => bias::run(args),
        Command::Extremes(args) => extremes::run(args),
        Command::Budget(args) => budget::run(args),
        Command::Characters(args) => characters::run(args),
        Command::Instances(args) => instances::run(args),
        Command::Sweep(args) => sweep::run(args),
        Command::Presets(args) => sweep::run_presets(args),
        Command::Compare(args) => compare::run(args),
        Command::Fuzz(args) => fuzz::run(args),
        Command::Soak(args) => soak::run(args),
        Command::BrokenFiles(args) => broken_files::run(args),
        Command::Plants(args) => plants::run(args),
        Command::Demo(args) => demo::run(args),
    }
}
