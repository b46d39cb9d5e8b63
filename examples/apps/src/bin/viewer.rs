//! Shows any glTF file by path tracing: drop one on the window, look around, and change every setting of `Restir` while it runs.
//!
//! `cargo run -p bevy_restir_apps -- assets/scenes/glossy.glb`

use bevy::prelude::*;
use bevy_restir::prelude::*;
use bevy_restir_apps::{look, viewer, window};
use bevy_restir_support::{
    arguments::{self, ExposureChoice},
    environment::{self, Environment},
    fields,
};
use clap::Parser;
use std::path::PathBuf;

/// Shows any glTF file by path tracing.
#[derive(Parser, Clone, Debug)]
#[command(name = "viewer", version)]
struct Args {
    /// A .glb or .gltf file; others can be dropped on the window.
    file: Option<PathBuf>,
    /// The technique at the start.
    #[arg(long, default_value = "pt", value_parser = arguments::choice::<Technique>())]
    technique: Technique,
    /// The settings at the start.
    #[arg(long, default_value = "balanced", value_parser = arguments::choice::<Preset>())]
    preset: Preset,
    /// Sets a field of `Restir` by its reflection path; repeatable.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Environment: uniform radiance R,G,B in cd/m², or an equirectangular .hdr or .exr file.
    #[arg(long, value_parser = environment::parse)]
    env: Option<Environment>,
    /// Exposure value at ISO 100; `auto` chooses the exposure that fits each file.
    #[arg(long, default_value = "auto", value_parser = arguments::exposure, value_name = "V|auto")]
    ev100: ExposureChoice,
    /// How rays are traced.
    #[arg(long, default_value = "auto", value_parser = arguments::choice::<RayBackend>())]
    backend: RayBackend,
    /// Size of the window in pixels.
    #[arg(long, default_value = "1280x720", value_parser = arguments::window_size)]
    size: UVec2,
}

impl Args {
    fn settings(&self) -> Result<Restir, String> {
        let mut settings = Restir::preset(self.preset);
        settings.technique = self.technique;
        for assignment in &self.set {
            fields::set(&mut settings, assignment).map_err(|e| format!("--set {e}"))?;
        }
        Ok(settings)
    }
}

fn main() -> AppExit {
    let args = Args::parse();
    let settings = match args.settings() {
        Ok(settings) => settings,
        Err(error) => {
            eprintln!("error: {error}");
            return AppExit::from_code(2);
        }
    };
    // An unreadable file is reported before a window opens.
    let mut image = match args.env.as_ref().map_or(Ok(None), Environment::image) {
        Ok(image) => image,
        Err(error) => {
            eprintln!("error: {error}");
            return AppExit::from_code(1);
        }
    };
    let backend = args.backend;
    window::app("viewer", args.size, viewer::KEYS, backend)
        .add_plugins(viewer::plugin)
        .add_systems(Startup, move |world: &mut World| start(world, &args, &settings, image.take()))
        .run()
}

/// Spawns the camera and opens the file of the command line.
fn start(world: &mut World, args: &Args, settings: &Restir, image: Option<Image>) {
    let ev100 = args.ev100.fixed().map(|exposure| exposure.ev100);
    let eye = world.spawn((viewer::camera::eye(), look::look(ev100), settings.clone())).id();
    if let Some(environment) = &args.env {
        let environment = environment.component(world, image);
        world.entity_mut(eye).insert(environment);
    }
    if let Some(file) = &args.file {
        world.write_message(viewer::load::Open(file.clone()));
    }
}
