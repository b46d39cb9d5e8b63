//! Makes the figures that the documentation has: `cargo run --example lab -- ablate SCENE.glb ...`.

mod ablate;
mod bench;
mod compare;
mod error;
#[path = "../headless/mod.rs"]
mod headless;
mod lights;
mod materials;
mod output;
mod rays;
mod scale;
mod series;
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
    Ablate(ablate::Args),
    Compare(compare::Args),
    Materials(materials::Args),
    Rays(rays::Args),
    Scale(scale::Args),
    Steps(compare::Steps),
}

fn main() -> ExitCode {
    let args: Args = match headless::arguments() {
        Ok(args) => args,
        Err(code) => return code,
    };
    headless::quiet_drivers();
    let result = match &args.command {
        Command::Ablate(args) => ablate::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Materials(args) => materials::run(args),
        Command::Rays(args) => rays::run(args),
        Command::Scale(args) => scale::run(args),
        Command::Steps(steps) => steps.run(),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", error.lines().next().unwrap_or_default());
            ExitCode::from(1)
        }
    }
}
