//! The command line.

use bevy::{camera::Exposure, math::UVec2};
use bevy_restir::Restir;
use clap::{Parser, ValueEnum};
use std::path::PathBuf;

use crate::{
    arguments::{self, Backend, PresetName, TechniqueName},
    environment::{self, Environment},
    headless::scene::unit_exposure,
    set::set,
};

/// Renders a glTF scene without a window.
#[derive(Parser, Debug)]
#[command(name = "render", version)]
pub struct Args {
    /// A .glb or .gltf file.
    pub scene: PathBuf,
    /// .exr: linear radiance times exposure, 32-bit float; .png: tonemapped.
    #[arg(long, default_value = "out.png", value_parser = output_path)]
    pub out: PathBuf,
    /// Pixels; the projection keeps the camera's vertical field of view.
    #[arg(long, default_value = "1280x720", value_parser = arguments::size)]
    pub size: UVec2,
    /// How light is carried: by the reference tracer, ReSTIR DI (direct light only), ReSTIR DI and GI, or ReSTIR PT.
    #[arg(long, value_enum, default_value = "pt")]
    pub technique: TechniqueName,
    /// Settings to start from.
    #[arg(long, value_enum, default_value = "balanced")]
    pub preset: PresetName,
    /// Scattering events a path may have; overrides the preset.
    #[arg(long)]
    pub bounces: Option<u32>,
    /// Samples a pixel (reference), or frames after the warm-up.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=16_000_000))]
    pub frames: u32,
    /// Frames that build history and are not counted; the reference needs none.
    #[arg(long, default_value_t = 16)]
    pub warmup: u32,
    /// The mean of the frames, or the last one.  Of the reference both are the mean of its samples.
    #[arg(long, value_enum, default_value = "mean")]
    pub output: Output,
    /// Selects the random numbers.
    #[arg(long, default_value_t = 0)]
    pub seed: u32,
    /// Uniform radiance R,G,B, or an equirectangular .hdr or .exr file.
    #[arg(long, value_parser = environment::parse)]
    pub env: Option<Environment>,
    /// Exposure value at ISO 100; without it the exposure is 1.
    #[arg(long, allow_negative_numbers = true, value_parser = arguments::ev100)]
    pub ev100: Option<f32>,
    /// Name of the camera; without it the first of the file.
    #[arg(long)]
    pub camera: Option<String>,
    /// How rays are traced: by ray queries where the device has them and is no CPU; always in software; by ray queries, if there are any.
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: Backend,
    /// Plays the first animation of the file, 1/60 s a frame.
    #[arg(long)]
    pub animate: bool,
    /// Sets a field of `Restir` by its reflection path; repeatable.
    #[arg(long = "set", value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Writes what was measured.
    #[arg(long)]
    pub stats: Option<PathBuf>,
}

#[derive(ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    Mean,
    Last,
}

fn output_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|e| e.to_str()) {
        Some("exr" | "png") => Ok(path),
        _ => Err("expected a name that ends in .exr or .png".into()),
    }
}

impl Args {
    /// The camera's settings; an unknown path or an unreadable value is an error in the arguments.
    pub fn settings(&self) -> Result<Restir, String> {
        let mut settings = Restir::preset(self.preset.into());
        settings.technique = self.technique.into();
        settings.seed = self.seed;
        if let Some(bounces) = self.bounces {
            settings.bounces = bounces;
        }
        for assignment in &self.set {
            set(&mut settings, assignment).map_err(|error| format!("--set {error}"))?;
        }
        Ok(settings)
    }

    /// The camera's exposure.
    pub fn exposure(&self) -> Exposure {
        self.ev100.map_or(unit_exposure(), |ev100| Exposure { ev100 })
    }
}
