//! Shows any glTF file by path tracing: drop one on the window, look round it, and change every setting of `Restir` while it runs.
//!
//! `cargo run --example viewer -- assets/scenes/glossy.glb`
//!
//! What is `pub` is tested by `tests/viewer.rs`.

pub mod animation;
#[path = "../shared/arguments.rs"]
mod arguments;
pub mod camera;
pub mod docs;
#[path = "../shared/environment.rs"]
#[allow(dead_code, reason = "`render` takes all of it")]
mod environment;
#[path = "../shared/fields.rs"]
#[allow(dead_code, reason = "panels without widgets step through the fields")]
pub mod fields;
pub mod form;
#[path = "../shared/framing.rs"]
mod framing;
pub mod light;
pub mod load;
pub mod look;
#[path = "../shared/numbers.rs"]
mod numbers;
mod panel;
#[path = "../shared/set.rs"]
mod set;
mod stats;

use arguments::{Backend, PresetName, TechniqueName};
use bevy::{
    asset::UnapprovedPathMode,
    camera::{CameraOutputMode, visibility::RenderLayers},
    diagnostic::FrameTimeDiagnosticsPlugin,
    prelude::*,
    render::{diagnostic::RenderDiagnosticsPlugin, render_resource::BlendState, renderer::RenderAdapterInfo},
};
use bevy_egui::{EguiGlobalSettings, EguiPlugin, EguiPrimaryContextPass, PrimaryEguiContext};
use bevy_restir::prelude::*;
use clap::Parser;
use environment::Environment;
use std::path::PathBuf;
use wgpu::DeviceType;

/// Shows any glTF file by path tracing.
#[derive(Parser, Clone, Debug)]
#[command(name = "viewer", version)]
struct Args {
    /// A .glb or .gltf file; others can be dropped on the window.
    file: Option<PathBuf>,
    /// How light is carried; without it pt, or the reference where a CPU draws.
    #[arg(long, value_enum)]
    technique: Option<TechniqueName>,
    /// Settings to start from.
    #[arg(long, value_enum, default_value = "balanced")]
    preset: PresetName,
    /// Sets a field of `Restir` by its reflection path; repeatable.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Uniform radiance R,G,B in cd/m², or an equirectangular .hdr or .exr file.
    #[arg(long, value_parser = environment::parse)]
    env: Option<Environment>,
    /// Exposure value at ISO 100; without it each file is exposed by what it shows.
    #[arg(long, allow_negative_numbers = true, value_parser = arguments::ev100)]
    ev100: Option<f32>,
    /// How rays are traced.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
    /// Pixels of the window.
    #[arg(long, default_value = "1280x720", value_parser = arguments::window_size)]
    size: UVec2,
}

impl Args {
    fn settings(&self) -> Result<Restir, String> {
        let mut settings = Restir::preset(self.preset.into());
        settings.technique = self.technique.map_or(Technique::Pt, Technique::from);
        for assignment in &self.set {
            set::set(&mut settings, assignment).map_err(|e| format!("--set {e}"))?;
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
    let window = Window { title: "bevy_restir: viewer".into(), resolution: args.size.into(), ..default() };
    App::new()
        .add_plugins((
            DefaultPlugins
                .set(WindowPlugin { primary_window: Some(window), ..default() })
                // Files are anywhere.
                .set(AssetPlugin { unapproved_path_mode: UnapprovedPathMode::Allow, ..default() }),
            RestirPlugin,
            FrameTimeDiagnosticsPlugin::default(),
            RenderDiagnosticsPlugin,
            EguiPlugin::default(),
        ))
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(RayBackend::from(args.backend))
        .add_plugins((load::plugin, light::plugin, camera::plugin, animation::plugin, look::plugin))
        .init_resource::<panel::Panel>()
        .add_systems(EguiPrimaryContextPass, panel::show)
        .add_systems(Update, (panel::act_on_keys, panel::leave_room))
        .add_systems(Startup, move |world: &mut World| start(world, &args, &settings))
        .run()
}

/// The camera, one more for the panel, and the file of the command line.
fn start(world: &mut World, args: &Args, settings: &Restir) {
    world.resource_mut::<EguiGlobalSettings>().auto_create_primary_context = false;
    let mut settings = settings.clone();
    let is_cpu = world.get_resource::<RenderAdapterInfo>().is_some_and(|a| a.device_type == DeviceType::Cpu);
    if is_cpu && args.technique.is_none() {
        settings.technique = Technique::Reference;
    }
    let eye = world.spawn((camera::eye(), look::look(args.ev100), settings)).id();
    if let Some(wanted) = &args.env {
        match environment::load(world, wanted) {
            Ok(environment) => _ = world.entity_mut(eye).insert(environment),
            Err(error) => world.resource_mut::<load::Stage>().say(error),
        }
    }
    world.spawn((
        PrimaryEguiContext,
        Camera2d,
        RenderLayers::none(),
        Camera {
            order: 1,
            output_mode: CameraOutputMode::Write {
                blend_state: Some(BlendState::ALPHA_BLENDING),
                clear_color: ClearColorConfig::None,
            },
            clear_color: ClearColorConfig::Custom(Color::NONE),
            ..default()
        },
    ));
    if let Some(file) = &args.file {
        world.write_message(load::Open(file.clone()));
    }
}
