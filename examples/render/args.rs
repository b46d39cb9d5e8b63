//! The command line.

use bevy::{camera::Exposure, math::UVec2};
use bevy_restir::{DebugView, Jitter, Preset, RayBackend, Restir, RestirBudget, Technique};
use bevy_restir_support::{
    arguments::{self, ExposureChoice},
    environment::{self, Environment},
    exposure::unit_exposure,
    fields,
};
use clap::{Parser, ValueEnum};
use std::path::{Path, PathBuf};

/// Renders a glTF scene without a window.
#[derive(Parser, Debug)]
#[command(name = "render", version)]
pub struct Args {
    /// A .glb or .gltf file.
    pub scene: PathBuf,
    /// The picture: .exr holds linear radiance times exposure in 32-bit floats, or the values of a debug view; .png is tonemapped.
    #[arg(long, default_value = "out.png", value_parser = output_path)]
    pub out: PathBuf,
    /// Size in pixels; the camera keeps its vertical field of view.
    #[arg(long, default_value = "1280x720", value_parser = arguments::size)]
    pub size: UVec2,
    /// Reference path tracer, ReSTIR DI (direct light only), ReSTIR DI with GI, ReSTIR PT, or ReSTIR BDPT.
    #[arg(long, default_value = "pt", value_parser = arguments::choice::<Technique>())]
    pub technique: Technique,
    /// Settings to start from.
    #[arg(long, default_value = "balanced", value_parser = arguments::choice::<Preset>())]
    pub preset: Preset,
    /// Maximum number of scattering events of a path, 0 to 64; overrides the preset.
    #[arg(long)]
    pub bounces: Option<u32>,
    /// With the reference: samples per pixel. With other techniques: frames after the warm-up.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=16_000_000))]
    pub frames: u32,
    /// Frames that build up history and are not part of the picture. No effect with `--technique reference`.
    #[arg(long, default_value_t = 16)]
    pub warmup: u32,
    /// The mean of the frames or the last one. The reference always gives the mean of its samples. With --animate, a .png shows the last
    /// frame in any case. A mean has no limit of bright pixels (`firefly_limit` is 0) and no denoiser, because both would stay in it as a
    /// bias. Primary rays are jittered within the pixel (`--set jitter=Never` looks through its center).
    #[arg(long, value_enum, default_value = "mean")]
    pub output: Output,
    /// Seed of the random numbers.
    #[arg(long, default_value_t = 0)]
    pub seed: u32,
    /// Environment: uniform radiance R,G,B in cd/m², or an equirectangular .hdr or .exr file. Without it a scene that has no light of its own is
    /// lit by a gray studio, with a warning.
    #[arg(long, value_parser = environment::parse)]
    pub env: Option<Environment>,
    /// Exposure value at ISO 100, or `auto`. Without it the exposure is 1: 1 cd/m² is 1 before tone mapping. `auto` is
    /// log2(L / (1.2 * 0.18)), where L is the logarithmic mean of the picture's luminance over blocks of 8 x 8 pixels that are not black: L
    /// becomes middle gray. With `auto` a .png shows one frame or sample more than asked for, because its exposure is known only after the
    /// others.
    #[arg(long, value_parser = arguments::exposure, value_name = "V|auto")]
    pub ev100: Option<ExposureChoice>,
    /// Name of the camera; without it the first one of the file.
    #[arg(long)]
    pub camera: Option<String>,
    /// How rays are traced: `hardware` by ray queries where the device has them, `software` never by ray queries, `auto` by ray queries
    /// except on a CPU.
    #[arg(long, default_value = "auto", value_parser = arguments::choice::<RayBackend>())]
    pub backend: RayBackend,
    /// Plays the first animation of the file, 1/60 s per frame.
    #[arg(long)]
    pub animate: bool,
    /// Sets a field of `Restir` by its reflection path, for instance direct.candidates=16; repeatable. `accumulate` and `reset` have no
    /// effect: --output chooses between the mean and the last frame.
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Limit for the GPU time of a frame, ms. Before the warm-up, the number of samples is reduced until frames take no longer.
    #[arg(long, value_name = "MS", value_parser = arguments::positive::<f32>)]
    pub time_budget: Option<f32>,
    /// Least `resolution_scale` that --time-budget may choose where the fewest samples still take too long. Below 1 the picture must be a
    /// .png.
    #[arg(long, value_name = "SCALE", requires = "time_budget", default_value_t = 1.0, value_parser = arguments::resolution_scale)]
    pub least_resolution_scale: f32,
    /// Writes another .exr file; repeatable. NAME is one of: the first surface of each pixel in the frame after the picture, as albedo,
    /// normal (world space, 0 without a surface), depth (distance from the camera, m; 0 without a surface) or motion (pixels to the surface
    /// in the frame before); or a part of the light in the picture, as diffuse (with light out of translucent bodies) or specular. The
    /// parts take as many frames as the picture; with the emission that the camera sees directly they sum to it, with `--output last`
    /// only if `--preset unbiased` turns the denoiser and the limit of bright pixels off, which the parts do not have.
    #[arg(long = "aov", value_name = "NAME=FILE.exr", value_parser = aov)]
    pub aovs: Vec<Aov>,
    /// Writes times, memory and counters to this file as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    Mean,
    Last,
}

/// A property of surfaces or a part of the light, and the file for it.
#[derive(Clone, Debug)]
pub struct Aov {
    pub view: DebugView,
    pub path: PathBuf,
}

fn aov(text: &str) -> Result<Aov, String> {
    let (name, path) = text.split_once('=').ok_or("expected NAME=FILE.exr")?;
    let view = match name {
        "albedo" => DebugView::Albedo,
        "normal" => DebugView::Normals,
        "depth" => DebugView::Depth,
        "motion" => DebugView::Motion,
        "diffuse" => DebugView::DiffuseLight,
        "specular" => DebugView::SpecularLight,
        _ => return Err("expected albedo, normal, depth, motion, diffuse or specular".into()),
    };
    Ok(Aov { view, path: arguments::file(path, &["exr"])? })
}

fn output_path(text: &str) -> Result<PathBuf, String> {
    arguments::file(text, &["exr", "png"])
}

impl Args {
    /// The camera's settings. The error names the argument that is wrong.
    pub fn settings(&self) -> Result<Restir, String> {
        let mut settings = Restir::preset(self.preset);
        settings.technique = self.technique;
        settings.seed = self.seed;
        // Pictures are compared with references that average over pixels.
        settings.jitter = Jitter::Always;
        if let Some(bounces) = self.bounces {
            settings.bounces = bounces;
        }
        for assignment in &self.set {
            fields::set(&mut settings, assignment).map_err(|error| format!("--set {error}"))?;
        }
        // Frames are averaged after the warm-up, as `--output` asks.
        settings.accumulate = false;
        for (name, scale) in [
            ("--set resolution_scale", settings.resolution_scale),
            ("--least-resolution-scale", self.least_resolution_scale),
        ] {
            if scale < 1.0 && (self.writes_exr() || !self.aovs.is_empty()) {
                return Err(format!("{name} below 1 needs a .png: an .exr has one traced pixel for each of --size"));
            }
        }
        Ok(settings)
    }

    /// The limit of the time of a frame.
    pub fn budget(&self) -> Option<RestirBudget> {
        let least_resolution_scale = self.least_resolution_scale;
        self.time_budget.map(|gpu_ms| RestirBudget { gpu_ms, least_resolution_scale })
    }

    /// Whether the picture is an .exr file.
    pub fn writes_exr(&self) -> bool {
        self.out.extension().is_some_and(|e| e == "exr")
    }

    /// The files to write.
    pub fn outputs(&self) -> impl Iterator<Item = &Path> {
        let aovs = self.aovs.iter().map(|aov| aov.path.as_path());
        core::iter::once(self.out.as_path()).chain(aovs).chain(self.stats.as_deref())
    }

    /// An error if two of the files to write are one, or one of them is an input.
    pub fn check_outputs(&self) -> Result<(), String> {
        let absolute = |path: &Path| {
            let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let folder = folder.canonicalize().unwrap_or(folder.into());
            folder.join(path.file_name().unwrap_or_default())
        };
        let environment = match &self.env {
            Some(Environment::File(path)) => Some(absolute(path)),
            _ => None,
        };
        let scene = absolute(&self.scene);
        let mut seen = Vec::new();
        for path in self.outputs() {
            let place = absolute(path);
            if place == scene {
                return Err(format!("an option would overwrite the scene {}", path.display()));
            }
            if environment.as_ref() == Some(&place) {
                return Err(format!("an option would overwrite the environment {}", path.display()));
            }
            if seen.contains(&place) {
                return Err(format!("two options name the file {}", path.display()));
            }
            seen.push(place);
        }
        Ok(())
    }

    /// The camera's exposure; 1 until the picture is measured where that is asked for.
    pub fn exposure(&self) -> Exposure {
        self.ev100.and_then(ExposureChoice::fixed).unwrap_or(unit_exposure())
    }
}
