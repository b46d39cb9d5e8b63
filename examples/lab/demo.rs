//! Pictures that show what ReSTIR is for: the reference path tracer, a technique in the same time without and with the denoiser, and the
//! converged picture.

use bevy::{math::UVec2, utils::default};
use bevy_restir::{Denoiser, Restir, Technique};
use bevy_restir_support::{arguments, exr_file, files, picture::write_png, progress::Progress};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Counts, Scene, reference_bounces, scenes},
    error::{Picture, Reference},
    panels,
    table::digits,
};

/// One picture per scene with four panels: the reference path tracer in the time of one frame of a technique with the denoiser, the
/// technique without it and with it, and the converged picture. The printed errors are medians over blocks of 8 x 8 pixels of the squared error,
/// relative to the squared mean.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// ReSTIR PT, ReSTIR BDPT, or ReSTIR DI with GI.
    #[arg(long, default_value = "pt", value_parser = ["pt", "bdpt", "gi"])]
    technique: String,
    /// Folder for the pictures.
    #[arg(long, default_value = "target/demo")]
    out: PathBuf,
    /// Size of a panel in pixels. Without it SCENE.exr beside SCENE.glb is the converged picture and gives the size.
    #[arg(long, value_parser = arguments::size)]
    size: Option<UVec2>,
    /// Maximum number of scattering events of a path. Without it, that of SCENE.exr as `references.json` states it, or that of the preset.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: Option<u32>,
    /// Samples per pixel of the converged picture where it is rendered.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..=16_000_000))]
    samples: u32,
}

/// Frames before the one that ReSTIR shows.
const HISTORY: u32 = 16;
/// Frames that measure the time of a sample of the reference path tracer.
const TIMED: u32 = 4;
/// Size of a panel where no file gives it.
const SIZE: UVec2 = UVec2::splat(288);
/// Least width of the whole picture in pixels.
const LEAST_WIDTH: usize = 800;

pub fn run(args: &Args) -> Result<(), String> {
    let scenes = scenes(&args.scenes)?;
    let names: Vec<String> = scenes.iter().map(file_name).collect();
    files::check_in(&args.out, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    for scene in scenes {
        compare(args, &scene).map_err(|error| format!("{}: {error}", scene.1))?;
    }
    Ok(())
}

/// The picture of a scene.
fn file_name((_, name): &Scene) -> String {
    format!("{name}.png")
}

/// Renders the panels of a scene and prints what they show.
fn compare(args: &Args, scene: &Scene) -> Result<(), String> {
    let file = scene.0.with_extension("exr");
    let file = (args.size.is_none() && file.is_file()).then(|| exr_file::read(&file)).transpose()?;
    let size = file.as_ref().map_or(args.size.unwrap_or(SIZE), |file| file.0);
    let stated = || file.as_ref().and_then(|_| reference_bounces(scene).ok());
    let bounces = args.bounces.or_else(stated).unwrap_or(Restir::default().bounces);
    // The reference files are made without energy compensation.
    let settings =
        |technique, denoiser| Restir { technique, bounces, energy_compensation: false, denoiser, ..default() };
    let reference = settings(Technique::Reference, Denoiser::OFF);
    let (technique, name) = match args.technique.as_str() {
        "bdpt" => (Technique::Bdpt, "ReSTIR BDPT"),
        "gi" => (Technique::Gi, "ReSTIR DI + GI"),
        _ => (Technique::Pt, "ReSTIR PT"),
    };
    let [raw, denoised] = [Denoiser::OFF, Denoiser::ON].map(|denoiser| settings(technique, denoiser));
    let mut bench = Bench::of_scene(scene, size, reference.clone(), &Counts { warmup: HISTORY, frames: TIMED })?;
    let silent = Progress::hidden();
    let (_, sample_ms) = bench.show(&reference, TIMED, &silent)?;
    let (raw, raw_ms) = bench.show(&raw, HISTORY, &silent)?;
    let (denoised, denoised_ms) = bench.show(&denoised, HISTORY, &silent)?;
    let samples = ((denoised_ms / sample_ms).round() as u32).max(1);
    let (noisy, _) = bench.show(&reference, samples - 1, &silent)?;
    let (truth, origin) = match file {
        Some((_, pixels)) => {
            let pixels: Picture = pixels.iter().map(|[r, g, b, _]| [r, g, b].map(|c| f64::from(*c))).collect();
            (Reference::new(&pixels, &pixels, size), "converged, by an independent renderer".into())
        }
        None => {
            let progress = Progress::new(u64::from(args.samples.next_multiple_of(2)));
            let truth = bench.reference(&reference, args.samples, &progress)?;
            (truth, format!("converged, {} samples per pixel", args.samples))
        }
    };

    files::create_folder(&args.out)?;
    let path = args.out.join(file_name(scene));
    let all = [&noisy, &raw, &denoised, truth.pixels()];
    write_png(&path, panels::grid(size, 2, &all, panels::exposure_for(size, truth.pixels()), LEAST_WIDTH))?;
    let path = path.canonicalize().unwrap_or(path);
    let plural = if samples == 1 { "" } else { "s" };
    println!("{}", path.display());
    let line = |place: &str, what: &str, ms: f64, picture: &Picture| {
        println!("  {place} {what}, {} ms, median block error {}", digits(ms), digits(truth.error(picture).median));
    };
    let path_traced = format!("reference path tracer, {samples} sample{plural} per pixel");
    line("top left:    ", &path_traced, sample_ms * f64::from(samples), &noisy);
    line("top right:   ", &format!("{name}, one frame without the denoiser"), raw_ms, &raw);
    line("bottom left: ", &format!("{name}, one frame with the denoiser"), denoised_ms, &denoised);
    println!("  bottom right: {origin}");
    Ok(())
}
