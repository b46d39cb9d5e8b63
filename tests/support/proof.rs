//! Compares the pictures of a technique with those of the reference at the same number of bounces.

use super::{
    app::*,
    equivalence::{Length, Restarts},
    reuse_settings::di,
    small_scenes::STEPS,
};
use bevy_restir::{Direct, Paths, Research, Restir, SubsurfaceSampling, Technique, testing::plant_shader_defs};
use std::time::Instant;

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

impl Subject for (Direct, Research) {
    fn apply_to(&self, settings: &mut Restir) {
        self.0.apply_to(settings);
        settings.research = self.1.clone();
    }
}

impl Subject for (Direct, SubsurfaceSampling) {
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

/// How the techniques of a scene are compared with its reference.
#[derive(Clone, Copy)]
pub struct Proof<'a> {
    pub ours: Length,
    pub truth: Length,
    /// The relative difference of image means that is allowed.
    pub margin: f64,
    /// The camera sees an emitter with some probability only (alpha blending), so that each restart has its own emission.
    pub blended: bool,
    /// The number of scattering events of a path.
    pub bounces: u32,
    /// Poses the scene at a step of a motion.  A restart is then the last frame of the motion.
    pub pose: Option<&'a dyn Fn(&mut Rig, u32)>,
}

impl Proof<'static> {
    /// For a small still scene without much noise.
    pub const DEFAULT: Self = Self {
        ours: Length { restarts: 40, frames: 8 },
        truth: Length { restarts: 40, frames: 64 },
        margin: 0.01,
        blended: false,
        bounces: 1,
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
    /// Asserts that techniques equal the reference.  One that fails is run once more with other seeds.
    pub fn check(&self, name: &str, rig: &mut Rig, techniques: &[(&str, impl Subject)]) {
        let start = Instant::now();
        let reference = self.truth(rig, 1000);
        eprintln!("{name}, reference: {:.1} s", start.elapsed().as_secs_f64());
        for (what, subject) in techniques {
            let start = Instant::now();
            let first = self.resampled(rig, subject, 2000).compare(&reference, self.margin);
            eprintln!("{name}, {what}: {first}, {:.1} s", start.elapsed().as_secs_f64());
            if !first.is_equal() {
                let again = self.truth(rig, 3000);
                let second = self.resampled(rig, subject, 4000).compare(&again, self.margin);
                eprintln!("{name}, {what}, again: {second}");
                assert!(second.is_equal(), "{name}, {what}: {first}, then {second}");
            }
        }
        rig.assert_sound();
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

    /// Makes one in 25 reservoirs NaN in every frame, whatever its content.  Asserts that the picture is noisier and not darker, and that
    /// no NaN is left in the history once the errors stop.
    pub fn survives_nan(&self, rig: &mut Rig, subjects: &[impl Subject]) {
        let reference = self.truth(rig, 1000);
        plant_shader_defs(&mut rig.app, &["PLANT_NAN"]);
        for subject in subjects {
            let found = self.resampled(rig, subject, 5000).compare(&reference, self.margin);
            eprintln!("NaN in reservoirs: {found}");
            assert!(found.tost < 0.01, "{found}");
            rig.assert_sound();
        }
        plant_shader_defs(&mut rig.app, &[]);
        rig.frames(3);
        assert!(rig.next().is_finite());
        rig.assert_sound();
    }

    /// Restarts of the reference.
    pub fn truth(&self, rig: &mut Rig, first_seed: u32) -> Restarts {
        if let Some(pose) = self.pose {
            pose(rig, STEPS);
        }
        let emissions = self.emissions(rig, first_seed, self.truth);
        rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, self.bounces));
        collect(emissions, pictures(rig, first_seed, self.truth))
    }

    /// Restarts of a technique: the mean of all frames from the reset on, or the last frame of the motion.
    pub fn resampled(&self, rig: &mut Rig, subject: &impl Subject, first_seed: u32) -> Restarts {
        if let Some(pose) = self.pose {
            pose(rig, STEPS);
        }
        let emissions = self.emissions(rig, first_seed, self.ours);
        rig.set(|r| {
            r.bounces = self.bounces;
            subject.apply_to(r);
        });
        match self.pose {
            None => collect(emissions, pictures(rig, first_seed, self.ours)),
            Some(pose) => collect(emissions, last_frames(rig, first_seed, self.ours.restarts, pose)),
        }
    }

    /// The emission that the camera sees: one picture for all restarts, or one for each.
    fn emissions(&self, rig: &mut Rig, first_seed: u32, length: Length) -> Vec<Picture> {
        if !self.blended {
            return vec![emission(rig)];
        }
        rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, 0));
        pictures(rig, first_seed, length).collect()
    }
}

fn collect(emissions: Vec<Picture>, pictures: impl Iterator<Item = Picture>) -> Restarts {
    let mut restarts = Restarts::default();
    for (i, picture) in pictures.enumerate() {
        restarts.add(&picture, &emissions[i % emissions.len()]);
    }
    restarts
}

/// One picture for each restart: the mean of its frames.
fn pictures(rig: &mut Rig, first_seed: u32, length: Length) -> impl Iterator<Item = Picture> {
    rig.set(|r| r.accumulate = true);
    rig.until_ready();
    (0..length.restarts).map(move |i| {
        // A change of the seed resets the history.
        rig.set(|r| r.seed = first_seed + i);
        rig.frames(length.frames - 1);
        let picture = rig.next();
        assert_eq!(picture.samples, length.frames);
        picture
    })
}

/// One picture for each restart: the last frame of the motion.
fn last_frames(
    rig: &mut Rig,
    first_seed: u32,
    restarts: u32,
    pose: &dyn Fn(&mut Rig, u32),
) -> impl Iterator<Item = Picture> {
    rig.set(|r| r.accumulate = false);
    rig.until_ready();
    (0..restarts).map(move |i| {
        rig.set(|r| r.seed = first_seed + i);
        for step in 0..STEPS {
            pose(rig, step);
            rig.frame();
        }
        pose(rig, STEPS);
        rig.next()
    })
}

/// The emission that the camera sees directly.  It is the same in all techniques and would hide errors of the scattered light.
pub fn emission(rig: &mut Rig) -> Picture {
    rig.set(|r| (r.technique, r.bounces, r.seed) = (Technique::Reference, 0, 1));
    let picture = rig.picture(1);
    rig.set(|r| r.bounces = 1);
    picture
}
