//! Compares a picture with a reference, both from files.

use bevy::math::UVec2;
use bevy_restir_support::exr_file;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

use crate::{
    error::{Picture, mean},
    output::{Output, provenance},
    table::{Row, Table, Unit},
};

/// Compares a linear picture with a reference: a line of JSON, with `null` for undefined figures, and a table.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// A linear .exr file; pixels that are not finite are counted and compared as black.
    picture: PathBuf,
    /// The reference, a .exr file of the same size.
    reference: PathBuf,
    #[command(flatten)]
    output: Output,
    /// Side of a tile in pixels; incomplete tiles at the right and at the bottom are left out.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..))]
    tile: u32,
}

/// The table's name.
const NAME: &str = "compare";
/// Weights of the channels in luminance.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

pub fn run(args: &Args) -> Result<(), String> {
    let (size, picture) = read(&args.picture)?;
    let (wanted, reference) = read(&args.reference)?;
    if size != wanted {
        let (of, other) = (args.picture.display(), args.reference.display());
        return Err(format!("{of}: it has {} x {} pixels, {other} has {} x {}", size.x, size.y, wanted.x, wanted.y));
    }
    let unknown = reference.iter().filter(|pixel| !is_finite(pixel)).count();
    if unknown > 0 {
        return Err(format!("{}: {unknown} pixels of the reference are not finite", args.reference.display()));
    }
    let tile = args.tile as usize;
    let difference = Difference::new(picture, &reference, size.x as usize, tile);
    args.output.check(NAME)?;
    let mut header = provenance(None);
    header.push(format!("{} x {} pixels, tiles of {tile} x {tile}", size.x, size.y));
    let name = args.picture.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    args.output.write(NAME, &Table { header, columns: vec![(name, difference.rows())], notes: Vec::new() })?;
    println!("{}", difference.json());
    Ok(())
}

/// Reads the size and the channels of a file.
fn read(path: &Path) -> Result<(UVec2, Picture), String> {
    let (size, pixels) = exr_file::read(path)?;
    Ok((size, pixels.into_iter().map(|[r, g, b, _]| [r, g, b].map(f64::from)).collect()))
}

/// All figures; a figure is not finite where it divides by zero.
struct Difference {
    /// Relative difference of the means, over all channels and per channel.
    rel_mean: f64,
    rel_mean_rgb: [f64; 3],
    /// Relative difference of the tiles' luminance: mean, 95th percentile and maximum of its amount, and the signed mean.
    tile_abs_mean: f64,
    tile_abs_p95: f64,
    tile_abs_max: f64,
    tile_bias: f64,
    /// Over pixels and channels: root mean square error, squared error relative to the reference, absolute error relative to it.
    rmse: f64,
    rel_mse: f64,
    mape: f64,
    /// `rel_mse` without the worst hundredth of the pixels, which single bright pixels would decide.
    rel_mse_trimmed: f64,
    /// Share of pixels that are black although the reference has more than a twentieth of its mean there.
    black: f64,
    /// Number of pixels with a channel that is not finite.
    non_finite: usize,
}

impl Difference {
    /// Both pictures must have one size, and the reference must be finite.
    fn new(mut picture: Picture, reference: &Picture, width: usize, tile: usize) -> Self {
        let non_finite = blacken(&mut picture);
        let scale = mean(reference, |c| c);
        let (ours, theirs) = (channel_means(&picture), channel_means(reference));
        let tiles = relative(&tiles(&picture, width, tile), &tiles(reference, width, tile));
        let mut amounts: Vec<f64> = tiles.iter().map(|t| t.abs()).collect();
        amounts.sort_by(f64::total_cmp);
        let over_all = |of: &dyn Fn(f64, f64) -> f64| {
            let pairs = picture.iter().flatten().zip(reference.iter().flatten());
            pairs.map(|(&c, &r)| of(c, r)).sum::<f64>() / (3 * reference.len()) as f64
        };
        // A hundredth of the mean keeps nearly black pixels from dominating.
        let rel_square = |c: f64, r: f64| (c - r).powi(2) / (r * r + 1e-2 * scale * scale);
        let both = || picture.iter().zip(reference);
        let mut errors: Vec<f64> =
            both().map(|(c, r)| average(&core::array::from_fn::<_, 3, _>(|i| rel_square(c[i], r[i])))).collect();
        errors.sort_by(f64::total_cmp);
        errors.truncate(errors.len() - errors.len() / 100);
        let is_lost = |(c, r): &(&[f64; 3], &[f64; 3])| **c == [0.0; 3] && r.iter().sum::<f64>() / 3.0 > 0.05 * scale;
        Self {
            rel_mean: (mean(&picture, |c| c) - scale) / scale,
            rel_mean_rgb: core::array::from_fn(|i| (ours[i] - theirs[i]) / theirs[i].max(1e-9)),
            tile_abs_mean: average(&amounts),
            tile_abs_p95: quantile(&amounts, 0.95),
            tile_abs_max: quantile(&amounts, 1.0),
            tile_bias: average(&tiles),
            rmse: over_all(&|c, r| (c - r).powi(2)).sqrt(),
            rel_mse: over_all(&rel_square),
            mape: over_all(&|c, r| (c - r).abs() / (r + 0.01 * scale)),
            rel_mse_trimmed: average(&errors),
            black: both().filter(is_lost).count() as f64 / reference.len() as f64,
            non_finite,
        }
    }

    fn json(&self) -> Value {
        json!({
            "rel_mean": self.rel_mean,
            "rel_mean_rgb": self.rel_mean_rgb,
            "tile_abs_mean": self.tile_abs_mean,
            "tile_abs_p95": self.tile_abs_p95,
            "tile_abs_max": self.tile_abs_max,
            "tile_bias": self.tile_bias,
            "rmse": self.rmse,
            "rel_mse": self.rel_mse,
            "mape": self.mape,
            "rel_mse_trimmed": self.rel_mse_trimmed,
            "black": self.black,
            "non_finite": self.non_finite,
        })
    }

    /// The figures of the JSON as rows of a table.
    fn rows(&self) -> Vec<Row> {
        let row = |key, unit, value| Row::new("", key, &[("", unit, value)]);
        let [red, green, blue] = self.rel_mean_rgb;
        let channels = [("red", Unit::Relative, red), ("green", Unit::Relative, green), ("blue", Unit::Relative, blue)];
        vec![
            row("rel_mean", Unit::Relative, self.rel_mean),
            Row::new("", "rel_mean_rgb", &channels),
            row("tile_abs_mean", Unit::Relative, self.tile_abs_mean),
            row("tile_abs_p95", Unit::Relative, self.tile_abs_p95),
            row("tile_abs_max", Unit::Relative, self.tile_abs_max),
            row("tile_bias", Unit::Relative, self.tile_bias),
            row("rmse", Unit::Stored, self.rmse),
            row("rel_mse", Unit::Relative, self.rel_mse),
            row("mape", Unit::Relative, self.mape),
            row("rel_mse_trimmed", Unit::Relative, self.rel_mse_trimmed),
            row("black", Unit::Relative, self.black),
            row("non_finite", Unit::Count, self.non_finite as f64),
        ]
    }
}

fn is_finite(pixel: &[f64; 3]) -> bool {
    pixel.iter().all(|c| c.is_finite())
}

/// Replaces pixels that are not finite by black, and counts them.
fn blacken(picture: &mut [[f64; 3]]) -> usize {
    let mut count = 0;
    for pixel in picture.iter_mut().filter(|pixel| !is_finite(pixel)) {
        *pixel = [0.0; 3];
        count += 1;
    }
    count
}

fn channel_means(picture: &Picture) -> [f64; 3] {
    core::array::from_fn(|i| picture.iter().map(|pixel| pixel[i]).sum::<f64>() / picture.len() as f64)
}

/// Mean luminance of the complete tiles.
fn tiles(picture: &Picture, width: usize, tile: usize) -> Vec<f64> {
    let (columns, rows) = (width / tile, picture.len() / width / tile);
    let mut tiles = vec![0.0; columns * rows];
    for (i, pixel) in picture.iter().enumerate() {
        let (x, y) = (i % width / tile, i / width / tile);
        if x < columns && y < rows {
            let luminance: f64 = pixel.iter().zip(LUMINANCE).map(|(c, weight)| c * weight).sum();
            tiles[y * columns + x] += luminance / (tile * tile) as f64;
        }
    }
    tiles
}

/// Differences relative to the reference, or to a fiftieth of its mean where it is darker.
fn relative(ours: &[f64], theirs: &[f64]) -> Vec<f64> {
    let least = 0.02 * average(theirs);
    ours.iter().zip(theirs).map(|(a, r)| (a - r) / r.max(least)).collect()
}

/// The mean, or NaN of no values.
fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// A quantile of sorted values by linear interpolation, or NaN of no values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = share * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}
