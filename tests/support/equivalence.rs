//! Whether two techniques show one picture: means of independent restarts, of the image, of its regions and of its tiles (design 8.3).

use super::{
    app::Picture,
    stats::{self, FAMILY_ALPHA},
};
use bevy::math::UVec2;
use std::fmt;

/// Pixels a side of a tile.
const TILE: u32 = 8;
/// Pixels a side of a region.
const REGION: u32 = 32;
/// Level of the two one-sided tests.
pub const ALPHA: f64 = 0.01;
/// Relative difference that regions may have.
const REGION_MARGIN: f64 = 0.03;

/// Restarts of one technique, and frames that each is the mean of.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    pub restarts: u32,
    pub frames: u32,
}

/// Means of independent restarts of one technique: of the whole image, of regions and of tiles; without the light that is seen emitted.
#[derive(Clone, Debug)]
pub struct Restarts {
    emission: Picture,
    /// Pixels that are compared; all where there is none.
    pub compared: Option<Vec<bool>>,
    pub images: Vec<f64>,
    pub regions: Vec<Vec<f64>>,
    pub tiles: Vec<Vec<f64>>,
}

impl Restarts {
    pub fn new(emission: Picture) -> Self {
        Self { emission, compared: None, images: Vec::new(), regions: Vec::new(), tiles: Vec::new() }
    }

    /// Adds a restart.
    pub fn add(&mut self, picture: &Picture) {
        self.images.push(self.squares(picture, picture.size.max_element())[0]);
        self.regions.push(self.squares(picture, REGION));
        self.tiles.push(self.squares(picture, TILE));
    }

    /// Adds a restart of which this much was seen emitted.
    pub fn add_without(&mut self, picture: &Picture, emission: Picture) {
        self.emission = emission;
        self.add(picture);
    }

    /// Means over squares of so many pixels a side.
    fn squares(&self, picture: &Picture, side: u32) -> Vec<f64> {
        let across = picture.size.x.div_ceil(side);
        let mut squares = vec![(0.0, 0.0f64); (across * picture.size.y.div_ceil(side)) as usize];
        for (i, (UVec2 { x, y }, color)) in picture.iter().enumerate() {
            if self.compared.as_ref().is_none_or(|compared| compared[i]) {
                let square = &mut squares[(y / side * across + x / side) as usize];
                let scattered = color - self.emission.at(x, y);
                *square = (square.0 + f64::from(scattered.element_sum()) / 3.0, square.1 + 1.0);
            }
        }
        squares.into_iter().map(|(sum, n)| sum / n.max(1.0)).collect()
    }

    pub fn mean(&self) -> f64 {
        self.images.iter().sum::<f64>() / self.images.len() as f64
    }

    /// Holds these against the truth.
    pub fn compare(&self, truth: &Self, margin: f64) -> Comparison {
        let mean = truth.mean();
        let w = stats::welch(&self.images, &truth.images);
        Comparison {
            difference: w.difference / mean,
            error: w.error / mean,
            power: stats::tost_power(&w, margin * mean, ALPHA),
            tost: stats::tost(&self.images, &truth.images, margin * mean),
            regions: pairs(&self.regions, &truth.regions)
                .map(|(ours, theirs)| {
                    // Of dark regions the margin is that of one a tenth as bright as the image.
                    let light = theirs.iter().sum::<f64>() / theirs.len() as f64;
                    stats::tost(&ours, &theirs, REGION_MARGIN * light.max(0.1 * mean))
                })
                .fold(0.0, f64::max),
            tiles: stats::chi_squared_of_differences(pairs(&self.tiles, &truth.tiles), 1e-4 * mean),
        }
    }

    /// The p-value of the images being equal within `margin` of `truth`.
    pub fn tost(&self, truth: &Self, margin: f64) -> f64 {
        self.compare(truth, margin).tost
    }

    /// Difference of the means over the standard error of it, and the difference relative to `truth`.
    pub fn difference(&self, truth: &Self) -> (f64, f64) {
        let c = self.compare(truth, 1.0);
        (c.sigma(), c.difference)
    }

    /// The p-value of all tiles being equal: chi-squared of their z-scores.
    pub fn tiles_p(&self, truth: &Self) -> f64 {
        self.compare(truth, 1.0).tiles
    }
}

/// The restarts' values of every square, of both sides.
fn pairs(ours: &[Vec<f64>], theirs: &[Vec<f64>]) -> impl Iterator<Item = (Vec<f64>, Vec<f64>)> {
    let of = |all: &[Vec<f64>], i: usize| all.iter().map(|restart| restart[i]).collect();
    (0..ours[0].len()).map(move |i| (of(ours, i), of(theirs, i)))
}

/// What a technique differs by, relative to the truth, and how sure that is.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    pub difference: f64,
    /// Standard error of the difference.
    pub error: f64,
    /// Probability that the two one-sided tests succeed where there is no difference.
    pub power: f64,
    /// p-value of the images being equal within the margin.
    pub tost: f64,
    /// The greatest p-value of a region being equal within 3 %.
    pub regions: f64,
    /// p-value of all tiles being equal.
    pub tiles: f64,
}

impl Comparison {
    pub fn sigma(&self) -> f64 {
        self.difference / self.error
    }

    pub fn is_equal(&self) -> bool {
        self.tost < ALPHA && self.regions < ALPHA && self.tiles >= FAMILY_ALPHA
    }

    /// It is shown to differ by more than chance and not only for want of power.
    pub fn is_different(&self) -> bool {
        (self.tost >= ALPHA && self.sigma().abs() > 4.0) || self.tiles < FAMILY_ALPHA
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { difference, power, tost, regions, tiles, .. } = self;
        write!(f, "off by {:+.3} % ({:+.1} σ), power {power:.3}, ", 100.0 * difference, self.sigma())?;
        write!(f, "TOST p = {tost:.1e}, regions p = {regions:.1e}, tiles p = {tiles:.1e}")
    }
}
