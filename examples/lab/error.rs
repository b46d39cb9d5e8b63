//! Error of a picture against a converged one.

use bevy::math::{DVec2, UVec2};

use crate::{blocks, difference::Difference};

/// Linear radiance, rows from the top.
pub type Picture = Vec<[f64; 3]>;

/// A picture that was traced with fewer pixels (`Restir::resolution_scale`), interpolated between their centers.  The plugin shows it with
/// sharper edges, because it knows the surfaces of the shown pixels.
pub fn enlarged(picture: Picture, traced: UVec2, size: UVec2) -> Picture {
    if traced == size {
        return picture;
    }
    let last = traced - 1;
    let at = |x: u32, y: u32| picture[(y.min(last.y) * traced.x + x.min(last.x)) as usize];
    let mix = |a: [f64; 3], b: [f64; 3], share: f64| core::array::from_fn(|i| a[i] + share * (b[i] - a[i]));
    let ratio = traced.as_dvec2() / size.as_dvec2();
    let shown = (0..size.y).flat_map(|y| (0..size.x).map(move |x| DVec2::new(f64::from(x), f64::from(y))));
    let pixel = |shown: DVec2| {
        let place = ((shown + 0.5) * ratio - 0.5).max(DVec2::ZERO);
        let (corner, share) = (place.as_uvec2(), place.fract());
        let row = |y: u32| mix(at(corner.x, y), at(corner.x + 1, y), share.x);
        mix(row(corner.y), row(corner.y + 1), share.y)
    };
    shown.map(pixel).collect()
}

/// Errors of a picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Error {
    /// Squared error of the whole picture, relative to the squared mean of the converged one.
    pub mean: f64,
    /// The median of that over blocks, which single fireflies hardly change.
    pub median: f64,
    /// `rel_mse`, `rel_mse_trimmed`, `mape` and `flip` of [`Difference`].
    pub rel_mse: f64,
    pub rel_mse_trimmed: f64,
    pub mape: f64,
    pub flip: f64,
}

impl Error {
    /// Errors that are not known.
    pub const UNKNOWN: Self = Self {
        mean: f64::NAN,
        median: f64::NAN,
        rel_mse: f64::NAN,
        rel_mse_trimmed: f64::NAN,
        mape: f64::NAN,
        flip: f64::NAN,
    };

    /// The mean of some errors.
    pub fn average(all: &[Self]) -> Self {
        let mean = |of: fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        Self {
            mean: mean(|e| e.mean),
            median: mean(|e| e.median),
            rel_mse: mean(|e| e.rel_mse),
            rel_mse_trimmed: mean(|e| e.rel_mse_trimmed),
            mape: mean(|e| e.mape),
            flip: mean(|e| e.flip),
        }
    }
}

/// A converged picture.
pub struct Reference {
    pixels: Picture,
    /// Half the difference of the two halves of the samples. Its square estimates the variance of a pixel.
    deviations: Picture,
    width: usize,
    /// Squared mean over pixels and channels. Errors are relative to it, so that scenes can be compared.
    scale: f64,
    /// Mean squared error of the converged picture itself.
    pub noise: f64,
}

impl Reference {
    /// Averages two independent halves of the samples. The variance of their mean is a quarter of their squared difference.
    pub fn new(a: &Picture, b: &Picture, size: UVec2) -> Self {
        let both = |f: fn(f64, f64) -> f64| -> Picture {
            a.iter().zip(b).map(|(a, b)| core::array::from_fn(|i| f(a[i], b[i]))).collect()
        };
        let pixels = both(|a, b| 0.5 * (a + b));
        let scale = mean(&pixels, |c| c).powi(2).max(f64::MIN_POSITIVE);
        let deviations = both(|a, b| 0.5 * (a - b));
        let noise = mean(&deviations, |c| c * c) / scale;
        Self { pixels, deviations, width: size.x as usize, scale, noise }
    }

    /// The converged radiance.
    pub fn pixels(&self) -> &Picture {
        &self.pixels
    }

    /// Half the differences of the two halves of the samples: estimates of the error, whose squares are precise only in the mean.
    pub fn deviations(&self) -> &Picture {
        &self.deviations
    }

    /// The error of a picture.
    pub fn error(&self, picture: &Picture) -> Error {
        let squares: Vec<f64> = picture
            .iter()
            .zip(&self.pixels)
            .map(|(p, r)| (0..3).map(|i| (p[i] - r[i]).powi(2)).sum::<f64>() / (3.0 * self.scale))
            .collect();
        let of_blocks = blocks::of(squares.iter().copied(), self.width, blocks::SIDE);
        let mut means: Vec<f64> = of_blocks.iter().map(|block| block.mean).collect();
        means.sort_by(f64::total_cmp);
        let size = UVec2::new(self.width as u32, (self.pixels.len() / self.width) as u32);
        let difference = Difference::new(picture.clone(), &self.pixels, size, blocks::SIDE);
        Error {
            mean: squares.iter().sum::<f64>() / squares.len() as f64,
            median: means[means.len() / 2],
            rel_mse: difference.rel_mse,
            rel_mse_trimmed: difference.rel_mse_trimmed,
            mape: difference.mape,
            flip: difference.flip,
        }
    }
}

/// Mean over pixels and channels.
pub fn mean(pixels: &Picture, of: impl Fn(f64) -> f64) -> f64 {
    pixels.iter().flatten().map(|&c| of(c)).sum::<f64>() / (3 * pixels.len()).max(1) as f64
}
