//! What each feature of a scene costs, and what it adds to the picture.

mod change;
mod list;
mod text;

use bevy::math::UVec2;
use bevy_restir::{Restir, RestirReport, SceneFeatures, Technique};
use bevy_restir_support::{
    arguments,
    compose::SizedShader,
    environment::{self, Environment},
    progress::Progress,
};

use crate::{
    bench::{Bench, Counts, Scene, lit, scenes},
    error::Picture,
    output::{Output, header},
    subject::Subject,
    table::Table,
};
use change::{Change, Figure};
use list::{FEATURES, Feature};

/// Time, memory and light of each feature that a scene has: kinds of lights, lobes of materials, textures, alpha, bodies.  The scene is
/// rendered without each of them: lights of a kind are removed, and materials lose a property.
#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    subject: Subject,
    /// Size of the picture in pixels.
    #[arg(long, default_value = "128x128", value_parser = arguments::size)]
    size: UVec2,
    #[command(flatten)]
    counts: Counts,
    /// Number of independent pictures of each scene, whose variance is the noise of the change.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(4..=65_536))]
    seeds: u32,
    /// Samples per pixel of all these pictures together.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    samples: u32,
    /// Replaces the environment: radiance R,G,B or an equirectangular .hdr or .exr file.
    #[arg(long, value_parser = environment::parse)]
    env: Option<Environment>,
    /// Measures only features whose names, as in "alpha masks", contain this text.
    #[arg(long, default_value = "", hide_default_value = true)]
    only: String,
    #[command(flatten)]
    output: Output,
}

/// The table's name.
const NAME: &str = "features";
/// What a row of the table has: the time, the changes of the light and of the pixels, each with its standard error, and [`LOADS`].
const FIGURES: [&str; 6] = ["time, ms", "± ms", "light, %", "± light", "pixels, %", "± pixels"];
/// What follows them.
const LOADS: [&str; 4] = ["MiB", "triangles", "lights", "shader"];
/// Those of them that are whole numbers.
const COUNTS: [&str; 3] = ["triangles", "lights", "shader"];
/// Features of settings and of the device, which are in no scene.
const SETTINGS: SceneFeatures = SceneFeatures::ENERGY_COMPENSATION
    .union(SceneFeatures::MANY_NEIGHBORS)
    .union(SceneFeatures::SPLIT_LIGHT)
    .union(SceneFeatures::CONNECTIONS)
    .union(SceneFeatures::COPIED_MIS)
    .union(SceneFeatures::COUNT_RAYS)
    .union(SceneFeatures::RAY_QUERY);

pub fn run(args: &Args) -> Result<(), String> {
    args.output.check(NAME)?;
    let columns = FIGURES.iter().chain(&LOADS).map(|name| ((*name).into(), Vec::new())).collect();
    let mut table = Table { columns, ..Table::default() };
    for scene in scenes(&args.subject.scenes)? {
        let measured = args.measure(&scene).map_err(|error| format!("{}: {error}", scene.1))?;
        if table.header.is_empty() {
            table.header = header(measured.adapter.clone(), args.size);
            table.header.extend(args.described());
        }
        measured.add_to(&mut table, &scene.1, args.only.is_empty());
    }
    args.output.write(NAME, &table)
}

impl Args {
    /// Fails if no feature is named as `--only` asks.
    pub fn check(&self) -> Result<(), String> {
        let is_known = self.features().next().is_some();
        is_known.then_some(()).ok_or(format!("--only: no feature is named {}", self.only))
    }

    fn features(&self) -> impl Iterator<Item = &'static Feature> {
        FEATURES.iter().filter(|feature| feature.name.contains(&self.only))
    }

    fn described(&self) -> [String; 2] {
        let Self { subject, counts: Counts { warmup, frames }, seeds, .. } = self;
        [
            format!(
                "{:?}, {:?}: a scene, and what it loses without each feature; times: medians over {frames} frames after {warmup}, in pairs of \
                 a frame with the feature and one without it; shader: expressions in the shader of the reference tracer",
                subject.technique, subject.preset
            ),
            format!(
                "light: change of the mean; pixels: mean absolute change of the pixels, both relative to the mean, by {seeds} pictures of {} \
                 samples of the reference tracer; ±: one standard error",
                self.samples_each()
            ),
        ]
    }

    fn samples_each(&self) -> u32 {
        self.samples.div_ceil(self.seeds)
    }

    fn measure(&self, scene: &Scene) -> Result<Measured, String> {
        let settings = self.subject.settings();
        let mut whole = self.bench(scene, None)?;
        let world = whole.app().world_mut();
        let present: Vec<_> = self.features().filter_map(|f| Some((f, f.place(world)?))).collect();
        if present.is_empty() {
            return Err("it has no feature that can be taken out".into());
        }
        let progress = Progress::new(self.planned(present.len() as u64));
        let with = self.pictures(&mut whole, &progress)?;
        with.iter().try_for_each(lit)?;
        let mut shader = SizedShader::new("pass/reference.wgsl");
        let mut times = Vec::new();
        let mut removals = Vec::new();
        for (feature, place) in present {
            let mut without = self.bench(scene, Some(feature))?;
            let pairs = whole.pairs(&mut without, &settings, &progress)?;
            times.extend(pairs.iter().map(|pair| pair[0]));
            let saved: Vec<f64> = pairs.iter().map(|[with, without]| with - without).collect();
            removals.push(Removal {
                feature,
                place,
                time: Figure::median(&saved),
                rest: Size::of(&without.report(), &mut shader),
                change: Change::new(&with, &self.pictures(&mut without, &progress)?),
            });
        }
        removals.sort_by(|a, b| b.time.value.total_cmp(&a.time.value));
        let size = Size::of(&whole.report(), &mut shader);
        Ok(Measured { adapter: whole.adapter(), time: Figure::median(&times), size, removals })
    }

    /// The scene, without a feature.
    fn bench(&self, scene: &Scene, without: Option<&Feature>) -> Result<Bench, String> {
        Bench::of_edited(scene, self.size, self.subject.settings(), &self.counts, |world| {
            if let Some(wanted) = &self.env {
                environment::light(world, wanted)?;
            }
            if let Some(feature) = without {
                feature.take_out(world);
            }
            Ok(())
        })
    }

    /// Number of frames of a scene with this many features.
    fn planned(&self, features: u64) -> u64 {
        let pictures = u64::from(self.samples_each()) * u64::from(self.seeds);
        let pairs = 2 * u64::from(self.counts.warmup + self.counts.frames);
        (1 + features) * pictures + features * pairs
    }

    /// Independent pictures by the reference tracer, with the light that the technique shows.
    fn pictures(&self, bench: &mut Bench, progress: &Progress) -> Result<Vec<Picture>, String> {
        let settings = self.subject.settings();
        let most = if settings.technique == Technique::Di { 1 } else { u32::MAX };
        let reference =
            Restir { technique: Technique::Reference, bounces: settings.bounces.min(most), ..settings.clone() };
        bench.pictures(&reference, self.seeds, self.samples_each() - 1, progress)
    }
}

/// The size of a scene.
struct Size {
    /// As in [`LOADS`].
    loads: [f64; LOADS.len()],
    /// Features that shaders are specialized for.
    features: SceneFeatures,
}

impl Size {
    fn of(report: &RestirReport, shader: &mut SizedShader) -> Self {
        let bytes = report.memory_bytes() as f64 / f64::from(1 << 20);
        // A compile time would depend on the driver's cache; the size of a shader does not.
        let expressions = shader.expressions(report.features) as f64;
        Self {
            loads: [bytes, report.triangles as f64, report.lights as f64, expressions],
            features: report.features.difference(SETTINGS),
        }
    }
}

/// The measurements of a scene.
struct Measured {
    adapter: String,
    time: Figure,
    size: Size,
    /// The most expensive feature comes first.
    removals: Vec<Removal>,
}

/// A scene without a feature.
struct Removal {
    feature: &'static Feature,
    place: String,
    /// The time that it saves.
    time: Figure,
    /// What remains of the scene.
    rest: Size,
    change: Change,
}
