//! Renders a glTF scene without a window: `cargo run --example render -- SCENE.glb --out picture.png`.

mod args;
mod output;
mod scene;
mod stats;

use args::{Args, Output};
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
        view::screenshot::{Screenshot, ScreenshotCaptured},
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_restir::{CapturedRadiance, EmissiveLuminance, Restir, RestirPlugin, RestirStatistics, Technique};
use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use scene::{Loading, SceneFile, View};
use stats::Times;
use std::{
    io::IsTerminal,
    path::Path,
    process::ExitCode,
    time::{Duration, Instant},
};

/// Nothing that is loaded or compiled may take longer.
const PATIENCE: Duration = Duration::from_secs(300);

fn main() -> ExitCode {
    let args = match Args::try_parse() {
        Ok(args) => args,
        Err(error) if !error.use_stderr() => {
            // The help or the version was asked for.
            let _ = error.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            eprintln!("{}", one_line(&error.to_string()));
            return ExitCode::from(2);
        }
    };
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Mesa's device-select layer looks for a compositor and complains on stderr where there is none.
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
    let settings = match args.settings() {
        Ok(settings) => settings,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(2);
        }
    };
    match render(&args, settings) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}: {}", args.scene.display(), error.lines().next().unwrap_or_default());
            ExitCode::from(1)
        }
    }
}

/// The first paragraph of a message in one line: what is wrong, without the usage.
fn one_line(message: &str) -> String {
    message.lines().map(str::trim).take_while(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Everything from the file to the picture.
fn render(args: &Args, settings: Restir) -> Result<(), String> {
    let path = args.scene.canonicalize().map_err(|e| e.to_string())?;
    let directory = args.out.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !directory.is_dir() {
        return Err(format!("the folder of {} does not exist", args.out.display()));
    }
    let mut app = app(&path, args)?;
    load(&mut app)?;
    let view = scene::spawn_camera(app.world_mut(), args, settings.clone())?;
    app.insert_resource(view);
    until(&mut app, "the scene is not ready", |app| {
        // Two frames at least: the report of the first is older than the camera.
        let report = app.world().resource::<RestirStatistics>().report();
        report.ready && report.samples > 0
    })?;

    let mut times = Times::default();
    let frames = accumulate(&mut app, args, &settings, &mut times)?;
    if args.out.extension().is_some_and(|e| e == "exr") {
        let exposure = app.world().resource::<View>().exposure;
        let pixels: Vec<[f32; 3]> = frames.pixels.iter().map(|p| p.map(|c| (c * f64::from(exposure)) as f32)).collect();
        output::write_exr(&args.out, args.size, &pixels)?;
    } else {
        let image = screenshot(&mut app)?;
        output::write_png(&args.out, image)?;
    }
    if let Some(path) = &args.stats {
        let non_finite = frames.pixels.iter().filter(|p| !p.iter().all(|c| c.is_finite())).count() as u64;
        let json = stats::json(app.world(), args, &settings, &times, non_finite);
        let text = serde_json::to_string_pretty(&json).map_err(|e| e.to_string())? + "\n";
        if let Err(error) = output::write_text(path, &text) {
            let _ = std::fs::remove_file(&args.out);
            return Err(error);
        }
    }
    Ok(())
}

/// A headless app that reads from the scene's folder.
fn app(path: &Path, args: &Args) -> Result<App, String> {
    let (Some(folder), Some(name)) = (path.parent(), path.file_name().and_then(|n| n.to_str())) else {
        return Err("it is no file".into());
    };
    let mut app = App::new();
    app.add_plugins(
        DefaultPlugins
            .set(LogPlugin {
                // Failures are this program's to tell, in one line.
                filter: "off,bevy_restir=warn,render=warn".into(),
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
    .add_plugins((RestirPlugin, RenderDiagnosticsPlugin))
    .insert_resource(EmissiveLuminance(1.0))
    .insert_resource(ClearColor(Color::BLACK))
    .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::from_secs_f64(1.0 / 60.0)))
    .init_resource::<Loading>()
    .add_systems(Update, scene::spawn_when_loaded);
    if args.animate {
        app.add_systems(Update, scene::play_animation);
    }
    while app.plugins_state() == bevy::app::PluginsState::Adding {
        bevy::tasks::tick_global_task_pools_on_main_thread();
    }
    if app.get_sub_app(bevy::render::RenderApp).is_none() {
        return Err("there is no GPU adapter; Mesa's software driver (mesa-vulkan-drivers) will do".into());
    }
    app.finish();
    app.cleanup();
    let handle = app.world().resource::<AssetServer>().load(name.replace('#', "%23"));
    app.insert_resource(SceneFile(handle));
    Ok(app)
}

/// One frame, waited for: the CPU never runs ahead of the GPU, and times are those of one frame.
fn frame(app: &mut App) -> (f64, f64) {
    let start = Instant::now();
    app.update();
    let cpu = start.elapsed();
    let _ = app.world().resource::<RenderDevice>().poll(PollType::wait_indefinitely());
    (start.elapsed().as_secs_f64() * 1e3, cpu.as_secs_f64() * 1e3)
}

fn until(app: &mut App, otherwise: &str, done: impl Fn(&App) -> bool) -> Result<(), String> {
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

fn load(app: &mut App) -> Result<(), String> {
    until(app, "it is not loaded", |app| {
        matches!(app.world().resource::<Loading>(), Loading::Done | Loading::Failed(_))
    })?;
    match app.world().resource::<Loading>() {
        Loading::Failed(error) => Err(error.clone()),
        _ => {
            // Transforms are propagated in the frame after the scene was spawned.
            frame(app);
            Ok(())
        }
    }
}

/// The mean of the counted frames.
struct Frames {
    pixels: Vec<[f64; 3]>,
}

fn accumulate(app: &mut App, args: &Args, settings: &Restir, times: &mut Times) -> Result<Frames, String> {
    let camera = app.world().resource::<View>().camera;
    let reset = |app: &mut App| {
        if let Some(mut restir) = app.world_mut().get_mut::<Restir>(camera) {
            restir.reset = true;
        }
    };
    // Still frames are gathered on the GPU; moving ones are summed here, frame by frame.
    let mean = settings.technique == Technique::Reference || args.output == Output::Mean;
    let gathers = mean && !args.animate;
    let warmup = if settings.technique == Technique::Reference { 0 } else { args.warmup };
    let progress = Progress::new(warmup + args.frames);
    reset(app);
    for i in 0..warmup {
        frame(app);
        progress.show(i + 1);
    }
    if let Some(mut restir) = app.world_mut().get_mut::<Restir>(camera) {
        restir.accumulate = gathers;
    }
    let mut sum: Vec<[f64; 3]> = Vec::new();
    times.sample(app.world(), settings);
    times.clear();
    for i in 0..args.frames {
        let last = i + 1 == args.frames;
        let captured = last || (!gathers && mean);
        if captured {
            app.world().resource::<View>().capture.request();
        }
        let (frame_ms, cpu_ms) = frame(app);
        times.frames_ms.push(frame_ms);
        times.cpu_ms.push(cpu_ms);
        times.sample(app.world(), settings);
        if captured {
            add(&mut sum, &capture(app)?);
        }
        progress.show(warmup + i + 1);
    }
    progress.done();
    let counted = if gathers || !mean { 1.0 } else { f64::from(args.frames) };
    Ok(Frames { pixels: sum.into_iter().map(|p| p.map(|c| c / counted)).collect() })
}

fn capture(app: &App) -> Result<CapturedRadiance, String> {
    app.world().resource::<View>().capture.take().ok_or("the frame was not rendered".into())
}

fn add(sum: &mut Vec<[f64; 3]>, frame: &CapturedRadiance) {
    sum.resize(frame.pixels.len(), [0.0; 3]);
    for (sum, pixel) in sum.iter_mut().zip(frame.mean()) {
        for (s, c) in sum.iter_mut().zip(pixel) {
            *s += f64::from(c);
        }
    }
}

/// What the view target shows, tonemapped by Bevy.
fn screenshot(app: &mut App) -> Result<Image, String> {
    #[derive(Resource, Default)]
    struct Taken(Option<Image>);
    app.init_resource::<Taken>();
    let target = app.world().resource::<View>().target.clone();
    app.world_mut()
        .spawn(Screenshot::image(target))
        .observe(|captured: On<ScreenshotCaptured>, mut taken: ResMut<Taken>| taken.0 = Some(captured.image.clone()));
    until(app, "no picture came back", |app| app.world().resource::<Taken>().0.is_some())?;
    app.world_mut().resource_mut::<Taken>().0.take().ok_or("no picture came back".into())
}

/// A bar on a terminal, a line every tenth elsewhere.
struct Progress {
    bar: Option<ProgressBar>,
    total: u32,
}

impl Progress {
    fn new(total: u32) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{bar:40} {pos}/{len} frames, {eta} left");
            ProgressBar::new(total.into()).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        });
        Self { bar, total }
    }

    fn show(&self, frame: u32) {
        match &self.bar {
            Some(bar) => bar.set_position(frame.into()),
            None if u64::from(frame) * 10 / u64::from(self.total)
                != u64::from(frame - 1) * 10 / u64::from(self.total) =>
            {
                println!("frame {frame} of {}", self.total);
            }
            None => {}
        }
    }

    fn done(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
