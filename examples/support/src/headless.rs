//! An app without a window whose frames are waited for.

use bevy::{
    asset::UnapprovedPathMode,
    log::{BoxedFmtLayer, LogPlugin, tracing_subscriber},
    prelude::*,
    render::{
        RenderPlugin,
        diagnostic::RenderDiagnosticsPlugin,
        error_handler::{RenderErrorHandler, RenderErrorPolicy},
        pipelined_rendering::PipelinedRenderingPlugin,
        render_resource::PollType,
        renderer::RenderDevice,
        settings::{Backends, WgpuSettings},
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
};
use bevy_restir::{
    CapturedRadiance, EmissiveLuminance, RayBackend, RestirPlugin, RestirStatistics, testing::plant_shader_edits,
};
use std::{
    io::{IsTerminal, stderr},
    path::Path,
    time::{Duration, Instant},
};

use crate::{mutant, panics, scene::View};

/// Loading and compiling may take this long before the program gives up.  A CPU driver beside other work compiles for minutes.
const PATIENCE: Duration = Duration::from_secs(1200);

/// Keeps drivers from complaining on stderr. Call it before anything else runs.
pub fn quiet_drivers() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Mesa's device-select layer looks for a compositor and complains where it finds none.
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

/// A headless app that reads its assets from `folder` and traces rays with `backend`.
pub fn app(folder: &Path, backend: RayBackend) -> Result<App, String> {
    // Bevy panics where it finds no adapter.
    panics::caught(|| create(folder, backend)).and_then(|app| app).map_err(|error| {
        let is_missing = error.contains("Unable to find a GPU");
        if is_missing { NO_ADAPTER.into() } else { error }
    })
}

const NO_ADAPTER: &str = "there is no GPU adapter; Mesa's software driver (mesa-vulkan-drivers) will do";

/// Why the renderer stopped.
#[derive(Resource)]
struct RendererError(String);

/// Keeps the reason of an error of the renderer, and quits as Bevy does by default.
fn keep_reason() -> RenderErrorHandler {
    RenderErrorHandler(|error, main, _| {
        let description = error.description.split_whitespace().collect::<Vec<_>>().join(" ");
        let text: String = format!("{:?}: {description}", error.ty).chars().take(400).collect();
        main.insert_resource(RendererError(text));
        main.write_message(AppExit::error());
        RenderErrorPolicy::StopRendering
    })
}

/// An error if the renderer has stopped. Bevy quits where wgpu reports an error, and later frames would be empty.
pub fn alive(app: &App) -> Result<(), String> {
    match app.world().get_resource::<RendererError>() {
        Some(RendererError(reason)) => Err(format!("the renderer failed: {reason}")),
        None if app.should_exit().is_some() => Err("the renderer failed".into()),
        None => Ok(()),
    }
}

fn create(folder: &Path, backend: RayBackend) -> Result<App, String> {
    mutant::plant_fault();
    let plugins = DefaultPlugins
        .set(LogPlugin {
            // The program itself reports failures, in one line.
            filter: "off,bevy_restir=warn,bevy_restir_support=warn,render=warn,lab=warn".into(),
            fmt_layer: log_lines,
            ..default()
        })
        .set(AssetPlugin {
            file_path: folder.to_string_lossy().into_owned(),
            unapproved_path_mode: UnapprovedPathMode::Allow,
            ..default()
        })
        .set(RenderPlugin {
            synchronous_pipeline_compilation: true,
            render_creation: WgpuSettings { backends: Some(Backends::PRIMARY), ..default() }.into(),
            ..default()
        })
        .set(WindowPlugin { primary_window: None, exit_condition: ExitCondition::DontExit, ..default() })
        .disable::<PipelinedRenderingPlugin>();
    #[cfg(feature = "windowed")]
    let plugins = plugins.disable::<bevy::winit::WinitPlugin>();
    let mut app = App::new();
    app.add_plugins((plugins, RestirPlugin { backend }, RenderDiagnosticsPlugin))
        .insert_resource(EmissiveLuminance(1.0))
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(keep_reason())
        .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)));
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
        if let Some(panic) = panics::take() {
            return Err(panic);
        }
    }
    if app.get_sub_app(bevy::render::RenderApp).is_none() {
        return Err(NO_ADAPTER.into());
    }
    app.finish();
    app.cleanup();
    if !mutant::edits().is_empty() {
        plant_shader_edits(&mut app, mutant::edits());
    }
    Ok(app)
}

/// Log lines on stderr, with colors only on a terminal.
fn log_lines(_: &mut App) -> Option<BoxedFmtLayer> {
    let lines = tracing_subscriber::fmt::Layer::default().with_writer(stderr);
    // On a terminal the default has colors, unless `NO_COLOR` is set.
    Some(Box::new(if stderr().is_terminal() { lines } else { lines.with_ansi(false) }))
}

/// Renders one frame and waits for it, so that the CPU never runs ahead of the GPU and times are those of one frame. Returns the
/// milliseconds until the GPU was done and those until the frame was submitted.
pub fn frame(app: &mut App) -> (f64, f64) {
    let start = Instant::now();
    app.update();
    let cpu = start.elapsed();
    let _ = app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
    (start.elapsed().as_secs_f64() * 1e3, cpu.as_secs_f64() * 1e3)
}

/// Renders frames until `done` holds. The error begins with `otherwise`.
pub fn until(app: &mut App, otherwise: &str, mut done: impl FnMut(&App) -> bool) -> Result<(), String> {
    let start = Instant::now();
    loop {
        frame(app);
        if done(app) {
            return Ok(());
        }
        // After a panic in a task, `done` may never hold: a loader that panics loads nothing.
        if let Some(panic) = panics::take() {
            return Err(panic);
        }
        alive(app)?;
        if start.elapsed() > PATIENCE {
            return Err(format!("{otherwise} after {} s", PATIENCE.as_secs()));
        }
    }
}

/// Renders frames until the scene is loaded and all pipelines are compiled.
pub fn until_ready(app: &mut App) -> Result<(), String> {
    until(app, "the scene is not ready", |app| {
        // The report of the first frame is older than the camera, so at least two frames are rendered.
        let report = app.world().resource::<RestirStatistics>().report();
        report.ready && report.samples > 0
    })
}

/// Renders a frame and fails if the device cannot hold a picture of this size, of which the plugin then traces fewer pixels.
pub fn fits(app: &mut App, wanted: UVec2) -> Result<(), String> {
    app.world().resource::<View>().capture.request();
    frame(app);
    let most = captured(app)?.size;
    match most == wanted {
        true => Ok(()),
        false => Err(format!(
            "a picture of {} x {} pixels does not fit this device with these settings; the largest is {} x {}",
            wanted.x, wanted.y, most.x, most.y
        )),
    }
}

/// The radiance of the last frame, which must have been requested before the frame was rendered.
pub fn captured(app: &App) -> Result<CapturedRadiance, String> {
    alive(app)?;
    app.world().resource::<View>().capture.take().ok_or("the frame was not rendered".into())
}
