//! Error of a picture against a converged one.

use bevy::math::{DVec2, UVec2};

use crate::{
    blocks,
    difference::{Difference, around, relative_error},
};

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
    pub without_emitters: WithoutEmitters,
}

/// Errors of the pixels that see no emitter and lie beside none ([`Reference::without_emitters`]), relative to the same means as those of the
/// whole picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct WithoutEmitters {
    /// `mean`, `median` and `mape` of [`Error`].
    pub mean: f64,
    pub median: f64,
    pub mape: f64,
}

impl WithoutEmitters {
    const UNKNOWN: Self = Self { mean: f64::NAN, median: f64::NAN, mape: f64::NAN };
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
        without_emitters: WithoutEmitters::UNKNOWN,
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
            without_emitters: WithoutEmitters {
                mean: mean(|e| e.without_emitters.mean),
                median: mean(|e| e.without_emitters.median),
                mape: mean(|e| e.without_emitters.mape),
            },
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
    /// Whether a pixel sees no emitter and lies beside none; empty if that is not known.
    sees_no_emitter: Vec<bool>,
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
        Self { pixels, deviations, width: size.x as usize, scale, sees_no_emitter: Vec::new(), noise }
    }

    /// Measures [`Error::without_emitters`], too.  `emission`: the light that the camera sees without any scattering.
    pub fn without_emitters(self, emission: &Picture) -> Self {
        let size = self.size();
        let sees_none = |pixel: usize| around(pixel, size).all(|i| emission[i] == [0.0; 3]);
        Self { sees_no_emitter: (0..emission.len()).map(sees_none).collect(), ..self }
    }

    /// The share of the pixels that see no emitter and lie beside none.
    pub fn share_without_emitters(&self) -> f64 {
        let count = self.sees_no_emitter.iter().filter(|counts| **counts).count();
        count as f64 / self.sees_no_emitter.len() as f64
    }

    /// The converged radiance.
    pub fn pixels(&self) -> &Picture {
        &self.pixels
    }

    fn size(&self) -> UVec2 {
        UVec2::new(self.width as u32, (self.pixels.len() / self.width) as u32)
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
        let difference = Difference::new(picture.clone(), &self.pixels, self.size(), blocks::SIDE);
        Error {
            mean: squares.iter().sum::<f64>() / squares.len() as f64,
            median: median(of_blocks.iter().map(|block| block.mean)),
            rel_mse: difference.rel_mse,
            rel_mse_trimmed: difference.rel_mse_trimmed,
            mape: difference.mape,
            flip: difference.flip,
            without_emitters: self.error_without_emitters(picture, &squares),
        }
    }

    /// `squares`: the squared error of each pixel.
    fn error_without_emitters(&self, picture: &Picture, squares: &[f64]) -> WithoutEmitters {
        let counts = &self.sees_no_emitter;
        if counts.is_empty() {
            return WithoutEmitters::UNKNOWN;
        }
        let shares: Vec<f64> = counts.iter().map(|counts| f64::from(u8::from(*counts))).collect();
        let counted = |values: &[f64]| -> Vec<f64> {
            values.iter().zip(counts).map(|(value, counts)| if *counts { *value } else { 0.0 }).collect()
        };
        let mean_of = |values: &[f64]| counted(values).iter().sum::<f64>() / shares.iter().sum::<f64>();
        // Means over the pixels of a block that count.
        let blocks_of = |values: &[f64]| blocks::of(values.iter().copied(), self.width, blocks::SIDE);
        let of_blocks = blocks_of(&counted(squares)).into_iter().zip(blocks_of(&shares));
        let of_blocks = of_blocks.filter(|(_, share)| share.mean > 0.0).map(|(square, share)| square.mean / share.mean);
        let scale = self.scale.sqrt();
        let relative =
            |(c, r): (&[f64; 3], &[f64; 3])| (0..3).map(|i| relative_error(c[i], r[i], scale)).sum::<f64>() / 3.0;
        let relative: Vec<f64> = picture.iter().zip(&self.pixels).map(relative).collect();
        WithoutEmitters { mean: mean_of(squares), median: median(of_blocks), mape: mean_of(&relative) }
    }
}

/// The median, or NaN if there are no values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Mean over pixels and channels.
pub fn mean(pixels: &Picture, of: impl Fn(f64) -> f64) -> f64 {
    pixels.iter().flatten().map(|&c| of(c)).sum::<f64>() / (3 * pixels.len()).max(1) as f64
}
