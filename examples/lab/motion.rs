//! Errors where surfaces come into view.

use bevy::{math::UVec2, prelude::*};
use bevy_restir::{DebugView, Jitter, Restir, Reuse, Technique};
use bevy_restir_support::{arguments, progress::Progress};
use plotters::{
    prelude::{LineSeries, PathElement, RGBColor},
    style::Color as _,
};

use crate::{
    bench::{Bench, Counts, scenes},
    difference::relative_weight,
    error::{Picture, mean},
    frames::with_variants,
    output::{Output, describe},
    plot::{Area, around, chart, drawn, failed, legend},
    subject::Subject,
    table::{Row, Table, Unit},
    variant,
};

/// Errors of pixels by the number of frames for which their surface has been in view, while the camera turns or steps aside, or an object
/// passes: a table, and a plot for each scene and motion.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Fields of `Restir` as `"PATH=VALUE PATH=VALUE"`, measured beside the preset; repeatable.  Without any, the preset is measured with and
    /// without dual motion vectors, and with one neighbor, with and without more of them where surfaces come into view.
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
pub const FRAMES: u32 = 16;
/// Frames at rest before them.
pub const REST: u32 = 8;
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

/// What is measured without `--variant`: methods for surfaces that come into view.  By default there are no more neighbors there than
/// elsewhere, so that these need a preset with one neighbor.
const METHODS: [(&str, &str); 3] = [
    ("without dual motion vectors", "direct.reuse.dual_motion=false paths.reuse.dual_motion=false"),
    ("one neighbor, more in new pixels", "direct.reuse.spatial_samples=1 paths.reuse.spatial_samples=1"),
    (
        "one neighbor",
        "direct.reuse.spatial_samples=1 paths.reuse.spatial_samples=1 direct.reuse.disocclusion_samples=0 \
         paths.reuse.disocclusion_samples=0",
    ),
];

/// Kind of motion.
#[derive(Clone, Copy, Debug)]
pub enum Motion {
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

    /// Part of the name of a plot.
    fn key(self) -> &'static str {
        match self {
            Self::Turn => "turn",
            Self::Sidestep => "sidestep",
            Self::Pass => "pass",
        }
    }

    /// Places of the camera or the object, of which the last is measured.
    pub fn places(self, camera: Transform, distance: f32) -> Vec<Transform> {
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
    let variants = args.variants(plain)?;
    let mut table = Table::default();
    let mut plots = Vec::new();
    for scene in scenes(&args.subject.scenes)? {
        let counts = Counts { warmup: 0, frames: 1 };
        let mut bench = Bench::of_scene(&scene, args.size, variants[0].1.clone(), &counts)?;
        describe(
            &mut table,
            bench.adapter(),
            args.size,
            format!(
                "{:?}, {:?}: relMSE without the worst percent of the pixels of each age, without jitter, means over {} runs of {FRAMES} frames",
                args.subject.technique, args.subject.preset, args.seeds
            ),
        );
        let (rows, curves) = args.column(&mut bench, &variants).map_err(|error| format!("{}: {error}", scene.1))?;
        for (motion, curves) in curves {
            plots.push((format!("{NAME}-{}-{}", scene.1, motion.key()), drawn(|area| draw(&curves, area))?));
        }
        table.columns.push((scene.1, rows));
        args.output.write_so_far(NAME, &table)?;
    }
    plots.iter().try_for_each(|(name, svg)| args.output.write_plot(name, svg))?;
    args.output.write(NAME, &table)
}

/// Errors of a variant by the frames that surfaces have been in view.
struct Curve {
    name: String,
    points: Vec<(f64, f64)>,
}

impl Args {
    fn variants(&self, plain: Restir) -> Result<Vec<(String, Restir)>, String> {
        if !self.variant.is_empty() {
            return with_variants(self.subject.preset, plain, &self.variant);
        }
        let mut all = with_variants(self.subject.preset, plain.clone(), &[])?;
        for (name, text) in METHODS {
            all.push((name.into(), variant::of(&plain, text)?));
        }
        Ok(all)
    }

    /// The rows of a scene, and the curves of each motion.
    fn column(
        &self,
        bench: &mut Bench,
        variants: &[(String, Restir)],
    ) -> Result<(Vec<Row>, Vec<(Motion, Vec<Curve>)>), String> {
        let runs = 1 + u64::from(self.seeds) * variants.len() as u64;
        let each = u64::from(self.samples) + u64::from(FRAMES + REST) * runs;
        let progress = Progress::new(Motion::ALL.len() as u64 * each);
        let camera = bench.place();
        let (mut rows, mut all) = (Vec::new(), Vec::new());
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
            let mut curves: Vec<_> =
                names.iter().map(|name| Curve { name: (*name).into(), points: Vec::new() }).collect();
            for age in 0..=LAST_AGE + 1 {
                let share = ages.iter().filter(|a| **a == Some(age)).count() as f64 / ages.len() as f64;
                let mut figures = vec![("", Unit::Plain, share)];
                for (pictures, curve) in runs.iter().zip(&mut curves) {
                    let errors = pictures.iter().map(|picture| error(picture, reference.pixels(), &ages, age));
                    let error = errors.sum::<f64>() / pictures.len() as f64;
                    figures.push(("", Unit::Plain, error));
                    if age <= LAST_AGE && error > 0.0 {
                        curve.points.push((age as f64, error));
                    }
                }
                rows.push(Row::new(section.clone(), label(age), &figures));
            }
            // Where nothing comes into view there is nothing to plot.
            if curves.iter().any(|curve| !curve.points.is_empty()) {
                all.push((motion, curves));
            }
            if let Some(object) = object {
                bench.app().world_mut().despawn(object);
            }
        }
        Ok((rows, all))
    }
}

fn label(age: usize) -> String {
    match age {
        0..=LAST_AGE => format!("in view for {age} {}", if age == 1 { "frame" } else { "frames" }),
        _ => "longer".to_owned(),
    }
}

/// Colors of the curves.
const COLORS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(160, 60, 160),
    RGBColor(230, 159, 0),
    RGBColor(110, 110, 110),
];

/// Errors over the frames since surfaces have come into view.
fn draw(curves: &[Curve], area: &Area) -> Result<(), String> {
    let y = around(curves.iter().flat_map(|curve| curve.points.iter().map(|point| point.1)))?;
    let names = ["frames since a surface has come into view", "relMSE without the worst percent"];
    let mut chart = chart(area, 0.0..LAST_AGE as f64, y, names)?;
    for (curve, color) in curves.iter().zip(COLORS.into_iter().cycle()) {
        chart
            .draw_series(LineSeries::new(curve.points.iter().copied(), color.stroke_width(2)).point_size(3))
            .map_err(failed)?
            .label(curve.name.clone())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    legend(&mut chart)
}

/// A gray cube.
pub fn spawn_object(bench: &mut Bench) -> Entity {
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
