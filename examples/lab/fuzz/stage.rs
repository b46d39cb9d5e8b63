//! An app that renders cases, one after the other.

use bevy::{mesh::morph::MeshMorphWeights, prelude::*, render::renderer::RenderDevice};
use bevy_restir::{
    BiasCorrection, Denoiser, Jitter, Mis, Preset, RayBackend, Restir, RestirEnvironment, RestirStatistics, ShiftedMis,
    SuffixRetrace, Technique, VisibilityReuse,
    testing::{accel::ray_query, check_mirror, lengths::table_lengths},
};
use bevy_restir_support::{
    exposure::unit_exposure,
    headless::{self, captured, frame},
    panics,
    scene::{self, CameraSetup, View},
    skinned,
};
use std::path::Path;

use super::{
    case::{Case, Edit, LAST_FRAME},
    memory,
};
use crate::{
    significance, soundness,
    things::{despawn, insert_pictures, remove_pictures, spawn, spawn_everything},
};

/// Frames in which a scene must be loaded, built and compiled.
const PATIENCE: u32 = 200;
/// Restarts of each of the two techniques that are compared.
pub const RESTARTS: u32 = 16;
/// Bounces of techniques that are compared: more only make paths longer.
const MOST_BOUNCES: u32 = 3;
/// Frames until the counters of a frame have arrived from the GPU.
const LATE: u32 = 3;
/// Frames after which nothing of a case that has ended may be left.
const CLEARING: u32 = 16;
/// Tables that need not become shorter: slots are kept for later use, and the tree over instances at rest is built after 64 frames.
const NOT_CLEARED: [&str; 4] = ["slots of instances", "slots of materials", "nodes", "instances at rest"];

/// Settings that are unbiased and have few bounces, and otherwise are the given ones.
fn unbiased(settings: &Restir) -> Restir {
    let technique = settings.technique;
    let most = if technique.has_indirect_light() { MOST_BOUNCES } else { 1 };
    let bounces = settings.bounces.min(most);
    let mut settings = Restir { bounces, firefly_limit: 0.0, denoiser: Denoiser::OFF, ..settings.clone() };
    if technique == Technique::Bdpt {
        // Without jitter, light paths alone are averaged over a pixel.
        settings.jitter = Jitter::Always;
    }
    settings.direct.bsdf_candidate = true;
    settings.direct.bias_correction = BiasCorrection::HeuristicsAndUnbiasedMis;
    settings.direct.visibility = VisibilityReuse::Resampled;
    settings.bdpt.mis = ShiftedMis::Exact;
    settings.paths.suffix_retrace = SuffixRetrace::BothWays;
    settings.paths.assume_diffuse_secondary = false;
    settings.paths.decorrelation = 0.0;
    for reuse in [&mut settings.direct.reuse, &mut settings.paths.reuse, &mut settings.subsurface.reuse] {
        // Short means with these weights look dark, although they are unbiased.
        if reuse.mis == Mis::OneOverZ {
            reuse.mis = Mis::Balance;
        }
    }
    settings
}

pub struct Stage {
    app: App,
    /// Entities that the last case has spawned.
    spawned: Vec<Entity>,
    /// The scene always has each feature.
    everything: bool,
    /// Histories restart when the scene of a case is ready, so that another app draws the same random numbers however long it waits.
    restarts: bool,
    /// Lengths of the plugin's tables without a case, where the scene has each feature.
    empty: Option<Vec<(&'static str, usize)>>,
}

impl Stage {
    /// `everything`: the scene always has an object or a light with each feature, so that shaders are compiled once.  `restarts`: histories
    /// restart when a scene is ready.
    pub fn new(size: UVec2, everything: bool, backend: RayBackend, restarts: bool) -> Result<Self, String> {
        let mut app = headless::app(Path::new("."), backend)?;
        check_mirror(&mut app, true);
        let setup = CameraSetup { size, exposure: unit_exposure(), environment: None, settings: Restir::default() };
        let place = (Transform::default(), Projection::default());
        scene::spawn_camera(app.world_mut(), place, setup);
        if everything {
            spawn_everything(app.world_mut());
        }
        Ok(Self { app, spawned: Vec::new(), everything, restarts, empty: None })
    }

    /// The first requirement of ray queries that the device does not meet.
    pub fn missing_for_ray_queries(&self) -> Option<&'static str> {
        ray_query::missing(self.app.world().resource::<RenderDevice>())
    }

    /// The present settings of the camera.
    pub fn settings(&self) -> Result<Restir, String> {
        let world = self.app.world();
        world.get::<Restir>(world.resource::<View>().camera).cloned().ok_or("the camera is gone".into())
    }

    /// Renders a case and returns the mean radiance of the pixels of its last frame.
    pub fn run(&mut self, case: &Case) -> Result<Vec<[f32; 3]>, String> {
        self.set_up(case);
        if self.everything && self.empty.is_none() {
            self.until_ready()?;
            self.empty = Some(table_lengths(&self.app));
        }
        self.spawned = case.things.iter().map(|thing| spawn(self.app.world_mut(), thing)).collect();
        self.until_ready()?;
        if self.restarts {
            self.restart()?;
        }
        for number in 1..=LAST_FRAME {
            for (_, edit) in case.edits.iter().filter(|(frame, _)| *frame == number) {
                self.edit(edit);
            }
            self.frame()?;
        }
        self.app.world().resource::<View>().capture.request();
        self.frame()?;
        let picture: Vec<[f32; 3]> = captured(&self.app)?.mean().collect();
        if let Some(pixel) = picture.iter().flatten().find(|c| !c.is_finite() || **c < 0.0) {
            return Err(format!("a pixel is {pixel}"));
        }
        self.counters()?;
        Ok(picture)
    }

    /// Restarts the history of the camera in the next frame.
    fn restart(&mut self) -> Result<(), String> {
        let camera = self.app.world().resource::<View>().camera;
        self.app.world_mut().get_mut::<Restir>(camera).ok_or("the camera is gone")?.reset = true;
        Ok(())
    }

    /// Removes everything of the case, and fails if the plugin keeps something of it.
    pub fn clear(&mut self) -> Result<(), String> {
        let world = self.app.world_mut();
        for entity in self.spawned.drain(..) {
            despawn(world, entity);
        }
        let camera = world.resource::<View>().camera;
        world.entity_mut(camera).remove::<RestirEnvironment>();
        remove_pictures(world);
        let mut left = None;
        for _ in 0..CLEARING {
            self.frame()?;
            left = self.left_over();
            if left.is_none() {
                return Ok(());
            }
        }
        left.map_or(Ok(()), Err)
    }

    /// A table that is longer than without a case.
    fn left_over(&self) -> Option<String> {
        let before = self.empty.as_ref()?;
        let now = table_lengths(&self.app);
        let mut longer = before.iter().zip(&now).filter(|((_, before), (_, now))| now > before);
        let ((name, before), (_, now)) = longer.find(|((name, _), _)| !NOT_CLEARED.contains(name))?;
        Some(format!("the case leaves something in a table ({name}): {before} entries have become {now}"))
    }

    /// Waits for the counters of the last frame, and fails where they count a fault, or where the plugin has other memory than it states.
    pub fn counters(&mut self) -> Result<(), String> {
        for _ in 0..LATE {
            self.frame()?;
        }
        let world = self.app.world();
        let report = world.resource::<RestirStatistics>().report();
        let fault = soundness::fault(&report);
        fault.or_else(|| memory::difference(world.resource::<RenderDevice>(), &report)).map_or(Ok(()), Err)
    }

    /// Compares the scene that the case has left with the reference tracer, by the settings of a preset and by those of the case.
    pub fn compare(&mut self, case: &Case) -> Result<(), String> {
        let Restir { technique, bounces, .. } = case.settings;
        let preset = Restir { technique, bounces, ..Restir::preset(Preset::Unbiased) };
        self.compare_settings(unbiased(&preset), "the preset")?;
        self.compare_settings(unbiased(&case.settings), "its own settings")
    }

    fn compare_settings(&mut self, settings: Restir, name: &str) -> Result<(), String> {
        let technique = settings.technique;
        let ours = self.means(&settings, 0)?;
        self.counters()?;
        let reference = self.means(&Restir { technique: Technique::Reference, ..settings }, 0)?;
        self.counters()?;
        let is_finite = |means: &[f64]| means.iter().all(|mean| mean.is_finite());
        if is_finite(&reference) && !is_finite(&ours) {
            return Err(format!(
                "{technique:?} with {name} has a mean that is not finite, unlike the reference: {ours:?}"
            ));
        }
        let (errors, limit) = (significance::difference(&reference, &ours), significance::limit(2 * RESTARTS as usize));
        match errors.abs() > limit {
            true => Err(format!(
                "{technique:?} with {name} differs from the reference by {errors:+.1} standard errors of at most {limit:.1}: {ours:?}, {reference:?}"
            )),
            false => Ok(()),
        }
    }

    /// Mean radiance of some frames after each of some restarts, whose seeds begin with `first`.
    pub fn means(&mut self, settings: &Restir, first: u32) -> Result<Vec<f64>, String> {
        let camera = self.app.world().resource::<View>().camera;
        let mut means = Vec::new();
        for seed in first..first + RESTARTS {
            let settings = Restir { seed, accumulate: true, reset: true, ..settings.clone() };
            self.app.world_mut().entity_mut(camera).insert(settings);
            if seed == first {
                self.until_ready()?;
                self.restart()?;
            }
            for _ in 1..LAST_FRAME {
                self.frame()?;
            }
            self.app.world().resource::<View>().capture.request();
            self.frame()?;
            let picture = captured(&self.app)?;
            let sum: f64 = picture.mean().flatten().map(f64::from).sum();
            means.push(sum / f64::from(3 * picture.size.x * picture.size.y));
        }
        Ok(means)
    }

    fn until_ready(&mut self) -> Result<(), String> {
        // A change is extracted in the first frame and reported in the second.
        self.frame()?;
        for _ in 0..PATIENCE {
            self.frame()?;
            let report = self.app.world().resource::<RestirStatistics>().report();
            if report.ready && report.samples > 0 {
                return Ok(());
            }
        }
        Err(format!("the scene is not ready after {PATIENCE} frames"))
    }

    pub fn has_failed(&self) -> bool {
        headless::alive(&self.app).is_err()
    }

    fn frame(&mut self) -> Result<(), String> {
        frame(&mut self.app);
        soundness::beat();
        // A panic in a task ends that task only, so the app does not report it.
        match panics::take() {
            Some(panic) => Err(panic),
            None => headless::alive(&self.app),
        }
    }

    /// Prepares the camera and the pictures of a case.
    fn set_up(&mut self, case: &Case) {
        let world = self.app.world_mut();
        // A case that has failed is still there.
        for entity in self.spawned.drain(..) {
            despawn(world, entity);
        }
        insert_pictures(world);
        let camera = world.resource::<View>().camera;
        scene::resize(world, camera, case.size);
        let mut camera = world.entity_mut(camera);
        camera.insert((case.camera.0, case.camera.1.clone(), Restir { reset: true, ..case.settings.clone() }));
        match &case.environment {
            Some(environment) => camera.insert(environment.clone()),
            None => camera.remove::<RestirEnvironment>(),
        };
        world.resource::<RestirStatistics>().reset_guards();
    }

    fn edit(&mut self, edit: &Edit) {
        let world = self.app.world_mut();
        let camera = world.resource::<View>().camera;
        match edit {
            Edit::MoveCamera(to) => _ = world.entity_mut(camera).insert(*to),
            Edit::Environment(environment) => _ = world.entity_mut(camera).insert(environment.clone()),
            Edit::Settings(settings) => _ = world.entity_mut(camera).insert((**settings).clone()),
            Edit::Move(thing, to) => {
                if let Ok(mut thing) = world.get_entity_mut(self.spawned[*thing]) {
                    thing.insert(*to);
                }
            }
            Edit::Resize(size) => scene::resize(world, camera, *size),
            Edit::Despawn(thing) => despawn(world, self.spawned[*thing]),
            Edit::Pose(thing, joints, weights) => {
                let body = self.spawned[*thing];
                skinned::set_joints(world, body, joints);
                if let Some(mut morph) = world.get_mut::<MeshMorphWeights>(body) {
                    *morph = MeshMorphWeights::Value { weights: weights.to_vec() };
                }
            }
            Edit::Paint(thing, material) => {
                let entity = self.spawned[*thing];
                let painted = world.get::<MeshMaterial3d<StandardMaterial>>(entity).map(|painted| painted.id());
                if let Some(id) = painted
                    && let Some(mut asset) = world.resource_mut::<Assets<StandardMaterial>>().get_mut(id)
                {
                    *asset = (**material).clone();
                }
            }
        }
    }
}
