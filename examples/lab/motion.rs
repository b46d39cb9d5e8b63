//! Errors where surfaces come into view.

use bevy::{math::UVec2, prelude::*};
use bevy_restir::{DebugView, Jitter, Restir, Reuse, Technique};
use bevy_restir_support::{arguments, progress::Progress};

use crate::{
    bench::{Bench, Counts, scenes},
    difference::relative_weight,
    error::{Picture, mean},
    frames::with_variants,
    output::{Output, header},
    subject::Subject,
    table::{Row, Table, Unit},
    variant,
};

/// Errors of pixels by the number of frames for which their surface has been in view, while the camera turns or steps aside, or an object
/// passes.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Fields of `Restir` as `"PATH=VALUE PATH=VALUE"`, measured beside the preset; repeatable.
    #[arg(long, value_parser = variant::parse)]
    variant: Vec<String>,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    size: UVec2,
    /// Number of independent runs over which errors are averaged.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=65_536))]
    seeds: u32,
    /// Samples per pixel of the converged pictures.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    samples: u32,
    /// Distance of the passing object from the camera, m.  The size and speed of the object and the steps of the camera scale with it.
    #[arg(long, default_value_t = 1.0, value_parser = arguments::positive::<f32>)]
    distance: f32,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "motion";
/// Frames of motion; the last is measured.
const FRAMES: u32 = 16;
/// Frames at rest before them.
const REST: u32 = 8;
/// Turn of the camera in a frame, radians.
const TURN: f32 = 0.035;
/// Step of the camera in a frame, and of the object that passes, relative to the object's distance.
const STEP: f32 = 0.02;
const PASS: f32 = 0.06;
/// Side of the object that passes, and where it is in the last frame, right of the middle, relative to its distance.
const SIDE: f32 = 0.25;
const END: f32 = 0.1;
/// Ages up to this one have rows of their own, frames.
const LAST_AGE: usize = 10;

/// Kind of motion.
#[derive(Clone, Copy, Debug)]
enum Motion {
    Turn,
    Sidestep,
    Pass,
}

impl Motion {
    const ALL: [Self; 3] = [Self::Turn, Self::Sidestep, Self::Pass];

    fn name(self) -> &'static str {
        match self {
            Self::Turn => "the camera turns by 2 degrees a frame",
            Self::Sidestep => "the camera steps aside",
            Self::Pass => "an object passes",
        }
    }

    /// Places of the camera or the object, of which the last is measured.
    fn places(self, camera: Transform, distance: f32) -> Vec<Transform> {
        let place = |left: f32| match self {
            Self::Turn => Transform { rotation: Quat::from_rotation_y(TURN * left) * camera.rotation, ..camera },
            Self::Sidestep => camera.with_translation(camera.translation - left * STEP * distance * camera.right()),
            Self::Pass => {
                let aside = (END - left * PASS) * distance * camera.right();
                let at = camera.translation + aside + distance * camera.forward();
                camera.with_translation(at).with_scale(Vec3::splat(SIDE * distance))
            }
        };
        (0..=FRAMES).rev().map(|left| place(left as f32)).collect()
    }
}

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    // The reference tracer would jitter, and single frames would not: edges would differ.
    let plain = Restir { jitter: Jitter::Never, ..args.subject.settings() };
    let variants = with_variants(args.subject.preset, plain, &args.variant)?;
    let mut table = Table { header: Vec::new(), columns: Vec::new(), notes: Vec::new() };
    for scene in scenes(&args.subject.scenes)? {
        let counts = Counts { warmup: 0, frames: 1 };
        let mut bench = Bench::of_scene(&scene, args.size, variants[0].1.clone(), &counts)?;
        if table.header.is_empty() {
            table.header = header(bench.adapter(), args.size);
            table.header.push(format!(
                "{:?}, {:?}: relMSE without the worst percent of the pixels of each age, without jitter, means over {} runs of {FRAMES} frames",
                args.subject.technique, args.subject.preset, args.seeds
            ));
        }
        let rows = args.column(&mut bench, &variants).map_err(|error| format!("{}: {error}", scene.1))?;
        table.columns.push((scene.1, rows));
    }
    args.output.write(NAME, &table)
}

impl Args {
    fn column(&self, bench: &mut Bench, variants: &[(String, Restir)]) -> Result<Vec<Row>, String> {
        let runs = 1 + u64::from(self.seeds) * variants.len() as u64;
        let each = u64::from(self.samples) + u64::from(FRAMES + REST) * runs;
        let progress = Progress::new(Motion::ALL.len() as u64 * each);
        let camera = bench.place();
        let mut rows = Vec::new();
        for motion in Motion::ALL {
            let object = matches!(motion, Motion::Pass).then(|| spawn_object(bench));
            bench.set_mover(object);
            bench.set_motion(motion.places(camera, self.distance));
            let plain = Restir { technique: Technique::Reference, ..variants[0].1.clone() };
            let reference = bench.reference(&plain, self.samples, &progress)?;
            let ages = ages(bench, &variants[0].1, &progress)?;
            let mut runs = Vec::new();
            for (_, settings) in variants {
                runs.push(bench.pictures(settings, self.seeds, FRAMES + REST, &progress)?);
            }
            let names: Vec<&str> = variants.iter().map(|(name, _)| name.as_str()).collect();
            let section = format!("{}: share of the pixels; errors with {}", motion.name(), names.join("; "));
            for age in 0..=LAST_AGE + 1 {
                let share = ages.iter().filter(|a| **a == Some(age)).count() as f64 / ages.len() as f64;
                let errors = runs.iter().map(|pictures| {
                    let errors = pictures.iter().map(|picture| error(picture, reference.pixels(), &ages, age));
                    ("", Unit::Plain, errors.sum::<f64>() / pictures.len() as f64)
                });
                let figures: Vec<_> = core::iter::once(("", Unit::Plain, share)).chain(errors).collect();
                rows.push(Row::new(section.clone(), label(age), &figures));
            }
        }
        Ok(rows)
    }
}

fn label(age: usize) -> String {
    if age > LAST_AGE { "longer".to_owned() } else { format!("in view for {age} frames") }
}

/// A gray cube.
fn spawn_object(bench: &mut Bench) -> Entity {
    let world = bench.app().world_mut();
    let mesh = world.resource_mut::<Assets<Mesh>>().add(Cuboid::from_length(1.0));
    let gray =
        StandardMaterial { base_color: Color::linear_rgb(0.5, 0.5, 0.5), perceptual_roughness: 1.0, ..default() };
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(gray);
    world.spawn((Mesh3d(mesh), MeshMaterial3d(material), Transform::default())).id()
}

/// For how many frames before the last one the surface of each pixel has been in view; `LAST_AGE + 1` for longer, `None` without a
/// surface.  It is read from the confidence of direct light that is reused from the last frame alone.
fn ages(bench: &mut Bench, settings: &Restir, progress: &Progress) -> Result<Vec<Option<usize>>, String> {
    let mut counting =
        Restir { technique: Technique::Di, debug_view: DebugView::ReservoirConfidence, ..settings.clone() };
    let reuse = &mut counting.direct.reuse;
    *reuse = Reuse {
        spatial_samples: 0,
        disocclusion_samples: 0,
        dual_motion: false,
        confidence_cap: 30.0,
        ..reuse.clone()
    };
    let confidence = bench.pictures(&counting, 1, FRAMES + REST, progress)?.swap_remove(0);
    // A surface has the confidence of its own candidates at least.
    let age = |confidence: f64| (confidence >= 1.0).then(|| ((confidence - 1.0) as usize).min(LAST_AGE + 1));
    Ok(confidence.iter().map(|c| age(c[0])).collect())
}

/// Relative squared error of the pixels of an age, without the worst hundredth of them.
fn error(picture: &Picture, reference: &Picture, ages: &[Option<usize>], age: usize) -> f64 {
    let scale = mean(reference, |c| c);
    let of_pixel = |(c, r): (&[f64; 3], &[f64; 3])| {
        (0..3).map(|i| (c[i] - r[i]).powi(2) * relative_weight(r[i], scale)).sum::<f64>() / 3.0
    };
    let pixels = picture.iter().zip(reference).zip(ages);
    let mut errors: Vec<f64> = pixels.filter(|(_, a)| **a == Some(age)).map(|(pair, _)| of_pixel(pair)).collect();
    errors.sort_by(f64::total_cmp);
    errors.truncate(errors.len() - errors.len() / 100);
    errors.iter().sum::<f64>() / errors.len() as f64
}
