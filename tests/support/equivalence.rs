//! Whether two techniques show one picture: means of independent restarts, of the image and of its tiles (design 8.3).

use super::{app::Picture, stats};
use bevy::math::UVec2;

/// Pixels a side of a tile.
const TILE: u32 = 8;

/// Means of independent restarts of one technique: of the whole image, and of every tile; without the light that is seen emitted.
#[derive(Clone, Debug)]
pub struct Restarts {
    emission: Picture,
    pub images: Vec<f64>,
    pub tiles: Vec<Vec<f64>>,
}

impl Restarts {
    pub fn new(emission: Picture) -> Self {
        Self { emission, images: Vec::new(), tiles: Vec::new() }
    }

    /// Adds a restart.
    pub fn add(&mut self, picture: &Picture) {
        let across = picture.size.x.div_ceil(TILE);
        let mut tiles = vec![(0.0, 0.0); (across * picture.size.y.div_ceil(TILE)) as usize];
        for (UVec2 { x, y }, color) in picture.iter() {
            let tile = &mut tiles[(y / TILE * across + x / TILE) as usize];
            let scattered = color - self.emission.at(x, y);
            *tile = (tile.0 + f64::from(scattered.element_sum()) / 3.0, tile.1 + 1.0);
        }
        self.images.push(picture.mean() - self.emission.mean());
        self.tiles.push(tiles.into_iter().map(|(sum, n)| sum / n).collect());
    }

    pub fn mean(&self) -> f64 {
        self.images.iter().sum::<f64>() / self.images.len() as f64
    }

    fn tile(&self, i: usize) -> Vec<f64> {
        self.tiles.iter().map(|t| t[i]).collect()
    }

    /// The p-value of the images being equal within `margin` of `truth`.
    pub fn tost(&self, truth: &Self, margin: f64) -> f64 {
        stats::tost(&self.images, &truth.images, margin * truth.mean())
    }

    /// Difference of the means over the standard error of it, and the difference relative to `truth`.
    pub fn difference(&self, truth: &Self) -> (f64, f64) {
        let w = stats::welch(&self.images, &truth.images);
        (w.difference / w.error, w.difference / truth.mean())
    }

    /// The p-value of all tiles being equal: chi-squared of their z-scores.
    pub fn tiles_p(&self, truth: &Self) -> f64 {
        let pairs = (0..self.tiles[0].len()).map(|i| (self.tile(i), truth.tile(i)));
        stats::chi_squared_of_differences(pairs, 1e-4 * truth.mean())
    }
}
