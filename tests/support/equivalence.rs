//! Decides whether two techniques give the same picture, from independent restarts: means of the image, of its regions and of its tiles.
//! Frames of one run are correlated; restarts are not.

use super::{
    app::Picture,
    stats::{self, FAMILY_ALPHA},
};
use bevy::math::UVec2;
use std::fmt;

/// Width and height of a tile in pixels.
const TILE: u32 = 8;
/// Width and height of a region in pixels.
const REGION: u32 = 32;
/// The level of the two one-sided tests.
pub const ALPHA: f64 = 0.01;
/// The least power of a proof.  A proof with less could pass by chance only, so it fails and asks for more restarts.
const POWER: f64 = 0.9;
/// The smallest margin of regions; otherwise it is three times that of the image.
const REGION_MARGIN: f64 = 0.03;

/// The number of restarts, and of frames in the mean of each.
#[derive(Clone, Copy, Debug)]
pub struct Length {
    pub restarts: u32,
    pub frames: u32,
}

/// Means of independent restarts of one technique over the image, its regions and its tiles, without directly visible emission.  Restarts
/// without regions and tiles are compared by the means of the image alone.
#[derive(Clone, Debug, Default)]
pub struct Restarts {
    pub images: Vec<f64>,
    pub regions: Vec<Vec<f64>>,
    pub tiles: Vec<Vec<f64>>,
    /// The sum of all restarts for each pixel.
    pub pixels: Vec<f64>,
}

impl Restarts {
    /// Adds the restarts of a further run with other seeds.
    pub fn append(&mut self, further: Self) {
        self.images.extend(further.images);
        self.regions.extend(further.regions);
        self.tiles.extend(further.tiles);
        self.pixels.iter_mut().zip(further.pixels).for_each(|(sum, pixel)| *sum += pixel);
    }

    /// Adds a restart; `emission` is the directly visible emission.
    pub fn add(&mut self, picture: &Picture, emission: &Picture) {
        self.images.push(picture.mean() - emission.mean());
        self.regions.push(squares(picture, emission, REGION));
        self.tiles.push(squares(picture, emission, TILE));
        let pixels = squares(picture, emission, 1);
        self.pixels.resize(pixels.len(), 0.0);
        self.pixels.iter_mut().zip(pixels).for_each(|(sum, pixel)| *sum += pixel);
    }

    pub fn mean(&self) -> f64 {
        self.images.iter().sum::<f64>() / self.images.len() as f64
    }

    /// Compares these restarts with the truth.
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
                    // The margin of a dark region is that of a region with a tenth of the image's mean.
                    let light = theirs.iter().sum::<f64>() / theirs.len() as f64;
                    stats::tost(&ours, &theirs, REGION_MARGIN.max(3.0 * margin) * light.max(0.1 * mean))
                })
                .fold(0.0, f64::max),
            tiles: if self.tiles.is_empty() {
                1.0
            } else {
                stats::chi_squared_of_differences(pairs(&self.tiles, &truth.tiles), 1e-4 * mean)
            },
        }
    }
}

/// Means over squares of `side` pixels.
fn squares(picture: &Picture, emission: &Picture, side: u32) -> Vec<f64> {
    let across = picture.size.x.div_ceil(side);
    let mut squares = vec![(0.0, 0.0); (across * picture.size.y.div_ceil(side)) as usize];
    for (UVec2 { x, y }, color) in picture.iter() {
        let square = &mut squares[(y / side * across + x / side) as usize];
        let scattered = color - emission.at(x, y);
        *square = (square.0 + f64::from(scattered.element_sum()) / 3.0, square.1 + 1.0);
    }
    squares.into_iter().map(|(sum, n)| sum / n).collect()
}

/// The values of all restarts for each square, of both sides.
fn pairs(ours: &[Vec<f64>], theirs: &[Vec<f64>]) -> impl Iterator<Item = (Vec<f64>, Vec<f64>)> {
    let of = |all: &[Vec<f64>], i: usize| all.iter().map(|restart| restart[i]).collect();
    (0..ours.first().map_or(0, Vec::len)).map(move |i| (of(ours, i), of(theirs, i)))
}

/// The difference from the truth, relative to it, and its significance.
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    pub difference: f64,
    /// The standard error of the difference.
    pub error: f64,
    /// The probability that the two one-sided tests succeed if there is no difference.
    pub power: f64,
    /// The p-value of the images being equal within the margin.
    pub tost: f64,
    /// The largest p-value of a region being equal within its margin.
    pub regions: f64,
    /// The p-value of all tiles being equal.
    pub tiles: f64,
}

impl Comparison {
    pub fn sigma(&self) -> f64 {
        self.difference / self.error
    }

    pub fn is_equal(&self) -> bool {
        self.tost < ALPHA && self.regions < ALPHA && self.tiles >= FAMILY_ALPHA
    }

    /// Whether the number of restarts suffices for the margin.
    pub fn is_powerful(&self) -> bool {
        self.power >= POWER
    }

    /// Whether four times the length could not change the judgment: a difference of eight standard errors, or a p-value of tiles below
    /// 1e-12.
    pub fn is_hopeless(&self) -> bool {
        (self.tost >= ALPHA && self.sigma().abs() > 8.0) || self.tiles < 1e-12
    }

    /// Whether four times the length may turn this failure into a success.
    pub fn is_undecided(&self) -> bool {
        !self.is_equal() && !self.is_hopeless()
    }

    /// Asserts that there is no difference of the margin or more, and that the number of restarts suffices for this margin.
    #[track_caller]
    pub fn assert_equal(&self, name: &str) {
        assert!(self.is_equal(), "{name}: {self}");
        assert!(self.is_powerful(), "{name}: the power is below {POWER}, add restarts: {self}");
    }

    /// Whether a difference is significant, rather than the power too low.
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
