//! Techniques held against the reference of as many bounces.

use super::{
    app::*,
    direct::{STEPS, both},
    equivalence::{Length, Restarts},
};
use bevy_restir::{Direct, Paths, Restir, Technique};
use std::time::Instant;

/// What is held against the reference.
pub trait Subject {
    fn ask(&self, settings: &mut Restir);
}

impl Subject for Direct {
    fn ask(&self, settings: &mut Restir) {
        (settings.technique, settings.direct) = (Technique::Di, self.clone());
    }
}

impl Subject for Paths {
    fn ask(&self, settings: &mut Restir) {
        (settings.technique, settings.paths, settings.direct) = (Technique::Pt, self.clone(), both());
    }
}

/// Direct and indirect light apart.
pub struct Indirect(pub Direct, pub Paths);

impl Subject for Indirect {
    fn ask(&self, settings: &mut Restir) {
        (settings.technique, settings.direct, settings.paths) = (Technique::Gi, self.0.clone(), self.1.clone());
    }
}

/// Either technique of all light.
pub enum AllLight {
    Pt(Paths),
    Gi(Direct, Paths),
}

impl Subject for AllLight {
    fn ask(&self, settings: &mut Restir) {
        match self {
            Self::Pt(paths) => paths.ask(settings),
            Self::Gi(direct, paths) => Indirect(direct.clone(), paths.clone()).ask(settings),
        }
    }
}

/// How the techniques of a scene are held against its reference.
#[derive(Clone, Copy)]
pub struct Proof<'a> {
    pub ours: Length,
    pub truth: Length,
    /// Relative difference of the images that is allowed.
    pub margin: f64,
    /// Chance decides whether the camera sees an emitter, so that each restart has an emission of its own.
    pub blended: bool,
    /// Scattering events of a path.
    pub bounces: u32,
    /// Where things are at a step of a motion; a restart is its last frame.
    pub pose: Option<&'a dyn Fn(&mut Rig, u32)>,
}

impl Proof<'static> {
    /// Of a small scene at rest without much noise.
    pub const DEFAULT: Self = Self {
        ours: Length { restarts: 40, frames: 8 },
        truth: Length { restarts: 40, frames: 64 },
        margin: 0.01,
        blended: false,
        bounces: 1,
        pose: None,
    };

    /// Of so many restarts and frames of direct lighting and of the reference.
    pub const fn of(ours: (u32, u32), truth: (u32, u32)) -> Self {
        let ours = Length { restarts: ours.0, frames: ours.1 };
        let truth = Length { restarts: truth.0, frames: truth.1 };
        Self { ours, truth, ..Self::DEFAULT }
    }
}

impl Proof<'_> {
    /// Holds techniques against the reference of one scene; one that fails is run once more on other seeds.
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
            subject.ask(r);
        });
        match self.pose {
            None => collect(emissions, pictures(rig, first_seed, self.ours)),
            Some(pose) => collect(emissions, last_frames(rig, first_seed, self.ours.restarts, pose)),
        }
    }

    /// One for all restarts, or one for each.
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

/// A picture a restart: the mean of its frames.
fn pictures(rig: &mut Rig, first_seed: u32, length: Length) -> impl Iterator<Item = Picture> {
    rig.set(|r| r.accumulate = true);
    rig.until_ready();
    (0..length.restarts).map(move |i| {
        // Another seed forgets what was gathered.
        rig.set(|r| r.seed = first_seed + i);
        rig.frames(length.frames - 1);
        let picture = rig.next();
        assert_eq!(picture.samples, length.frames);
        picture
    })
}

/// A picture a restart: the last frame of the motion.
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

/// What the camera sees emit, in any technique: it would hide errors of the light that is scattered.
pub fn emission(rig: &mut Rig) -> Picture {
    rig.set(|r| (r.technique, r.bounces, r.seed) = (Technique::Reference, 0, 1));
    let picture = rig.picture(1);
    rig.set(|r| r.bounces = 1);
    picture
}
