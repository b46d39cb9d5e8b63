//! Measures cost and error of one scene under many settings, in one app.

mod cost;
mod pairs;

use bevy::{
    app::App, camera::visibility::RenderLayers, ecs::change_detection::DetectChangesMut, ecs::entity::Entity,
    ecs::world::World, math::UVec2, render::renderer::RenderAdapterInfo, transform::components::Transform,
};
use bevy_restir::{
    RayBackend, Restir, RestirReport, RestirStatistics, Reuse, Technique, pass_names, testing::resolution::wanted_size,
};
use bevy_restir_support::{
    environment::{self, Environment},
    exposure::unit_exposure,
    headless::{self, alive, captured, fits, frame, until_ready},
    progress::Progress,
    scene::{self, CameraSetup, View},
    times::{Times, median},
};
use serde_json::Value;
use std::path::{Path, PathBuf};

use crate::error::{Error, Picture, Reference, enlarged, mean};
pub use cost::Cost;

/// Lengths of a measurement.
#[derive(clap::Args, Clone, Debug)]
pub struct Counts {
    /// Frames that build up history before anything is measured.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(..=16_000_000))]
    pub warmup: u32,
    /// Number of timed frames.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=16_000_000))]
    pub frames: u32,
}

/// How errors are measured.
pub struct Errors<'a> {
    pub reference: &'a Reference,
    /// Number of independent frames.
    pub seeds: u32,
}

/// An app with a scene and its camera.
pub struct Bench {
    app: App,
    size: UVec2,
    counts: Counts,
    times: Times,
    /// Transforms of `mover` (of the camera, if `mover` is `None`) in the last frames before a picture.  Empty: nothing moves.
    motion: Vec<Transform>,
    mover: Option<Entity>,
}

/// Path and name of a scene file.
pub type Scene = (PathBuf, String);

/// Resolves all paths first, so that a wrong one fails before minutes are spent on the others.
pub fn scenes(paths: &[PathBuf]) -> Result<Vec<Scene>, String> {
    let find = |path: &PathBuf| {
        let scene = path.canonicalize().map_err(|e| format!("{}: {e}", path.display()))?;
        let name = scene.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((scene, name))
    };
    paths.iter().map(find).collect()
}

/// The entry of a scene in `references.json` beside it, or null.
fn reference_entry(folder: &Path, name: &str) -> Result<Value, String> {
    let path = folder.join("references.json");
    let Ok(text) = std::fs::read_to_string(&path) else { return Ok(Value::Null) };
    let all: Value = serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()))?;
    Ok(all[name].clone())
}

/// The number of bounces of a scene's reference in `references.json` beside it.
pub fn reference_bounces((path, name): &Scene) -> Result<u32, String> {
    let entry = reference_entry(path.parent().unwrap_or(path), name)?;
    let bounces = entry["bounces"].as_u64().ok_or("references.json beside it does not name its bounces")?;
    Ok(bounces as u32)
}

/// The environment of a scene in `references.json` beside it.
fn environment_of(folder: &Path, name: &str) -> Result<Option<Environment>, String> {
    let entry = reference_entry(folder, name)?;
    environment::of_reference(&entry, folder).map_err(|why| format!("references.json beside it: {name}: {why}"))
}

/// Name and driver of the adapter.
pub fn adapter_of(app: &App) -> String {
    let info = app.world().resource::<RenderAdapterInfo>();
    let driver = format!("{} {}", info.driver, info.driver_info);
    format!("{} ({:?}), driver {}", info.name, info.backend, driver.trim())
}

impl Bench {
    /// Loads a scene and places its camera.
    pub fn of_scene(scene: &Scene, size: UVec2, settings: Restir, counts: &Counts) -> Result<Self, String> {
        Self::of_edited(scene, size, settings, counts, |_| Ok(()))
    }

    /// Loads a scene, places its camera, and edits both before the first frame.
    pub fn of_edited(
        (scene, name): &Scene,
        size: UVec2,
        settings: Restir,
        counts: &Counts,
        edit: impl FnOnce(&mut World) -> Result<(), String>,
    ) -> Result<Self, String> {
        let (folder, file) = scene::split(scene)?;
        let environment = environment_of(folder, name)?;
        let mut app = Self::app_in(folder, RayBackend::Auto)?;
        let environment = environment.map(|wanted| environment::load(app.world_mut(), &wanted)).transpose()?;
        // While the only camera sees nothing, the plugin mirrors nothing: shaders keep features that it has once seen.
        let blind = app.world_mut().spawn((settings.clone(), RenderLayers::none())).id();
        scene::load(&mut app, file)?;
        app.world_mut().despawn(blind);
        let place = scene::file_camera(app.world_mut(), None, size)?.place;
        let setup = CameraSetup { size, exposure: unit_exposure(), environment, settings };
        scene::spawn_camera(app.world_mut(), place, setup);
        edit(app.world_mut())?;
        Self::new(app, size, counts.clone())
    }

    /// An app for a measurement, without a scene.
    pub fn app_in(folder: &Path, backend: RayBackend) -> Result<App, String> {
        let app = headless::app(folder, backend)?;
        app.world().resource::<RestirStatistics>().count_rays(true);
        Ok(app)
    }

    /// Takes such an app with a camera and waits until it is ready.
    pub fn new(mut app: App, size: UVec2, counts: Counts) -> Result<Self, String> {
        until_ready(&mut app)?;
        let mut bench = Self { app, size, counts, times: Times::default(), motion: Vec::new(), mover: None };
        bench.check_size()?;
        Ok(bench)
    }

    /// Moves the camera before each picture of a technique that reuses frames.  For other techniques it stays at the last
    /// of these positions.
    pub fn moving(self, motion: Vec<Transform>) -> Self {
        Self { motion, ..self }
    }

    /// Changes the places of the camera; without any it rests where it is.
    pub fn set_motion(&mut self, motion: Vec<Transform>) {
        self.motion = motion;
    }

    /// Moves an object in place of the camera.
    pub fn set_mover(&mut self, mover: Option<Entity>) {
        self.mover = mover;
    }

    /// Size of the picture in pixels.
    pub fn size(&self) -> UVec2 {
        self.size
    }

    /// The camera's place.
    pub fn place(&self) -> Transform {
        let camera = self.app.world().resource::<View>().camera;
        self.app.world().get::<Transform>(camera).copied().unwrap_or_default()
    }

    pub fn app(&mut self) -> &mut App {
        &mut self.app
    }

    /// The plugin's report of the last frame.
    pub fn report(&self) -> RestirReport {
        self.app.world().resource::<RestirStatistics>().report()
    }

    /// Bytes of all buffers and textures of the plugin.
    pub fn bytes(&self) -> u64 {
        self.report().memory_bytes()
    }

    /// Name and driver of the adapter.
    pub fn adapter(&self) -> String {
        adapter_of(&self.app)
    }

    /// Number of frames of a measurement.
    pub fn planned(counts: &Counts, settings: &Restir, seeds: u32) -> u64 {
        let each = history(settings, counts) + 1;
        let warmup = counts.warmup.saturating_sub(if seeds > 0 { each } else { 0 });
        u64::from(seeds) * u64::from(each) + u64::from(warmup) + u64::from(counts.frames)
    }

    /// Measures the cost of a frame, and its error where `errors` asks for it.
    pub fn measure(
        &mut self,
        settings: &Restir,
        errors: Option<&Errors>,
        progress: &Progress,
    ) -> Result<(Cost, Option<Error>), String> {
        let before = history(settings, &self.counts);
        let mut done = 0;
        let error = match errors {
            Some(errors) => {
                done = before + 1;
                Some(self.error(settings, errors, before, progress)?)
            }
            None => {
                self.set(settings)?;
                self.restart(0);
                None
            }
        };
        for _ in done..self.counts.warmup {
            self.step(progress)?;
        }
        self.times.sample(self.app.world(), settings);
        self.times.clear();
        let mut rays = 0.0;
        for _ in 0..self.counts.frames {
            self.step(progress)?;
            self.times.sample(self.app.world(), settings);
            rays += self.report().rays as f64;
        }
        let rays = rays / f64::from(self.counts.frames) / pixels(self.size);
        Ok((self.cost(settings, rays), error))
    }

    /// Median times of the frames since the last [`Times::clear`].
    fn cost(&self, settings: &Restir, rays: f64) -> Cost {
        let names = pass_names(settings, self.report().features);
        let passes = names.into_iter().map(|name| (name, median(self.times.of(name)))).collect();
        Cost { passes, rays, has_gpu_times: self.times.has_gpu_times() }
    }

    /// Mean error over independent seeds of the frame after `before` others, or of the mean of them all where the technique
    /// accumulates.
    pub fn error(
        &mut self,
        settings: &Restir,
        errors: &Errors,
        before: u32,
        progress: &Progress,
    ) -> Result<Error, String> {
        Ok(Error::average(&self.errors(settings, errors, before, progress)?))
    }

    /// The error of each seed.
    pub fn errors(
        &mut self,
        settings: &Restir,
        errors: &Errors,
        before: u32,
        progress: &Progress,
    ) -> Result<Vec<Error>, String> {
        let pictures = self.pictures(settings, errors.seeds, before, progress)?;
        Ok(pictures.iter().map(|picture| errors.reference.error(picture)).collect())
    }

    /// Radiance of the frame after `before` others, of each of the seeds 1 to `seeds`.
    pub fn pictures(
        &mut self,
        settings: &Restir,
        seeds: u32,
        before: u32,
        progress: &Progress,
    ) -> Result<Vec<Picture>, String> {
        self.set(settings)?;
        let mut picture = |seed| {
            self.restart(seed);
            self.picture(before, progress)
        };
        (1..=seeds).map(&mut picture).collect()
    }

    /// Radiance of some frames, ascending, of each of the seeds 1 to `seeds`, and the cost of a frame in the second half of these runs.
    pub fn runs(
        &mut self,
        settings: &Restir,
        seeds: u32,
        frames: &[u32],
        progress: &Progress,
    ) -> Result<(Vec<Vec<Picture>>, Cost), String> {
        self.set(settings)?;
        self.times.sample(self.app.world(), settings);
        self.times.clear();
        let last = frames.last().copied().unwrap_or(0);
        let (mut rays, mut timed) = (0.0, 0);
        let mut runs = Vec::new();
        for seed in 1..=seeds {
            self.restart(seed);
            let mut run = Vec::new();
            for frame in 0..=last {
                self.place_mover((last - frame) as usize);
                let is_wanted = frames.contains(&frame);
                if is_wanted {
                    self.app.world().resource::<View>().capture.request();
                }
                self.step(progress)?;
                if is_wanted {
                    run.push(self.captured()?);
                }
                if 2 * frame >= last {
                    self.times.sample(self.app.world(), settings);
                    rays += self.report().rays as f64;
                    timed += 1;
                }
            }
            runs.push(run);
        }
        Ok((runs, self.cost(settings, rays / f64::from(timed) / pixels(self.size))))
    }

    /// Renders the converged picture in two independent halves.
    pub fn reference(&mut self, settings: &Restir, samples: u32, progress: &Progress) -> Result<Reference, String> {
        self.set(settings)?;
        let size = self.size;
        let mut half = |seed| {
            self.restart(seed);
            self.picture(samples.div_ceil(2) - 1, progress)
        };
        // No measured frame uses these seeds.
        let reference = Reference::new(&half(u32::MAX)?, &half(u32::MAX - 1)?, size);
        lit(reference.pixels())?;
        Ok(reference)
    }

    /// Radiance of the frame after `before` others, or the mean of them all where the technique accumulates, and the median
    /// milliseconds of lighting of these frames.
    pub fn show(&mut self, settings: &Restir, before: u32, progress: &Progress) -> Result<(Picture, f64), String> {
        self.set(settings)?;
        self.restart(0);
        self.times.sample(self.app.world(), settings);
        self.times.clear();
        for _ in 0..before {
            self.step(progress)?;
            self.times.sample(self.app.world(), settings);
        }
        let picture = self.picture(0, progress)?;
        self.times.sample(self.app.world(), settings);
        Ok((picture, self.cost(settings, 0.0).lighting()))
    }

    /// Mean radiance of the next frame.
    pub fn light(&mut self, progress: &Progress) -> Result<f64, String> {
        Ok(mean(&self.picture(0, progress)?, |c| c))
    }

    /// Sets the camera's settings and waits for their pipelines.
    fn set(&mut self, settings: &Restir) -> Result<(), String> {
        let camera = self.app.world().resource::<View>().camera;
        let mut restir = self.app.world_mut().get_mut::<Restir>(camera).ok_or("the camera is gone")?;
        *restir = Restir { reset: true, ..settings.clone() };
        until_ready(&mut self.app)?;
        self.check_size()
    }

    /// Fails if the device traces fewer pixels than the settings ask for: times and errors would pass for those of the whole picture.
    fn check_size(&mut self) -> Result<(), String> {
        let camera = self.app.world().resource::<View>().camera;
        let scale = self.app.world().get::<Restir>(camera).map_or(1.0, |restir| restir.resolution_scale);
        fits(&mut self.app, wanted_size(self.size, scale))
    }

    fn restart(&mut self, seed: u32) {
        let camera = self.app.world().resource::<View>().camera;
        if let Some(mut restir) = self.app.world_mut().get_mut::<Restir>(camera) {
            restir.seed = seed;
            restir.reset = true;
        }
    }

    /// Places the camera, or the object that moves, where it is `left` frames before a picture.
    fn place_mover(&mut self, left: usize) {
        let Some(last) = self.motion.len().checked_sub(1) else { return };
        let camera = self.app.world().resource::<View>().camera;
        let rests = self.app.world().get::<Restir>(camera).is_none_or(|r| r.technique == Technique::Reference);
        let place = self.motion[if rests { last } else { last.saturating_sub(left) }];
        let mover = self.mover.unwrap_or(camera);
        if let Some(mut transform) = self.app.world_mut().get_mut::<Transform>(mover) {
            transform.set_if_neq(place);
        }
    }

    /// Renders a frame.  Without the renderer, all times would be 0.
    fn step(&mut self, progress: &Progress) -> Result<(), String> {
        frame(&mut self.app);
        alive(&self.app)?;
        progress.step();
        Ok(())
    }

    /// Radiance of the frame after `before` others.
    fn picture(&mut self, before: u32, progress: &Progress) -> Result<Picture, String> {
        for left in (1..=before as usize).rev() {
            self.place_mover(left);
            self.step(progress)?;
        }
        self.place_mover(0);
        self.app.world().resource::<View>().capture.request();
        self.step(progress)?;
        self.captured()
    }

    /// Radiance of the last frame, which must have been requested, or the mean of all frames where the technique accumulates.
    fn captured(&self) -> Result<Picture, String> {
        let traced = captured(&self.app)?;
        let pixels = traced.mean().map(|p| p.map(f64::from)).collect();
        Ok(enlarged(pixels, traced.size, self.size))
    }
}

/// An error if a converged picture is black: no error can be relative to it.
pub fn lit(reference: &Picture) -> Result<(), String> {
    match mean(reference, |c| c) > 0.0 {
        true => Ok(()),
        false => {
            Err("its picture is black: it has no light. `env` in references.json beside it can add one, and `sweep`, \
                      `presets` and `features` have --env"
                .into())
        }
    }
}

/// Number of pixels of a picture.
pub fn pixels(size: UVec2) -> f64 {
    f64::from(size.x) * f64::from(size.y)
}

/// Number of frames that must come before a frame whose error is measured, because it reuses them.
fn history(settings: &Restir, counts: &Counts) -> u32 {
    let Restir { direct, paths, subsurface, .. } = settings;
    let extra = |reuse: &Reuse| reuse.temporal || reuse.spatial_samples + reuse.disocclusion_samples > 0;
    // Light below surfaces is reused beside direct light.
    let direct_reuses = extra(&direct.reuse) || extra(&subsurface.reuse);
    let paths_reuse = paths.reuse.temporal || paths.reuse.spatial_samples > 0;
    let reuses = match settings.technique {
        Technique::Reference => false,
        Technique::Di => direct_reuses,
        Technique::Gi => direct_reuses || paths_reuse,
        Technique::Pt if paths.separate_direct_light => direct_reuses || paths_reuse,
        _ => paths_reuse,
    };
    if reuses { counts.warmup } else { 0 }
}
