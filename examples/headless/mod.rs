//! What programs without a window share: an app, a scene from a file, frames that are waited for, their times, files that are
//! complete or absent.

pub mod files;
#[path = "../shared/framing.rs"]
mod framing;
pub mod picture;
pub mod progress;
pub mod scene;
pub mod times;

use bevy::{
    asset::UnapprovedPathMode,
    log::LogPlugin,
    prelude::*,
    render::{
        RenderPlugin,
        diagnostic::RenderDiagnosticsPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        render_resource::PollType,
        renderer::RenderDevice,
        settings::{Backends, WgpuSettings},
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_restir::{CapturedRadiance, EmissiveLuminance, RayBackend, RestirPlugin, RestirStatistics};
use clap::Parser;
use scene::View;
use std::{
    path::Path,
    process::ExitCode,
    time::{Duration, Instant},
};

/// Nothing that is loaded or compiled may take longer.
const PATIENCE: Duration = Duration::from_secs(300);

/// The command line; or, where it asks for help or is wrong, what the program exits with.
pub fn arguments<T: Parser>() -> Result<T, ExitCode> {
    match T::try_parse() {
        Ok(arguments) => Ok(arguments),
        Err(error) if !error.use_stderr() => {
            // The help or the version was asked for.
            let _ = error.print();
            Err(ExitCode::SUCCESS)
        }
        Err(error) => {
            eprintln!("{}", one_line(&error.to_string()));
            Err(ExitCode::from(2))
        }
    }
}

/// The first paragraph of a message in one line: what is wrong, without the usage.
fn one_line(message: &str) -> String {
    message.lines().map(str::trim).take_while(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Before anything else runs: keeps drivers from complaining on stderr.
pub fn quiet_drivers() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Mesa's device-select layer looks for a compositor and complains where there is none.
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// A headless app that reads its assets from a folder and traces rays as one likes.
pub fn app(folder: &Path, backend: RayBackend) -> Result<App, String> {
    let mut app = App::new();

    app.add_plugins(
        DefaultPlugins
            .set(LogPlugin {
                // Failures are the program's to tell, in one line.
                filter: concat!("off,bevy_restir=warn,", env!("CARGO_CRATE_NAME"), "=warn").into(),
                ..Default::default()
            })
            .set(AssetPlugin {
                file_path: folder.to_string_lossy().into_owned(),
                unapproved_path_mode: UnapprovedPathMode::Allow,
                ..Default::default()
            })
            .set(RenderPlugin {
                synchronous_pipeline_compilation: true,
                render_creation: WgpuSettings { backends: Some(Backends::PRIMARY), ..Default::default() }.into(),
                ..Default::default()
            })
            .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..Default::default() })
            .disable::<WinitPlugin>()
            .disable::<PipelinedRenderingPlugin>(),
    )
    .add_plugins((RestirPlugin { backend }, RenderDiagnosticsPlugin))
    .insert_resource(EmissiveLuminance(1.0))
    .insert_resource(ClearColor(Color::BLACK))
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)));
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    if app.get_sub_app(bevy::render::RenderApp).is_none() {
        return Err("there is no GPU adapter; Mesa's software driver (mesa-vulkan-drivers) will do".into());
    }
    app.finish();
    app.cleanup();
    Ok(app)
}

/// One frame, waited for: the CPU never runs ahead of the GPU, and times are those of one frame.  Returns ms until the GPU was done,
/// and ms until the frame was submitted.
pub fn frame(app: &mut App) -> (f64, f64) {
    let start = Instant::now();
    app.update();
    let cpu = start.elapsed();
    let _ = app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
    (start.elapsed().as_secs_f64() * 1e3, cpu.as_secs_f64() * 1e3)
}

/// Frames until something is so.
pub fn until(app: &mut App, otherwise: &str, mut done: impl FnMut(&App) -> bool) -> Result<(), String> {
    let start = Instant::now();
    loop {
        frame(app);
        if done(app) {
            return Ok(());
        }
        // Bevy quits where wgpu reports an error.
        if app.should_exit().is_some() {
            return Err("the renderer failed".into());
        }
        if start.elapsed() > PATIENCE {
            return Err(format!("{otherwise} after {} s", PATIENCE.as_secs()));
        }
    }
}

/// Frames until pictures are final.
pub fn until_ready(app: &mut App) -> Result<(), String> {
    until(app, "the scene is not ready", |app| {
        // Two frames at least: the report of the first is older than the camera.
        let report = app.world().resource::<RestirStatistics>().report();
        report.ready && report.samples > 0
    })
}

/// The frame that was asked for before it was rendered.
pub fn captured(app: &App) -> Result<CapturedRadiance, String> {
    app.world().resource::<View>().capture.take().ok_or("the frame was not rendered".into())
}
