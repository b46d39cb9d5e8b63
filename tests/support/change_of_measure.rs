//! Decides whether a shift is a change of variables.  Pixels are paired; a shader writes for each pixel the measure of the samples that the
//! shift takes to the partner, and of those that the partner's shift takes here.  Over all pixels both sums are the same integral.

use super::{app::mean_and_error, stats::chi_squared_of_differences};
use bevy::math::Vec3;

/// Pixels along each side of the pictures.
pub const SIZE: usize = 32;
/// Pixels whose coordinates differ in these bits are partners (`PARTNER` in the shaders).
const PARTNER: (usize, usize) = (8, 4);

/// The relative difference of both sums with its standard error, and the p-value of both being equal in all tiles of 4 x 4 pixels.
pub struct Measure {
    difference: f64,
    error: f64,
    pub tiles: f64,
}

impl Measure {
    /// From the pixels of independent pictures: x is the measure of the samples that leave, and y of those that arrive.
    pub fn of(frames: &[Vec<Vec3>]) -> Self {
        let sum = |of: fn(&Vec3) -> f32| frames.iter().map(move |f| f.iter().map(|c| f64::from(of(c))).sum());
        let (mean, _) = mean_and_error(sum(|c| 0.5 * (c.x + c.y)));
        let (difference, error) = mean_and_error(sum(|c| c.x - c.y));
        // The measure that leaves a tile is compared with the measure that arrives at the partner of the tile.
        let tile = |x: usize, y: usize, of: fn(&Vec3) -> f32| -> Vec<f64> {
            let pixels = move |f: &Vec<Vec3>| (0..16).map(|i| f64::from(of(&f[(y + i / 4) * SIZE + x + i % 4]))).sum();
            frames.iter().map(pixels).collect()
        };
        let tiles = (0..SIZE / 4).flat_map(|y| (0..SIZE / 4).map(move |x| (4 * x, 4 * y)));
        let pairs = tiles.map(|(x, y)| (tile(x, y, |c| c.x), tile(x ^ PARTNER.0, y ^ PARTNER.1, |c| c.y)));
        // Pixels without a surface take no part.
        let pairs = pairs.filter(|(a, b)| [a, b].iter().all(|v| v.iter().filter(|s| **s > 0.0).count() > 20));
        let rounding = 1e-4 * mean / (SIZE * SIZE / 16) as f64;
        let tiles = chi_squared_of_differences(pairs, rounding);
        Self { difference: difference / mean, error: error / mean, tiles }
    }

    /// Two one-sided tests at the level 0.01: the sums differ by less than this margin.
    pub fn is_equal(&self, margin: f64) -> bool {
        self.difference.abs() + 2.33 * self.error < margin && self.tiles > 1e-4
    }
}

impl core::fmt::Display for Measure {
    fn fmt(&self, f: &mut core::fmt::Formatter) -> core::fmt::Result {
        write!(f, "{:+.2} % ± {:.2}, tiles p = {:.1e}", 100.0 * self.difference, 100.0 * self.error, self.tiles)
    }
}
