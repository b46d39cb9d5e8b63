//! Shows any glTF file by path tracing: drop one on the window, look round it, and change every setting of `Restir` while it runs.
//!
//! `cargo run --example viewer -- assets/scenes/glossy.glb`
//!
//! What is `pub` is tested by `tests/viewer.rs`.

pub mod animation;
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
#[path = "../headless/set.rs"]
mod set;
mod stats;

use bevy::{
    asset::UnapprovedPathMode,
    camera::{CameraOutputMode, visibility::RenderLayers},
    diagnostic::FrameTimeDiagnosticsPlugin,
    prelude::*,
    render::{diagnostic::RenderDiagnosticsPlugin, render_resource::BlendState, renderer::RenderAdapterInfo},
};
use bevy_egui::{EguiGlobalSettings, EguiPlugin, EguiPrimaryContextPass, PrimaryEguiContext};
use bevy_restir::prelude::*;
use clap::{Parser, ValueEnum};
use environment::Environment;
use std::path::PathBuf;
use wgpu::DeviceType;

/// Shows any glTF file by path tracing.
#[derive(Parser, Clone, Debug)]
#[command(name = "viewer", version)]
struct Args {
    /// A .glb or .gltf file; others can be dropped on the window.
    file: Option<PathBuf>,
    /// How light is carried: reference, di, gi or pt; without it pt, or the reference where a CPU draws.
    #[arg(long)]
    technique: Option<String>,
    /// Settings to start from: performance, balanced, quality or unbiased.
    #[arg(long, default_value = "balanced")]
    preset: String,
    /// Sets a field of `Restir` by its reflection path; repeatable.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Uniform radiance R,G,B in cd/m², or an equirectangular .hdr or .exr file.
    #[arg(long, value_parser = environment::parse)]
    env: Option<Environment>,
    /// Exposure value at ISO 100; without it each file is exposed by what it shows.
    #[arg(long, allow_negative_numbers = true)]
    ev100: Option<f32>,
    /// How rays are traced.
    #[arg(long, value_enum, default_value = "auto")]
    backend: Backend,
    /// Pixels of the window.
    #[arg(long, default_value = "1280x720", value_parser = size)]
    size: UVec2,
}

#[derive(ValueEnum, Clone, Copy, Debug)]
enum Backend {
    Auto,
    Software,
    Hardware,
}

fn size(text: &str) -> Result<UVec2, String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
    parsed.filter(|size| size.min_element() >= 64 && size.max_element() <= 8192).ok_or("expected WIDTHxHEIGHT".into())
}

impl Args {
    fn settings(&self) -> Result<Restir, String> {
        let presets = fields::values::<Preset>();
        let is_asked = |preset: &&Preset| format!("{preset:?}").eq_ignore_ascii_case(&self.preset);
        let preset =
            presets.iter().find(is_asked).ok_or(format!("--preset {}: expected one of {presets:?}", self.preset))?;
        let mut settings = Restir::preset(*preset);
        settings.technique = Technique::Pt;
        if let Some(technique) = &self.technique {
            set::set(&mut settings, &format!("technique={technique}")).map_err(|e| format!("--{e}"))?;
        }
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
        .insert_resource(match args.backend {
            Backend::Auto => RayBackend::Auto,
            Backend::Software => RayBackend::Software,
            Backend::Hardware => RayBackend::Hardware,
        })
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
