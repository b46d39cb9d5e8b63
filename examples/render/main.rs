//! Renders a glTF scene without a window: `cargo run --example render -- SCENE.glb --out picture.png`.

mod aovs;
mod args;
mod stats;

use aovs::AnimationTimes;
use args::{Args, Output};
use bevy::{camera::Exposure, gltf::Gltf, prelude::*};
use bevy_restir::{Denoiser, Restir, RestirBudget, RestirEnvironment, RestirStatistics, Technique};
use bevy_restir_support::{
    arguments::{self, ExposureChoice},
    environment,
    exposure::{ev100_for, measure},
    exr_file, files,
    frame_sum::FrameSum,
    headless::{self, captured, frame},
    panics, picture,
    progress::Progress,
    scene::{self, CameraSetup, SceneFile, View},
    sky,
    times::Times,
};
use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

fn main() -> ExitCode {
    let args: Args = match arguments::parse() {
        Ok(args) => args,
        Err(code) => return code,
    };
    headless::quiet_drivers();
    let settings = match args.check_outputs().and_then(|()| args.settings()) {
        Ok(settings) => settings,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(2);
        }
    };
    panics::record();
    match panics::caught(|| render(&args, settings)).and_then(|result| result) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}: {}", args.scene.display(), error.lines().next().unwrap_or_default());
            ExitCode::from(1)
        }
    }
}

/// The files that this run has written.
#[derive(Default)]
pub struct Written(Vec<PathBuf>);

impl Written {
    /// Writes a picture of linear radiance.
    pub fn exr(&mut self, path: &Path, size: UVec2, pixels: &[[f32; 3]]) -> Result<(), String> {
        exr_file::write(path, size, pixels)?;
        self.0.push(path.into());
        Ok(())
    }

    /// Removes all of them.
    fn remove(&self) {
        for path in &self.0 {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Loads the scene, renders it and writes the files: all of them or none.
fn render(args: &Args, settings: Restir) -> Result<(), String> {
    args.outputs().try_for_each(files::check)?;
    let mut written = Written::default();
    let result = panics::caught(|| render_into(args, settings, &mut written)).and_then(|result| result);
    result.inspect_err(|_| written.remove())
}

fn wants_mean(args: &Args, settings: &Restir) -> bool {
    settings.technique == Technique::Reference || args.output == Output::Mean
}

/// The limit of bright pixels and the denoiser are for single frames; they would stay in a mean as a bias.
fn turn_filters_off(settings: &mut Restir) {
    settings.firefly_limit = 0.0;
    settings.denoiser = Denoiser::OFF;
}

fn render_into(args: &Args, mut settings: Restir, written: &mut Written) -> Result<(), String> {
    let path = args.scene.canonicalize().map_err(|e| e.to_string())?;
    let (folder, name) = scene::split(&path)?;
    let mut app = headless::app(folder, args.backend)?;
    app.world().resource::<RestirStatistics>().count_rays(args.stats.is_some());
    if args.animate {
        app.add_systems(Update, play_animation);
    }
    scene::load(&mut app, name)?;
    let camera = scene::file_camera(app.world_mut(), args.camera.as_deref(), args.size)?;
    let environment = environment(app.world_mut(), args)?;
    // From the first frame on, because pipelines for other settings would still be missing in the first frame of the mean.
    if wants_mean(args, &settings) && (args.writes_exr() || !args.animate) {
        turn_filters_off(&mut settings);
    }
    let setup = CameraSetup { size: args.size, exposure: args.exposure(), environment, settings: settings.clone() };
    scene::spawn_camera(app.world_mut(), camera.place, setup);
    if let Some(node) = camera.node.filter(|_| args.animate) {
        scene::follow(&mut app, node);
    }
    headless::until_ready(&mut app)?;
    if args.animate && AnimationTimes::of(app.world_mut()).is_empty() {
        warn!("restir: --animate has no effect, because nothing in the scene is animated");
    }
    // A value above 1 counts as 1.
    if settings.resolution_scale >= 1.0 {
        headless::fits(&mut app, args.size)?;
    }
    let (settings, step) = match args.budget() {
        Some(budget) => within_budget(&mut app, budget, settings)?,
        None => (settings, 0),
    };

    // Loading takes any number of frames, in which the animation has played.
    let start = AnimationTimes::rewind(app.world_mut());
    // Where the exposure is known, the last frame itself is shown.
    let shows_last = !args.writes_exr() && args.ev100 != Some(ExposureChoice::Auto);
    let mut frames = accumulate(&mut app, args, &settings, shows_last)?;
    // Where a picture with another exposure follows, the animation goes on.
    let moments = [start, AnimationTimes::of(app.world_mut())];
    let exposure = final_exposure(args, &frames);
    // Without an exposure value the file holds the exact radiance.
    let scale = f64::from(args.ev100.map_or(1.0, |_| exposure.exposure()));
    if args.writes_exr() {
        // Distances, counts and the like have no exposure.
        let scale = if settings.debug_view.shows_light() { scale } else { 1.0 };
        written.exr(&args.out, args.size, &frames.scaled(scale))?;
    } else {
        if !shows_last {
            let camera = app.world().resource::<View>().camera;
            app.world_mut().entity_mut(camera).insert(exposure);
            picture::request(&mut app)?;
        }
        let image = picture::take(&mut app)?;
        picture::write_png(&args.out, image)?;
        written.0.push(args.out.clone());
    }
    // The frames of other files must not count.
    let stats = match args.stats {
        Some(_) => Some(stats::of_last_frame(&mut app, args, step, &mut frames)?),
        None => None,
    };
    aovs::write(&mut app, args, &settings, scale, &moments, written)?;
    if let Some((path, stats)) = args.stats.as_deref().zip(stats) {
        let text = serde_json::to_string_pretty(&stats).map_err(|e| e.to_string())? + "\n";
        files::write_text(path, &text)?;
    }
    Ok(())
}

/// Gives the camera settings with as many samples and pixels as fit into the budget. Returns them and their step of
/// [`Restir::reduced_within`].
fn within_budget(app: &mut App, budget: RestirBudget, settings: Restir) -> Result<(Restir, u32), String> {
    /// Frames without a change after which the number of samples is final.
    const STEADY: u32 = 40;
    /// Frames after which it is final in any case.
    const MOST: u32 = 600;
    let step_of = |app: &App| app.world().resource::<RestirStatistics>().report().budget_step;
    let RestirBudget { gpu_ms, least_resolution_scale } = budget;
    let reduced = |step| settings.reduced_within(step, least_resolution_scale);
    app.insert_resource(budget);
    let (mut step, mut steady) = (0, 0);
    let mut times = Times::default();
    for _ in 0..MOST {
        frame(app);
        headless::alive(app)?;
        let now = step_of(app);
        if now != step {
            (step, steady) = (now, 0);
            times.clear();
        }
        steady += 1;
        times.sample(app.world(), &reduced(step));
        if steady == STEADY {
            break;
        }
    }
    app.world_mut().remove_resource::<RestirBudget>();
    let took = times.frame();
    if !times.has_gpu_times() {
        warn!("restir: --time-budget has no effect, because no GPU times arrive: the device measures none");
    } else if reduced(step) == reduced(step + 1) && took > f64::from(gpu_ms) {
        warn!(
            "restir: even with the fewest samples and pixels that the budget allows, a frame takes {took:.3} ms of GPU time; the \
             budget is {gpu_ms} ms"
        );
    }
    let settings = reduced(step);
    let camera = app.world().resource::<View>().camera;
    app.world_mut().entity_mut(camera).insert(settings.clone());
    headless::until_ready(app)?;
    Ok((settings, step))
}

/// The environment of the command line, or a studio for a scene that has no light of its own.
fn environment(world: &mut World, args: &Args) -> Result<Option<RestirEnvironment>, String> {
    if let Some(wanted) = &args.env {
        return environment::load(world, wanted).map(Some);
    }
    if sky::has_light(world) {
        return Ok(None);
    }
    warn!("restir: the file has no light; a gray studio lights it (--env chooses another environment)");
    // As bright on the picture whatever the exposure.
    let luminance = 1.0 / args.exposure().exposure();
    Ok(Some(sky::studio(&mut world.resource_mut::<Assets<Image>>(), luminance)))
}

/// The exposure of the command line, or the one that fits the picture.
fn final_exposure(args: &Args, frames: &Frames) -> Exposure {
    if args.ev100 != Some(ExposureChoice::Auto) {
        return args.exposure();
    }
    let pixels = frames.pixels.iter().map(|p| p.map(|c| c as f32));
    match measure(frames.size, pixels).luminance {
        Some(luminance) => Exposure { ev100: ev100_for(luminance) },
        None => {
            warn!("restir: the picture is black, so --ev100 auto leaves the exposure at 1");
            args.exposure()
        }
    }
}

/// Plays the first animation of the file on every animation player that appears.
fn play_animation(
    mut commands: Commands,
    file: Res<SceneFile>,
    gltfs: Res<Assets<Gltf>>,
    mut graphs: ResMut<Assets<AnimationGraph>>,
    mut players: Query<(Entity, &mut AnimationPlayer), Added<AnimationPlayer>>,
) {
    let Some(clip) = gltfs.get(&file.0).and_then(|gltf| gltf.animations.first().cloned()) else {
        return;
    };
    for (entity, mut player) in &mut players {
        let (graph, node) = AnimationGraph::from_clip(clip.clone());
        player.play(node).repeat();
        commands.entity(entity).insert(AnimationGraphHandle(graphs.add(graph)));
    }
}

/// Results of the frames after the warm-up.
struct Frames {
    /// Settings of these frames.
    settings: Restir,
    /// Of the traced picture.
    size: UVec2,
    /// Mean radiance.
    pixels: Vec<[f64; 3]>,
    passes: Times,
    all_ms: Vec<f64>,
    cpu_ms: Vec<f64>,
    /// Bytes that the last frame sent to the device, and the CPU time of each stage in it, ms.
    uploaded_bytes: u64,
    stages: Vec<(&'static str, f32)>,
}

impl Frames {
    /// The pixels of a file.
    fn scaled(&self, scale: f64) -> Vec<[f32; 3]> {
        self.pixels.iter().map(|p| p.map(|c| (c * scale) as f32)).collect()
    }
}

/// Renders frames that fill the history and are not part of the picture.
fn warm_up(app: &mut App, count: u32, progress: &Progress) -> Result<(), String> {
    for _ in 0..count {
        frame(app);
        headless::alive(app)?;
        progress.step();
    }
    Ok(())
}

/// Renders the warm-up and the frames of the picture, from a reset on. `shows_last`: also requests the tonemapped picture of the last one.
fn accumulate(app: &mut App, args: &Args, settings: &Restir, shows_last: bool) -> Result<Frames, String> {
    let camera = app.world().resource::<View>().camera;
    let reset = |app: &mut App| {
        if let Some(mut restir) = app.world_mut().get_mut::<Restir>(camera) {
            restir.reset = true;
            // The frames of the warm-up are not part of the picture.
            restir.accumulate = false;
        }
    };
    let moves = args.animate && !AnimationTimes::of(app.world_mut()).is_empty();
    // The GPU sums the frames of a still scene. Those of a moving one are summed here.
    let wants_mean = wants_mean(args, settings);
    let is_mean = wants_mean && (args.writes_exr() || !moves);
    if wants_mean && !is_mean {
        warn!("restir: a .png of an animation shows its last frame; an .exr has the mean of all frames");
    }
    let sums_on_gpu = is_mean && !moves;
    let warmup = if settings.technique == Technique::Reference { 0 } else { args.warmup };
    let progress = Progress::new(u64::from(warmup) + u64::from(args.frames));
    reset(app);
    warm_up(app, warmup, &progress)?;
    let mut restir = app.world_mut().get_mut::<Restir>(camera).ok_or("the camera is gone")?;
    restir.accumulate = sums_on_gpu;
    if is_mean {
        turn_filters_off(&mut restir);
    }
    let of_frames = Restir::clone(&restir);
    let mut sum = FrameSum::default();
    let mut size = args.size;
    let mut passes = Times::default();
    let (mut all_ms, mut cpu_ms) = (Vec::new(), Vec::new());
    for i in 0..args.frames {
        let last = i + 1 == args.frames;
        let is_captured = last || (is_mean && !sums_on_gpu);
        if is_captured {
            app.world().resource::<View>().capture.request();
        }
        if last && shows_last {
            picture::request(app)?;
        }
        let (all, cpu) = frame(app);
        headless::alive(app)?;
        all_ms.push(all);
        cpu_ms.push(cpu);
        passes.sample(app.world(), &of_frames);
        if i == 0 {
            // The times of a frame arrive in the next one.
            passes.clear();
        }
        if is_captured {
            let frame = captured(app)?;
            size = frame.size;
            sum.add(frame);
        }
        progress.step();
    }
    let report = app.world().resource::<RestirStatistics>().report();
    let (uploaded_bytes, stages) = (report.uploaded_bytes, report.cpu_ms);
    let pixels = sum.mean();
    Ok(Frames { settings: of_frames, size, pixels, passes, all_ms, cpu_ms, uploaded_bytes, stages })
}
