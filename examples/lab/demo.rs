//! Pictures that show what ReSTIR is for: the reference path tracer, ReSTIR PT in the same time, and the converged picture.

use bevy::{
    asset::RenderAssetUsages,
    image::Image,
    math::UVec2,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_restir::{Restir, Technique};
use bevy_restir_support::{arguments, exposure::measure, exr_file, picture::write_png, progress::Progress};
use std::path::PathBuf;

use crate::{
    bench::{Bench, Counts, Scene, scenes},
    error::{Picture, Reference},
};

/// One picture per scene with three panels: the reference path tracer in the time of one frame of ReSTIR PT, that frame, and the
/// converged picture. The printed errors are medians over blocks of 8 x 8 pixels of the squared error, relative to the squared mean.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// glTF files; `references.json` beside a file may name its environment.
    #[arg(required = true)]
    scenes: Vec<PathBuf>,
    /// Folder for the pictures.
    #[arg(long, default_value = "target/demo")]
    out: PathBuf,
    /// Size of a panel in pixels. Without it SCENE.exr beside SCENE.glb is the converged picture and gives the size.
    #[arg(long, value_parser = arguments::size)]
    size: Option<UVec2>,
    /// Maximum number of scattering events of a path.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=64))]
    bounces: u32,
    /// Samples per pixel of the converged picture where it is rendered.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(2..))]
    samples: u32,
}

/// Frames before the one that ReSTIR shows.
const HISTORY: u32 = 16;
/// Frames that measure the time of a sample of the reference path tracer.
const TIMED: u32 = 4;
/// Size of a panel where no file gives it.
const SIZE: UVec2 = UVec2::splat(288);
/// Least width of the whole picture in pixels: small panels are enlarged without smoothing.
const LEAST_WIDTH: usize = 800;
/// Width of the lines between the panels in pixels.
const LINE: usize = 4;

pub fn run(args: &Args) -> Result<(), String> {
    std::fs::create_dir_all(&args.out).map_err(|e| format!("{}: {e}", args.out.display()))?;
    for scene in scenes(&args.scenes)? {
        compare(args, &scene).map_err(|error| format!("{}: {error}", scene.1))?;
    }
    Ok(())
}

/// Renders the three panels of a scene and prints what they show.
fn compare(args: &Args, scene: &Scene) -> Result<(), String> {
    let file = scene.0.with_extension("exr");
    let file = (args.size.is_none() && file.is_file()).then(|| exr_file::read(&file)).transpose()?;
    let size = file.as_ref().map_or(args.size.unwrap_or(SIZE), |file| file.0);
    // The reference files are made without energy compensation.
    let settings =
        |technique| Restir { technique, bounces: args.bounces, energy_compensation: false, ..Restir::default() };
    let (reference, restir) = (settings(Technique::Reference), settings(Technique::Pt));
    let mut bench = Bench::of_scene(scene, size, reference.clone(), &Counts { warmup: HISTORY, frames: TIMED })?;
    let silent = Progress::hidden();
    let (_, sample_ms) = bench.show(&reference, TIMED, &silent)?;
    let (resampled, frame_ms) = bench.show(&restir, HISTORY, &silent)?;
    let samples = ((frame_ms / sample_ms).round() as u32).max(1);
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

    let path = args.out.join(format!("{}.png", scene.1));
    write_png(&path, side_by_side(size, [&noisy, &resampled, truth.pixels()]))?;
    let path = path.canonicalize().unwrap_or(path);
    let plural = if samples == 1 { "" } else { "s" };
    println!("{}", path.display());
    println!(
        "  left:   reference path tracer, {samples} sample{plural} per pixel, {:.0} ms, median block error {:.2}",
        sample_ms * f64::from(samples),
        truth.error(&noisy).median
    );
    println!(
        "  middle: ReSTIR PT, one frame, {frame_ms:.0} ms, median block error {:.2}",
        truth.error(&resampled).median
    );
    println!("  right:  {origin}");
    Ok(())
}

/// Panels from left to right, exposed for the last one.
fn side_by_side(size: UVec2, panels: [&Picture; 3]) -> Image {
    let (width, height) = (size.x as usize, size.y as usize);
    let last = panels[2].iter().map(|p| p.map(|c| c as f32));
    let exposure = measure(size, last).luminance.map_or(1.0, |luminance| 0.18 / f64::from(luminance));
    let zoom = LEAST_WIDTH.div_ceil(3 * width);
    let (panel, rows) = (zoom * width, zoom * height);
    let whole = 3 * panel + 2 * LINE;
    let mut bytes = vec![255u8; 4 * whole * rows];
    for (i, pixels) in panels.into_iter().enumerate() {
        for (x, y) in (0..rows).flat_map(|y| (0..panel).map(move |x| (x, y))) {
            let pixel = pixels[y / zoom * width + x / zoom];
            let first = 4 * (y * whole + i * (panel + LINE) + x);
            bytes[first..first + 3].copy_from_slice(&pixel.map(|c| tonemapped(c * exposure)));
        }
    }
    let extent = Extent3d { width: whole as u32, height: rows as u32, depth_or_array_layers: 1 };
    Image::new(extent, TextureDimension::D2, bytes, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::MAIN_WORLD)
}

/// A channel of a pixel on an sRGB screen: linear in the dark, saturating smoothly.
fn tonemapped(channel: f64) -> u8 {
    let linear = 1.0 - (-1.2 * channel.max(0.0)).exp();
    let encoded = if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}
