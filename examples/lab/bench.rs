//! One scene under one setting after another: what its frames cost, and how far off they are.

use bevy::{app::App, math::UVec2, render::renderer::RenderAdapterInfo};
use bevy_restir::{Restir, RestirReport, RestirStatistics, Technique, pass_names};

use crate::{
    error::{Picture, Reference, mean},
    headless::{
        captured, frame,
        progress::Progress,
        scene::View,
        times::{Times, median},
        until_ready,
    },
};

/// How much is measured.
#[derive(clap::Args, Clone, Debug)]
pub struct Counts {
    /// Frames that build history before anything is measured.
    #[arg(long, default_value_t = 24)]
    pub warmup: u32,
    /// Frames whose times are taken.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..))]
    pub frames: u32,
}

/// Passes that light has no part in.
const OTHER_PASSES: [&str; 3] = ["visibility", "statistics", "composite"];

/// What a frame of some settings costs: medians.
#[derive(Clone, Debug)]
pub struct Cost {
    passes: Vec<(&'static str, f64)>,
    /// Rays a pixel, mean.
    pub rays: f64,
}

impl Cost {
    /// Of nothing.
    pub const NONE: Self = Self { passes: Vec::new(), rays: 0.0 };

    fn sum(&self, counts: impl Fn(&str) -> bool) -> f64 {
        self.passes.iter().filter(|(name, _)| counts(name)).map(|(_, ms)| ms).sum()
    }

    /// Ms of the light subsets.
    pub fn presample(&self) -> f64 {
        self.sum(|name| name == "presample")
    }

    /// Ms of the initial candidates.
    pub fn candidates(&self) -> f64 {
        self.sum(|name| name == "direct_candidates")
    }

    /// Ms of reuse, all rounds.
    pub fn reuse(&self) -> f64 {
        self.sum(|name| name.starts_with("direct_reuse"))
    }

    /// Ms of reuse and what puts its light together.
    pub fn reuse_and_shade(&self) -> f64 {
        self.reuse() + self.sum(|name| name == "resolve")
    }

    /// Ms of all passes that make light.
    pub fn lighting(&self) -> f64 {
        self.sum(|name| !OTHER_PASSES.contains(&name))
    }
}

/// Errors that are averaged.
pub struct Errors<'a> {
    pub reference: &'a Reference,
    /// Independent frames.
    pub seeds: u32,
}

/// An app with a scene and its camera.
pub struct Bench {
    app: App,
    size: UVec2,
    counts: Counts,
    times: Times,
}

impl Bench {
    /// Of an app whose camera is spawned.
    pub fn new(mut app: App, size: UVec2, counts: Counts) -> Result<Self, String> {
        until_ready(&mut app)?;
        Ok(Self { app, size, counts, times: Times::default() })
    }

    pub fn app(&mut self) -> &mut App {
        &mut self.app
    }

    /// What the plugin says of the last frame.
    pub fn report(&self) -> RestirReport {
        self.app.world().resource::<RestirStatistics>().report()
    }

    /// Bytes of all that the plugin holds.
    pub fn bytes(&self) -> u64 {
        self.report().memory.iter().map(|(_, bytes)| bytes).sum()
    }

    /// Name and driver of the adapter.
    pub fn adapter(&self) -> String {
        let info = self.app.world().resource::<RenderAdapterInfo>();
        let driver = format!("{} {}", info.driver, info.driver_info);
        format!("{} ({:?}), driver {}", info.name, info.backend, driver.trim())
    }

    /// Frames that a measurement takes.
    pub fn planned(counts: &Counts, settings: &Restir, seeds: u32) -> u64 {
        let each = history(settings, counts) + 1;
        let warmup = counts.warmup.saturating_sub(if seeds > 0 { each } else { 0 });
        u64::from(seeds) * u64::from(each) + u64::from(warmup) + u64::from(counts.frames)
    }

    /// What a frame of some settings costs, and its mean squared error where errors are asked for.
    pub fn measure(
        &mut self,
        settings: &Restir,
        errors: Option<&Errors>,
        progress: &Progress,
    ) -> Result<(Cost, Option<f64>), String> {
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
            self.step(progress);
        }
        self.times.sample(self.app.world(), settings);
        self.times.clear();
        let mut rays = 0.0;
        for _ in 0..self.counts.frames {
            self.step(progress);
            self.times.sample(self.app.world(), settings);
            rays += self.report().rays as f64;
        }
        let passes = pass_names(settings).into_iter().map(|name| (name, median(self.times.of(name)))).collect();
        Ok((Cost { passes, rays: rays / f64::from(self.counts.frames) / pixels(self.size) }, error))
    }

    /// Mean squared error of the frame that comes after some others, or of the mean of them all where the technique sums them:
    /// mean over independent seeds.
    pub fn error(
        &mut self,
        settings: &Restir,
        errors: &Errors,
        before: u32,
        progress: &Progress,
    ) -> Result<f64, String> {
        self.set(settings)?;
        let mut sum = 0.0;
        for seed in 1..=errors.seeds {
            self.restart(seed);
            sum += errors.reference.error(&self.picture(before, progress)?);
        }
        Ok(sum / f64::from(errors.seeds))
    }

    /// The converged picture of the reference tracer at these settings.
    pub fn reference(&mut self, settings: &Restir, samples: u32, progress: &Progress) -> Result<Reference, String> {
        self.set(settings)?;
        let mut half = |seed| {
            self.restart(seed);
            self.picture(samples.div_ceil(2) - 1, progress)
        };
        // Seeds that no measured frame has.
        Ok(Reference::new(&half(u32::MAX)?, &half(u32::MAX - 1)?))
    }

    /// Mean radiance of the next frame.
    pub fn light(&mut self, progress: &Progress) -> Result<f64, String> {
        Ok(mean(&self.picture(0, progress)?, |c| c))
    }

    /// Settings on the camera, with their pipelines.
    fn set(&mut self, settings: &Restir) -> Result<(), String> {
        let camera = self.app.world().resource::<View>().camera;
        let mut restir = self.app.world_mut().get_mut::<Restir>(camera).ok_or("the camera is gone")?;
        *restir = Restir { reset: true, ..settings.clone() };
        until_ready(&mut self.app)
    }

    fn restart(&mut self, seed: u32) {
        let camera = self.app.world().resource::<View>().camera;
        if let Some(mut restir) = self.app.world_mut().get_mut::<Restir>(camera) {
            restir.seed = seed;
            restir.reset = true;
        }
    }

    fn step(&mut self, progress: &Progress) {
        frame(&mut self.app);
        progress.step();
    }

    /// What is shown after some frames.
    fn picture(&mut self, before: u32, progress: &Progress) -> Result<Picture, String> {
        for _ in 0..before {
            self.step(progress);
        }
        self.app.world().resource::<View>().capture.request();
        self.step(progress);
        Ok(captured(&self.app)?.mean().map(|p| p.map(f64::from)).collect())
    }
}

/// Pixels of a picture.
pub fn pixels(size: UVec2) -> f64 {
    f64::from(size.x) * f64::from(size.y)
}

/// Frames before the one whose error is taken: those that it reuses.
fn history(settings: &Restir, counts: &Counts) -> u32 {
    let direct = &settings.direct;
    let reuses = direct.temporal || direct.spatial_taps + direct.disocclusion_taps > 0;
    if settings.technique == Technique::Di && reuses { counts.warmup } else { 0 }
}
