//! Edits in every frame cost no history: after 60 frames of them, frames have the error of the same scene at rest, and on average the light
//! of the reference.
//!
//! The error of a frame is the mean over pixels of the squared difference from the reference, relative to the square of its light.  It is
//! compared in the pixels whose light the edits leave as it is: elsewhere, light that is new has no history by its nature.  A sky that turns
//! changes all pixels, so it is compared in all of them, while it turns by 1 degree a frame.

use crate::support::{
    app::*,
    equivalence::{Length, Restarts},
    proof::{Proof, emission, first_seed, leave_out_emitters},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Denoiser, Jitter, Restir, RestirEnvironment, Technique};
use core::f32::consts::TAU;
use std::time::Instant;

const SIZE: u32 = 24;
/// Frames of edits before the first frame that is compared.
const HISTORY: u32 = 60;
/// Frames after which the edits repeat.
const PERIOD: u32 = 12;
/// The largest error of edited frames, relative to that of frames at rest.
const LIMIT: f64 = 1.1;
/// The largest standard error of that ratio.
const PRECISION: f64 = 0.04;
/// The largest relative change of a pixel whose light counts as unchanged.
const UNCHANGED: f32 = 0.05;
const SPOT: f32 = 30.0;
const TURN_OF_SKY: f32 = 0.7;

/// What is edited before each frame.  At the last step of a period, the scene is that at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Edits {
    None,
    /// A cube is spawned and despawned in turn.
    Cube,
    /// The material of a board pulses.
    Material,
    /// The sky turns to and fro.
    Sky,
    /// A spot light dims to zero and back.
    Lamp,
    /// A planted error: the history restarts in the middle of each period.
    Restarts,
}

impl Edits {
    /// Steps at which the scene differs most from that at rest.
    fn extremes(self) -> &'static [u32] {
        match self {
            Self::None | Self::Sky | Self::Restarts => &[],
            Self::Cube => &[1],
            Self::Material => &[PERIOD / 4, 3 * PERIOD / 4],
            Self::Lamp => &[PERIOD / 2],
        }
    }
}

struct Stage {
    rig: Rig,
    cube: (Mesh3d, MeshMaterial3d<StandardMaterial>, Transform),
    /// The cube, while it is there.
    there: Option<Entity>,
    board: Handle<StandardMaterial>,
    spot: Entity,
}

impl Stage {
    fn new(technique: Technique) -> Option<Self> {
        let mut rig = scene(SIZE, |rig| surrounded(rig, true))?;
        let (mesh, material) = (rig.add::<Mesh>(Cuboid::from_length(0.3)), rig.add::<StandardMaterial>(lambert(0.7)));
        let cube = (Mesh3d(mesh), MeshMaterial3d(material), Transform::from_xyz(1.1, -1.05, 0.8));
        let board = rig.spawn(square(0.4), lambert(0.5), Transform::from_xyz(-0.9, 0.8, -1.0));
        let board = rig.material_of(board);
        let spot = SpotLight { intensity: SPOT, outer_angle: 0.2, inner_angle: 0.1, ..default() };
        let above = Transform::from_xyz(-1.2, 0.3, 0.9).looking_at(Vec3::new(-1.2, -1.2, 0.9), Vec3::X);
        let spot = rig.spawn_bundle((spot, above));
        rig.set(|restir| *restir = settings(technique));
        let mut stage = Self { rig, cube, there: None, board, spot };
        for edits in [Edits::Cube, Edits::Material, Edits::Sky, Edits::Lamp] {
            stage.edit(edits, 0);
        }
        Some(stage)
    }

    fn edit(&mut self, edits: Edits, step: u32) {
        let share = step as f32 / PERIOD as f32;
        // From 1 to 0 and back.
        let wave = (1.0 - 2.0 * share).abs();
        let rig = &mut self.rig;
        match edits {
            Edits::None => {}
            Edits::Cube => {
                if let Some(cube) = self.there.take() {
                    rig.app.world_mut().despawn(cube);
                }
                if step.is_multiple_of(2) {
                    self.there = Some(rig.spawn_bundle(self.cube.clone()));
                }
            }
            Edits::Material => {
                let albedo = 0.5 + 0.4 * (TAU * share).sin();
                rig.edit(&self.board, |m| m.base_color = Color::linear_rgb(albedo, albedo, albedo));
            }
            Edits::Sky => {
                let degrees = PERIOD as f32 / 2.0 * (1.0 - wave);
                let turn = Quat::from_rotation_y(TURN_OF_SKY + degrees.to_radians());
                rig.get_mut::<RestirEnvironment>(rig.camera).rotation = turn;
            }
            Edits::Lamp => rig.get_mut::<SpotLight>(self.spot).intensity = SPOT * wave,
            Edits::Restarts => rig.set(|restir| restir.reset = step == PERIOD / 2),
        }
    }

    /// The pixels whose light the edits leave as it is.  Pictures with the same seed differ only where paths meet an edit.
    fn unchanged(&mut self, edits: Edits) -> Vec<bool> {
        let steps = [0].into_iter().chain(edits.extremes().iter().copied());
        let pictures: Vec<Picture> = steps
            .map(|step| {
                self.edit(edits, step);
                self.rig.picture(64)
            })
            .collect();
        self.edit(edits, 0);
        let is_unchanged = |i: usize| {
            let of = |picture: &Picture| Vec3::from(picture.pixels[i]);
            let at_rest = of(&pictures[0]);
            pictures.iter().all(|p| (of(p) - at_rest).abs().max_element() <= UNCHANGED * at_rest.max_element())
        };
        (0..(SIZE * SIZE) as usize).map(is_unchanged).collect()
    }

    /// Independent restarts, each with frames that show the scene at rest at ends of periods.
    fn run(&mut self, edits: Edits, length: Length, emission: &Picture, truth: &[f64]) -> Run {
        let mut run = Run::default();
        self.rig.until_ready();
        for restart in 0..length.restarts {
            self.rig.set(|restir| restir.seed = first_seed(2000) + restart);
            let mut frames = Vec::new();
            for frame in 1..=HISTORY + (length.frames - 1) * PERIOD {
                let step = frame % PERIOD;
                self.edit(edits, step);
                if frame < HISTORY || step > 0 {
                    self.rig.frame();
                } else {
                    let mut picture = self.rig.next();
                    leave_out_emitters(&mut picture, emission);
                    frames.push(picture);
                }
            }
            run.errors.push(errors(&frames, emission, truth));
            run.light.add(&Picture::mean_of(frames), emission);
        }
        run
    }
}

/// The shipped settings without those that are biased.
fn settings(technique: Technique) -> Restir {
    let is_bidirectional = technique == Technique::Bdpt;
    Restir {
        technique,
        bounces: if technique.has_indirect_light() { 3 } else { 1 },
        // Light paths end anywhere in a pixel.
        jitter: if is_bidirectional { Jitter::Always } else { Jitter::Never },
        firefly_limit: 0.0,
        denoiser: Denoiser::OFF,
        ..Restir::default()
    }
}

/// Independent restarts of a technique.
#[derive(Default)]
struct Run {
    /// The error of each pixel of each restart, a mean over its frames.
    errors: Vec<Vec<f64>>,
    light: Restarts,
}

impl Run {
    /// The error of each restart in some pixels.
    fn errors_in(&self, pixels: &[bool]) -> Vec<f64> {
        let count = pixels.iter().filter(|is_in| **is_in).count() as f64;
        let of_restart = |errors: &Vec<f64>| {
            errors.iter().zip(pixels).filter(|(_, is_in)| **is_in).map(|(error, _)| error).sum::<f64>() / count
        };
        self.errors.iter().map(of_restart).collect()
    }
}

/// The mean over frames of the relative squared error of each pixel.
fn errors(frames: &[Picture], emission: &Picture, truth: &[f64]) -> Vec<f64> {
    let mean = truth.iter().sum::<f64>() / truth.len() as f64;
    let error = |i: usize, frame: &Picture| {
        let light = Vec3::from(frame.pixels[i]) - Vec3::from(emission.pixels[i]);
        (f64::from(light.element_sum()) / 3.0 - truth[i]).powi(2) / (truth[i].powi(2) + 0.01 * mean * mean)
    };
    let of_pixel = |i| frames.iter().map(|frame| error(i, frame)).sum::<f64>() / frames.len() as f64;
    (0..truth.len()).map(of_pixel).collect()
}

/// The ratio of two means with its standard error, from pairs of values.
fn ratio(a: &[f64], b: &[f64]) -> (f64, f64) {
    let [(mean_a, _), (mean_b, _)] = [a, b].map(|values| mean_and_error(values.iter().copied()));
    let ratio = mean_a / mean_b;
    let (_, error) = mean_and_error(a.iter().zip(b).map(|(a, b)| a - ratio * b));
    (ratio, error / mean_b)
}

/// Measures the error after edits in every frame, relative to that at rest, and compares the light with the reference.
fn check(technique: Technique, margin: f64, length: Length, all: &[Edits]) {
    let Some(mut stage) = Stage::new(technique) else { return };
    let settings = settings(technique);
    let proof = Proof { bounces: settings.bounces, without_emitters: true, ..Proof::of((0, 1), (16, 64)) };
    let emission = emission(&mut stage.rig);
    let reference = proof.truth(&mut stage.rig, 1000);
    let truth: Vec<f64> = reference.pixels.iter().map(|sum| sum / reference.images.len() as f64).collect();
    let masks: Vec<Vec<bool>> = all.iter().map(|edits| stage.unchanged(*edits)).collect();
    stage.rig.set(|restir| *restir = settings);
    let at_rest = stage.run(Edits::None, length, &emission, &truth);
    for (&edits, pixels) in all.iter().zip(&masks) {
        let (start, before) = (Instant::now(), stage.rig.report().history_resets);
        let edited = stage.run(edits, length, &emission, &truth);
        let (ratio, error) = ratio(&edited.errors_in(pixels), &at_rest.errors_in(pixels));
        let found = edited.light.compare(&reference, margin);
        let count = pixels.iter().filter(|is_in| **is_in).count();
        let name = format!("{technique:?}, {edits:?}");
        let seconds = start.elapsed().as_secs_f64();
        eprintln!(
            "{name}: error {ratio:.3} ± {error:.3} of that at rest in {count} pixels; light {found}, {seconds:.1} s"
        );
        assert!(error < PRECISION, "{name}: add restarts: {error}");
        if edits == Edits::Restarts {
            assert!(ratio > LIMIT, "{name}: not found: {ratio}");
            continue;
        }
        assert!(2 * count > pixels.len(), "{name}: only {count} pixels keep their light");
        assert!(ratio < LIMIT, "{name}: {ratio} ± {error}");
        found.assert_equal(&name);
        // Each restart changes the seed.
        for ((reason, before), (_, after)) in before.into_iter().zip(stage.rig.report().history_resets) {
            let allowed = if reason == "settings" { u64::from(length.restarts) } else { 0 };
            assert!(after - before <= allowed, "{name}: {} histories restart because of {reason}", after - before);
        }
    }
    stage.rig.assert_sound();
}

const ALL: [Edits; 4] = [Edits::Cube, Edits::Material, Edits::Sky, Edits::Lamp];

/// With a sixth of these frames, the standard error of the ratio was 9 %.
const LENGTH: Length = Length { restarts: 16, frames: 9 };

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_edits_in_every_frame_leave_paths_the_error_of_a_scene_at_rest() {
    check(Technique::Pt, 0.03, LENGTH, &ALL);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_edits_in_every_frame_leave_direct_light_the_error_of_a_scene_at_rest() {
    check(Technique::Di, 0.02, LENGTH, &ALL);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_edits_in_every_frame_leave_indirect_light_the_error_of_a_scene_at_rest() {
    check(Technique::Gi, 0.02, LENGTH, &ALL);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_edits_in_every_frame_leave_light_paths_the_error_of_a_scene_at_rest() {
    check(Technique::Bdpt, 0.02, LENGTH, &ALL);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_histories_that_restart_every_12_frames_are_found() {
    check(Technique::Pt, 0.03, LENGTH, &[Edits::Restarts]);
}
