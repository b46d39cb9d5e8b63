//! Thousands of lamps that move, under ReSTIR DI, in an ordinary Bevy app; every setting of `Restir` can be changed while it runs.
//!
//! `cargo run --example many_lights -- --lights 3000`

#[path = "../shared/arguments.rs"]
mod arguments;
mod cost;
#[path = "../shared/fields.rs"]
#[expect(dead_code, reason = "the viewer has widgets for what is stepped through here")]
mod fields;
mod flight;
mod lamps;
#[path = "../shared/numbers.rs"]
mod numbers;
mod panel;
mod plaza;

use arguments::TechniqueName;
use bevy::{
    core_pipeline::tonemapping::Tonemapping,
    diagnostic::{DiagnosticsStore, FrameTimeDiagnosticsPlugin},
    input::keyboard::{Key, KeyboardInput},
    prelude::*,
    render::diagnostic::RenderDiagnosticsPlugin,
    window::PresentMode,
};
use bevy_restir::{RestirStatistics, prelude::*};
use clap::Parser;

/// Thousands of lamps that move, under ReSTIR DI.
#[derive(Parser, Resource, Clone, Debug)]
struct Args {
    /// Lamps; beyond 10000 they go in swarms that share a mesh.
    #[arg(long, default_value_t = 3000, value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    lights: u32,
    /// Point lights beside them.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(0..=100_000))]
    points: u32,
    /// Pixels of the window.
    #[arg(long, default_value = "1280x720", value_parser = arguments::window_size)]
    size: UVec2,
    /// How light is carried.
    #[arg(long, value_enum, default_value = "di")]
    technique: TechniqueName,
    /// Starts with everything at rest.
    #[arg(long)]
    paused: bool,
    /// Starts without text over the picture.
    #[arg(long)]
    bare: bool,
    /// Ends after so many frames, and says what they took.
    #[arg(long)]
    frames: Option<u32>,
}

fn main() -> AppExit {
    let args = Args::parse();
    let window = Window {
        title: "bevy_restir: many lights".into(),
        resolution: args.size.into(),
        // Frames as fast as they come: their time is shown.
        present_mode: PresentMode::AutoNoVsync,
        ..default()
    };
    App::new()
        .add_plugins((
            DefaultPlugins.set(WindowPlugin { primary_window: Some(window), ..default() }),
            RestirPlugin,
            FrameTimeDiagnosticsPlugin::default(),
            RenderDiagnosticsPlugin,
        ))
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(panel::Panel::new(!args.bare))
        .insert_resource(args)
        .add_systems(Startup, (plaza::spawn, lamps::spawn, panel::spawn, spawn_camera, start))
        .add_systems(
            Update,
            (lamps::drift, flight::fly, act_on_keys, panel::choose, panel::show, cost::show, end).chain(),
        )
        .run()
}

fn spawn_camera(mut commands: Commands, args: Res<Args>) {
    commands.spawn((
        Camera3d::default(),
        // Bright colours stay colours.
        Tonemapping::BlenderFilmic,
        flight::Flight::default(),
        Restir { technique: args.technique.into(), ..default() },
        RestirEnvironment { color: LinearRgba::rgb(16.0, 24.0, 44.0), ..default() },
    ));
}

fn start(args: Res<Args>, mut time: ResMut<Time<Virtual>>) {
    if args.paused {
        time.pause();
    }
}

/// The keys that need no list; `panel::choose` has the others.
fn act_on_keys(
    mut events: MessageReader<KeyboardInput>,
    mut time: ResMut<Time<Virtual>>,
    mut cameras: Query<&mut Restir>,
) {
    for event in events.read().filter(|event| event.state.is_pressed() && !event.repeat) {
        if event.key_code == KeyCode::Space {
            if time.is_paused() { time.unpause() } else { time.pause() }
        }
        for mut settings in &mut cameras {
            match event.key_code {
                KeyCode::KeyR => settings.reset = true,
                KeyCode::KeyT => fields::change(&mut settings, "technique", true),
                KeyCode::KeyV => {
                    let back = event.logical_key == Key::Character("V".into());
                    fields::next_view(&mut settings, !back);
                }
                KeyCode::Digit1 => fields::take(&mut settings, Preset::Performance),
                KeyCode::Digit2 => fields::take(&mut settings, Preset::Balanced),
                KeyCode::Digit3 => fields::take(&mut settings, Preset::Quality),
                KeyCode::Digit4 => fields::take(&mut settings, Preset::Unbiased),
                _ => (),
            }
        }
    }
}

/// Ends after `--frames` frames, counted from when the scene is there.
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
    let pixels = camera.physical_target_size().unwrap_or(args.size);
    println!(
        "{} frames of {:?}, {:.1} ms each\n{}",
        counted.0,
        settings.technique,
        1000.0 * counted.1 / counted.0 as f32,
        cost::summary(&store, settings, &report, pixels)
    );
    exit.write(AppExit::Success);
}
