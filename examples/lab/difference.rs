//! The difference of a picture from a reference, in figures.

use bevy::{
    color::{ColorToPacked, LinearRgba, Srgba},
    math::UVec2,
};
use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8, FlipPool};
use serde_json::{Value, json};

use crate::{
    blocks,
    error::{Picture, mean},
    table::{Row, Unit},
};

/// Weights of the channels in luminance.
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// Luminance of the mean of a reference on the screen, before tone mapping, where FLIP compares pictures.
const FLIP_EXPOSURE: f64 = 0.5;

/// All figures; a figure is not finite where it divides by zero.
pub struct Difference {
    /// Relative difference of the means, over all channels and per channel.
    pub rel_mean: f64,
    pub rel_mean_rgb: [f64; 3],
    /// Relative difference of the tiles' luminance: mean, 95th percentile and maximum of its amount, and the signed mean.
    pub tile_abs_mean: f64,
    tile_abs_p95: f64,
    pub tile_abs_max: f64,
    pub tile_bias: f64,
    /// Over pixels and channels: root mean square error, and squared error relative to the reference.
    pub rmse: f64,
    pub rel_mse: f64,
    /// Absolute error relative to the reference plus a hundredth of its mean, over pixels and channels.
    pub mape: f64,
    /// `rel_mse` without the worst hundredth of the pixels, which single bright pixels would decide.
    pub rel_mse_trimmed: f64,
    /// Share of pixels that are black although the reference has more than a twentieth of its mean there and in the eight pixels around
    /// it.  Where one of those is dark, the pixel may show an edge, behind which the one camera ray of a frame finds nothing.
    pub black: f64,
    /// Mean of the perceived difference of the tone-mapped pictures (Andersson et al. 2020, LDR-FLIP at 67 pixels a degree).
    pub flip: f64,
    /// Number of pixels with a channel that is not finite.
    pub non_finite: usize,
}

impl Difference {
    /// Both pictures must have one size, and the reference must be finite.
    pub fn new(mut picture: Picture, reference: &Picture, size: UVec2, tile: usize) -> Self {
        let non_finite = blacken(&mut picture);
        let scale = mean(reference, |c| c);
        let (ours, theirs) = (channel_means(&picture), channel_means(reference));
        let tiles = relative(&tiles(&picture, size.x as usize, tile), &tiles(reference, size.x as usize, tile));
        let mut amounts: Vec<f64> = tiles.iter().map(|t| t.abs()).collect();
        amounts.sort_by(f64::total_cmp);
        let over_all = |of: &dyn Fn(f64, f64) -> f64| {
            let pairs = picture.iter().flatten().zip(reference.iter().flatten());
            pairs.map(|(&c, &r)| of(c, r)).sum::<f64>() / (3 * reference.len()) as f64
        };
        let rel_square = |c: f64, r: f64| (c - r).powi(2) * relative_weight(r, scale);
        let both = || picture.iter().zip(reference);
        let mut errors: Vec<f64> =
            both().map(|(c, r)| average(&core::array::from_fn::<_, 3, _>(|i| rel_square(c[i], r[i])))).collect();
        errors.sort_by(f64::total_cmp);
        errors.truncate(errors.len() - errors.len() / 100);
        let lost = |i: usize| picture[i] == [0.0; 3] && is_lit_around(reference, size, i, 0.05 * scale);
        Self {
            rel_mean: (mean(&picture, |c| c) - scale) / scale,
            rel_mean_rgb: core::array::from_fn(|i| (ours[i] - theirs[i]) / theirs[i].max(1e-9)),
            tile_abs_mean: average(&amounts),
            tile_abs_p95: quantile(&amounts, 0.95),
            tile_abs_max: quantile(&amounts, 1.0),
            tile_bias: average(&tiles),
            rmse: over_all(&|c, r| (c - r).powi(2)).sqrt(),
            rel_mse: over_all(&rel_square),
            mape: over_all(&|c, r| relative_error(c, r, scale)),
            rel_mse_trimmed: average(&errors),
            black: (0..reference.len()).filter(|&i| lost(i)).count() as f64 / reference.len() as f64,
            flip: flip(&picture, reference, size),
            non_finite,
        }
    }

    pub fn json(&self) -> Value {
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
            "flip": self.flip,
            "non_finite": self.non_finite,
        })
    }

    /// The figures of the JSON as rows of a table.
    pub fn rows(&self) -> Vec<Row> {
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
            row("rmse", Unit::Plain, self.rmse),
            row("rel_mse", Unit::Relative, self.rel_mse),
            row("mape", Unit::Relative, self.mape),
            row("rel_mse_trimmed", Unit::Relative, self.rel_mse_trimmed),
            row("black", Unit::Relative, self.black),
            row("flip", Unit::Plain, self.flip),
            row("non_finite", Unit::Count, self.non_finite as f64),
        ]
    }
}

/// The factor of a squared error relative to the reference.  A hundredth of the mean's square keeps nearly black pixels from dominating.
pub fn relative_weight(reference: f64, mean: f64) -> f64 {
    (reference * reference + 1e-2 * mean * mean).recip()
}

/// The amount of an error relative to the reference.  A hundredth of the mean keeps nearly black pixels from dominating.
pub fn relative_error(value: f64, reference: f64, mean: f64) -> f64 {
    (value - reference).abs() / (reference + 0.01 * mean)
}

/// Mean FLIP of the pictures as a screen would show them: exposed by the reference, then tone-mapped by x / (1 + x).
fn flip(picture: &Picture, reference: &Picture, size: UVec2) -> f64 {
    let exposure = FLIP_EXPOSURE / average(&reference.iter().map(luminance).collect::<Vec<_>>()).max(f64::MIN_POSITIVE);
    let shown = |picture: &Picture| {
        let mapped = |c: f64| (c.max(0.0) * exposure / (1.0 + c.max(0.0) * exposure)) as f32;
        let byte = |pixel: &[f64; 3]| {
            let [r, g, b] = pixel.map(mapped);
            Srgba::from(LinearRgba::rgb(r, g, b)).to_u8_array_no_alpha()
        };
        let bytes: Vec<u8> = picture.iter().flat_map(byte).collect();
        FlipImageRgb8::with_data(size.x, size.y, &bytes)
    };
    let map = nv_flip::flip(shown(reference), shown(picture), DEFAULT_PIXELS_PER_DEGREE);
    f64::from(FlipPool::from_image(&map).mean())
}

fn luminance(pixel: &[f64; 3]) -> f64 {
    pixel.iter().zip(LUMINANCE).map(|(c, weight)| c * weight).sum()
}

/// Whether a pixel and those around it are brighter than `least`.
fn is_lit_around(reference: &Picture, size: UVec2, pixel: usize, least: f64) -> bool {
    around(pixel, size).all(|i| reference[i].iter().sum::<f64>() > 3.0 * least)
}

/// A pixel and those that touch it.
pub fn around(pixel: usize, size: UVec2) -> impl Iterator<Item = usize> {
    let (width, height) = (size.x as usize, size.y as usize);
    let range = |at: usize, length: usize| at.saturating_sub(1)..=(at + 1).min(length - 1);
    let columns = range(pixel % width, width);
    range(pixel / width, height).flat_map(move |y| columns.clone().map(move |x| y * width + x))
}

pub fn is_finite(pixel: &[f64; 3]) -> bool {
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
    let complete = (tile as f64).powi(2);
    let tiles = blocks::of(picture.iter().map(luminance), width, tile).into_iter();
    tiles.filter(|tile| tile.pixels == complete).map(|tile| tile.mean).collect()
}

/// Differences relative to the reference, or to a fiftieth of its mean where it is darker.
fn relative(ours: &[f64], theirs: &[f64]) -> Vec<f64> {
    let least = 0.02 * average(theirs);
    ours.iter().zip(theirs).map(|(a, r)| (a - r) / r.max(least)).collect()
}

/// The mean, or NaN if there are no values.
fn average(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// A quantile of sorted values by linear interpolation, or NaN if there are no values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let at = share * last as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * at.fract()
}
