//! Makes the figures that the documentation has: `cargo run --example lab -- ablate SCENE.glb ...`.

mod ablate;
#[path = "../shared/arguments.rs"]
mod arguments;
mod bench;
mod compare;
mod equal_time;
mod error;
#[path = "../shared/exr_file.rs"]
mod exr_file;
#[path = "../headless/mod.rs"]
mod headless;
mod lights;
mod materials;
mod output;
mod rays;
mod scale;
mod series;
#[path = "../shared/set.rs"]
mod set;
mod support;
mod table;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Measures what the techniques cost and how far off they are.
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
    Materials(materials::Args),
    Compare(compare::Args),
}

fn main() -> ExitCode {
    let args: Args = match headless::arguments() {
        Ok(args) => args,
        Err(code) => return code,
    };
    headless::quiet_drivers();
    let result = match &args.command {
        Command::Rays(args) => rays::run(args),
        Command::Ablate(args) => ablate::run(args),
        Command::Scale(args) => scale::run(args),
        Command::EqualTime(args) => equal_time::run(args),
        Command::Steps(steps) => steps.run(),
        Command::Materials(args) => materials::run(args),
        Command::Compare(args) => compare::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", error.lines().next().unwrap_or_default());
            ExitCode::from(1)
        }
    }
}
