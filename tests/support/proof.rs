//! Compares the pictures of a technique with those of the reference at the same number of bounces.

use super::{
    app::*,
    equivalence::{Comparison, Length, Restarts},
    proof_rows::record,
    reuse_settings::di,
    small_scenes::STEPS,
};
use bevy::math::Vec3;
use bevy_restir::{
    Denoiser, Direct, Jitter, LightTechniques, Paths, Preset, Research, Restir, ShiftedMis, SubsurfaceSampling,
    Technique, testing::plant_shader_defs,
};
use std::{
    collections::HashMap,
    sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError},
    time::Instant,
};

/// Settings that are compared with the reference.
pub trait Subject {
    /// Writes them, and their technique, to the settings of the camera.
    fn apply_to(&self, settings: &mut Restir);
}

impl Subject for Direct {
    fn apply_to(&self, settings: &mut Restir) {
        (settings.technique, settings.direct) = (Technique::Di, self.clone());
    }
}

impl<S: Subject + ?Sized> Subject for &S {
    fn apply_to(&self, settings: &mut Restir) {
        (*self).apply_to(settings);
    }
}

impl Subject for (Direct, Research) {
    fn apply_to(&self, settings: &mut Restir) {
        self.0.apply_to(settings);
        settings.research = self.1.clone();
    }
}

impl<S: Subject> Subject for (S, SubsurfaceSampling) {
    fn apply_to(&self, settings: &mut Restir) {
        self.0.apply_to(settings);
        settings.subsurface = self.1.clone();
    }
}

impl Subject for Paths {
    fn apply_to(&self, settings: &mut Restir) {
        (settings.technique, settings.paths, settings.direct) = (Technique::Pt, self.clone(), di::all_reuse());
    }
}

/// ReSTIR DI with ReSTIR GI.
pub struct Indirect(pub Direct, pub Paths);

impl Subject for Indirect {
    fn apply_to(&self, settings: &mut Restir) {
        (settings.technique, settings.direct, settings.paths) = (Technique::Gi, self.0.clone(), self.1.clone());
    }
}

/// ReSTIR BDPT.
pub struct Bidirectional(pub LightTechniques, pub Paths);

impl Subject for Bidirectional {
    fn apply_to(&self, settings: &mut Restir) {
        self.1.apply_to(settings);
        (settings.technique, settings.bdpt.techniques) = (Technique::Bdpt, self.0);
    }
}

impl Subject for (ShiftedMis, Bidirectional) {
    fn apply_to(&self, settings: &mut Restir) {
        self.1.apply_to(settings);
        settings.bdpt.mis = self.0;
    }
}

impl Subject for (f32, Bidirectional) {
    fn apply_to(&self, settings: &mut Restir) {
        self.1.apply_to(settings);
        settings.bdpt.light_paths = self.0;
    }
}

/// A technique with an unchanged preset: with jitter, energy compensation and the bounces of the preset.  Single frames, which proofs in
/// motion compare, are neither limited nor filtered.
pub struct Shipped(pub Technique, pub Preset);

impl Subject for Shipped {
    fn apply_to(&self, settings: &mut Restir) {
        let Restir { seed, accumulate, .. } = *settings;
        // Single frames, too, have the jitter that the reference has.
        let jitter = Jitter::Always;
        let (technique, firefly_limit, denoiser) = (self.0, 0.0, Denoiser::OFF);
        *settings = Restir { technique, seed, accumulate, jitter, firefly_limit, denoiser, ..Restir::preset(self.1) };
    }
}

/// Either of the two techniques that render a complete picture.
pub enum AllLight {
    Pt(Paths),
    Gi(Direct, Paths),
}

impl Subject for AllLight {
    fn apply_to(&self, settings: &mut Restir) {
        match self {
            Self::Pt(paths) => paths.apply_to(settings),
            Self::Gi(direct, paths) => Indirect(direct.clone(), paths.clone()).apply_to(settings),
        }
    }
}

/// The restarts of a reference.  When a technique fails, more of them are rendered, but only once.
pub struct Growing {
    pub restarts: Restarts,
    has_grown: bool,
}

impl Growing {
    pub fn new(restarts: Restarts) -> Self {
        Self { restarts, has_grown: false }
    }

    fn grow(&mut self, further: impl FnOnce() -> Restarts) {
        if !std::mem::replace(&mut self.has_grown, true) {
            self.restarts.append(further());
        }
    }
}

/// References of shared scenes by everything that they depend on.  A test waits while another renders the one that it needs.
static SHARED_TRUTHS: LazyLock<Mutex<HashMap<String, Arc<OnceLock<Restarts>>>>> = LazyLock::new(Mutex::default);

/// The seed of the first restart of a proof or of another statistical test.  `PROOF_SEED` shifts all of these seeds; `./run test --full` sets
/// it to another number in each run.
pub fn first_seed(seed: u32) -> u32 {
    let offset = std::env::var("PROOF_SEED").ok().and_then(|text| text.parse::<u32>().ok()).unwrap_or(0);
    seed.wrapping_add(offset.wrapping_mul(1_000_003))
}

/// How the techniques of a scene are compared with its reference.
#[derive(Clone, Copy)]
pub struct Proof<'a> {
    pub ours: Length,
    pub truth: Length,
    /// The relative difference of image means that is allowed.
    pub margin: f64,
    /// The camera sees an emitter with some probability only (alpha blending), so that each restart has its own emission.
    pub blended: bool,
    /// Leaves out the pixels that see an emitter, and those beside them: in frames with jitter, the edges of a lamp have more noise than all
    /// other light.
    pub without_emitters: bool,
    /// The number of scattering events of a path.
    pub bounces: u32,
    /// The number of frames that each restart of the technique renders before those that count.
    pub warm_up: u32,
    /// Poses the scene at a step of a motion.  A restart is then the last frame of the motion; a length of several frames repeats the motion.
    pub pose: Option<&'a dyn Fn(&mut Rig, u32)>,
}

impl Proof<'static> {
    /// For a small still scene without much noise.
    pub const DEFAULT: Self = Self {
        ours: Length { restarts: 10, frames: 8 },
        truth: Length { restarts: 12, frames: 64 },
        margin: 0.01,
        blended: false,
        without_emitters: false,
        bounces: 1,
        warm_up: 0,
        pose: None,
    };

    /// (restarts, frames) of the technique and of the reference.
    pub const fn of(ours: (u32, u32), truth: (u32, u32)) -> Self {
        let ours = Length { restarts: ours.0, frames: ours.1 };
        let truth = Length { restarts: truth.0, frames: truth.1 };
        Self { ours, truth, ..Self::DEFAULT }
    }
}

impl Proof<'_> {
    /// Asserts that techniques equal the reference.  A technique that fails goes on to four times the length: all of its restarts, and all
    /// of those of the reference, are then judged once.  A proof without enough power fails, too.
    pub fn check(&self, name: &str, rig: &mut Rig, techniques: &[(&str, impl Subject)]) {
        let start = Instant::now();
        let mut reference = Growing::new(self.truth(rig, 1000));
        eprintln!("{name}, reference: {:.1} s", start.elapsed().as_secs_f64());
        for (what, subject) in techniques {
            let start = Instant::now();
            let (result, first) = self.judge(rig, subject, &mut reference, |first| {
                eprintln!("{name}, {what}: {first}: goes on to four times the length");
            });
            eprintln!("{name}, {what}: {result}, {:.1} s", start.elapsed().as_secs_f64());
            record(name, what, self.margin, &result, first.as_ref());
            result.assert_equal(&format!("{name}, {what}"));
        }
        rig.assert_sound();
    }

    /// Compares a technique with the reference.  Returns the comparison that counts and, if the first length failed, that failure.
    pub fn judge(
        &self,
        rig: &mut Rig,
        subject: &impl Subject,
        reference: &mut Growing,
        on_failure: impl FnOnce(&Comparison),
    ) -> (Comparison, Option<Comparison>) {
        let mut ours = self.resampled(rig, subject, 2000);
        let first = ours.compare(&reference.restarts, self.margin);
        if !first.is_undecided() {
            return (first, None);
        }
        on_failure(&first);
        let further = self.times(3);
        reference.grow(|| further.truth(rig, 10_000));
        ours.append(further.resampled(rig, subject, 20_000));
        (ours.compare(&reference.restarts, self.margin), Some(first))
    }

    /// This proof with more restarts.
    fn times(&self, factor: u32) -> Self {
        let more = |length: Length| Length { restarts: factor * length.restarts, ..length };
        Self { ours: more(self.ours), truth: more(self.truth), ..*self }
    }

    /// Asserts that each planted error makes its technique differ from the reference.
    pub fn finds<S: Subject>(
        &self,
        rig: &mut Rig,
        reference: &Restarts,
        planted: impl IntoIterator<Item = (&'static str, S)>,
    ) {
        for (plant, subject) in planted {
            plant_shader_defs(&mut rig.app, &[plant]);
            let found = self.resampled(rig, &subject, 5000).compare(reference, 0.01);
            eprintln!("{plant}: {found}");
            assert!(found.is_different(), "{plant} is not found: {found}");
        }
    }

    /// Breaks one in 25 reservoirs of the history in every frame by NaN, infinities and -1.  Asserts that the mean of the picture stays,
    /// that the guard of reservoirs and no other one is raised, and that all numbers are sound again once the errors stop.
    pub fn survives_nan(&self, rig: &mut Rig, subjects: &[impl Subject]) {
        let reference = self.truth(rig, 1000);
        rig.assert_sound();
        plant_shader_defs(&mut rig.app, &["PLANT_NAN"]);
        for subject in subjects {
            let found = self.resampled(rig, subject, 5000).compare(&reference, self.margin);
            eprintln!("NaN in reservoirs: {found}");
            assert!(found.tost < 0.01, "{found}");
            rig.assert_raised(&["reservoir"]);
        }
        plant_shader_defs(&mut rig.app, &[]);
        rig.until_ready();
        rig.frames(3);
        rig.reset_guards();
        assert!(rig.next().is_finite());
        rig.assert_sound();
    }

    /// Restarts of the reference, from [`first_seed`] of this seed on; those of a shared scene are rendered once in a process.
    pub fn truth(&self, rig: &mut Rig, seed: u32) -> Restarts {
        let seed = first_seed(seed);
        let Some(scene) = &rig.shared else { return self.render_truth(rig, seed) };
        let settings = rig.app.world().get::<Restir>(rig.camera).expect("the camera has settings");
        let (jitter, compensation) = (settings.jitter, settings.energy_compensation);
        let size = rig.size();
        let key = format!(
            "{scene} {size} {} {:?} {seed} {} {} {} {jitter:?} {compensation}",
            self.bounces,
            self.truth,
            self.blended,
            self.without_emitters,
            self.pose.is_some()
        );
        let shared = SHARED_TRUTHS.lock().unwrap_or_else(PoisonError::into_inner).entry(key).or_default().clone();
        shared.get_or_init(|| self.render_truth(rig, seed)).clone()
    }

    fn render_truth(&self, rig: &mut Rig, first_seed: u32) -> Restarts {
        if let Some(pose) = self.pose {
            pose(rig, STEPS);
        }
        let emissions = self.emissions(rig, first_seed, self.truth);
        rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, self.bounces));
        self.collect(emissions, pictures(rig, first_seed, 0, self.truth))
    }

    /// Restarts of a technique, from [`first_seed`] of this seed on: the mean of all frames from the reset on, or the last frame of the motion.
    pub fn resampled(&self, rig: &mut Rig, subject: &impl Subject, seed: u32) -> Restarts {
        let seed = first_seed(seed);
        if let Some(pose) = self.pose {
            pose(rig, STEPS);
        }
        let emissions = self.emissions(rig, seed, self.ours);
        rig.set(|r| {
            r.bounces = self.bounces;
            subject.apply_to(r);
        });
        match self.pose {
            None => self.collect(emissions, pictures(rig, seed, self.warm_up, self.ours)),
            Some(pose) => self.collect(emissions, last_frames(rig, seed, self.warm_up, self.ours, pose)),
        }
    }

    /// The emission that the camera sees: one picture for all restarts, or one for each.
    fn emissions(&self, rig: &mut Rig, first_seed: u32, length: Length) -> Vec<Picture> {
        if !self.blended {
            return vec![emission(rig)];
        }
        rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, 0));
        pictures(rig, first_seed, 0, length).collect()
    }

    fn collect(&self, emissions: Vec<Picture>, pictures: impl Iterator<Item = Picture>) -> Restarts {
        let mut restarts = Restarts::default();
        for (i, mut picture) in pictures.enumerate() {
            let emission = &emissions[i % emissions.len()];
            if self.without_emitters {
                leave_out_emitters(&mut picture, emission);
            }
            restarts.add(&picture, emission);
        }
        restarts
    }
}

/// Gives each pixel that sees an emitter, or has a neighbor that does, the value of the emission, so that it has no scattered light.
pub fn leave_out_emitters(picture: &mut Picture, emission: &Picture) {
    let size = emission.size;
    let emits = |x: u32, y: u32| emission.at(x, y) != Vec3::ZERO;
    for y in 0..size.y {
        for x in 0..size.x {
            let rows = y.saturating_sub(1)..=(y + 1).min(size.y - 1);
            if rows.into_iter().any(|y| (x.saturating_sub(1)..=(x + 1).min(size.x - 1)).any(|x| emits(x, y))) {
                let i = (y * size.x + x) as usize;
                picture.pixels[i] = emission.pixels[i];
            }
        }
    }
}

/// One picture for each restart: the mean of its frames after those that warm up its history.
fn pictures(rig: &mut Rig, first_seed: u32, warm_up: u32, length: Length) -> impl Iterator<Item = Picture> {
    rig.set(|r| r.accumulate = true);
    rig.until_ready();
    (0..length.restarts).map(move |i| {
        // A change of the seed resets the history; a change of `accumulate` resets the mean only.
        rig.set(|r| (r.seed, r.accumulate) = (first_seed + i, warm_up == 0));
        rig.frames(warm_up);
        rig.set(|r| r.accumulate = true);
        rig.frames(length.frames - 1);
        let picture = rig.next();
        assert_eq!(picture.samples, length.frames);
        picture
    })
}

/// One picture for each restart: the last frame of the motion, or the mean of several last frames if the motion is repeated.
fn last_frames(
    rig: &mut Rig,
    first_seed: u32,
    warm_up: u32,
    length: Length,
    pose: &dyn Fn(&mut Rig, u32),
) -> impl Iterator<Item = Picture> {
    rig.set(|r| r.accumulate = false);
    rig.until_ready();
    (0..length.restarts).map(move |i| {
        rig.set(|r| r.seed = first_seed + i);
        for frame in 0..warm_up {
            pose(rig, frame % (STEPS + 1));
            rig.frame();
        }
        let last = (0..length.frames).map(|_| {
            for step in 0..STEPS {
                pose(rig, step);
                rig.frame();
            }
            pose(rig, STEPS);
            rig.next()
        });
        Picture::mean_of(last)
    })
}

/// The emission that the camera sees directly.  It is the same in all techniques and would hide errors of the scattered light.
pub fn emission(rig: &mut Rig) -> Picture {
    rig.set(|r| (r.technique, r.bounces, r.seed) = (Technique::Reference, 0, 1));
    let is_jittered = rig.get_mut::<Restir>(rig.camera).jitter != Jitter::Never;
    let picture = rig.picture(if is_jittered { 64 } else { 1 });
    rig.set(|r| r.bounces = 1);
    picture
}
