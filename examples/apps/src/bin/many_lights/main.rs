//! Thousands of moving lamps under ReSTIR DI, in an ordinary Bevy app.
//!
//! `cargo run -p bevy_restir_apps --bin many_lights -- --lights 3000`

mod flight;
mod lamps;
mod plaza;

use bevy::{camera::Exposure, core_pipeline::tonemapping::Tonemapping, diagnostic::DiagnosticsStore, prelude::*};
use bevy_restir::{RestirStatistics, prelude::*};
use bevy_restir_apps::{
    look::{Look, look},
    panel::{Panel, cost, keys::PressedKeys},
    window,
};
use bevy_restir_support::arguments;
use clap::Parser;

/// Thousands of moving lamps under ReSTIR DI.
#[derive(Parser, Resource, Clone, Debug)]
struct Args {
    /// Number of lamps; above 10000 several lamps share a mesh.
    #[arg(long, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    lights: u32,
    /// Number of point lights besides the lamps.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    points: u32,
    /// Size of the window in pixels.
    #[arg(long, default_value = "1280x720", value_parser = arguments::window_size)]
    size: UVec2,
    /// The technique at the start.
    #[arg(long, default_value = "di", value_parser = arguments::choice::<Technique>())]
    technique: Technique,
    /// Starts with all lamps at rest.
    #[arg(long)]
    paused: bool,
    /// Starts without the panel.
    #[arg(long)]
    bare: bool,
    /// Ends after this many frames and prints their cost.
    #[arg(long)]
    frames: Option<u32>,
}

const KEYS: &str = "drag, WASD, Q, E: fly (Shift: faster)   C: circle   Space: pause";

fn main() -> AppExit {
    let args = Args::parse();
    let mut app = window::app("many lights", args.size, KEYS, RayBackend::Auto);
    app.world_mut().resource_mut::<Panel>().visible = !args.bare;
    app.insert_resource(args)
        .add_systems(Startup, (plaza::spawn, lamps::spawn, spawn_camera, start))
        .add_systems(Update, (lamps::drift, flight::fly, act_on_keys, end).chain())
        .run()
}

fn spawn_camera(mut commands: Commands, args: Res<Args>) {
    commands
        .spawn((
            Camera3d::default(),
            look(Some(Exposure::default().ev100)),
            flight::Flight::default(),
            Restir { technique: args.technique, ..default() },
            RestirEnvironment { color: LinearRgba::rgb(16.0, 24.0, 44.0), ..default() },
        ))
        // A curve that keeps bright colors saturated.
        .entry::<Look>()
        .and_modify(|mut look| look.tonemapping = Tonemapping::BlenderFilmic);
}

fn start(args: Res<Args>, mut time: ResMut<Time<Virtual>>) {
    if args.paused {
        time.pause();
    }
}

fn act_on_keys(mut keys: PressedKeys, mut time: ResMut<Time<Virtual>>) {
    if keys.read().iter().any(|(key, _)| *key == KeyCode::Space) {
        if time.is_paused() { time.unpause() } else { time.pause() }
    }
}

/// Ends after `--frames` frames, counted from the first frame in which the scene is ready.
fn end(
    args: Res<Args>,
    statistics: Res<RestirStatistics>,
    store: Res<DiagnosticsStore>,
    time: Res<Time<Real>>,
    cameras: Query<(&Camera, &Restir)>,
    mut counted: Local<(u32, f32)>,
    mut exit: MessageWriter<AppExit>,
) {
    let Some(frames) = args.frames else { return };
    let report = statistics.report();
    if !report.ready {
        return;
    }
    *counted = (counted.0 + 1, counted.1 + time.delta_secs());
    if counted.0 < frames.max(1) {
        return;
    }
    let Ok((camera, settings)) = cameras.single() else { return };
    let pixels = camera.physical_viewport_size().unwrap_or(args.size);
    println!(
        "{} frames of {:?}, {:.1} ms each\n{}",
        counted.0,
        settings.technique,
        1000.0 * counted.1 / counted.0 as f32,
        cost::summary(&store, settings, &report, pixels)
    );
    exit.write(AppExit::Success);
}
