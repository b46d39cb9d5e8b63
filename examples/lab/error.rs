//! How far a picture is from the converged one.

/// Linear radiance, rows from the top.
pub type Picture = Vec<[f64; 3]>;

/// A converged picture.
pub struct Reference {
    pixels: Picture,
    /// Squared mean of its pixels and channels: what errors are relative to, so that scenes compare.
    scale: f64,
    /// Its own mean squared error.
    pub noise: f64,
}

impl Reference {
    /// From two independent halves of its samples: the mean's variance is a quarter of their squared difference.
    pub fn new(a: &Picture, b: &Picture) -> Self {
        let both = |f: fn(f64, f64) -> f64| -> Picture {
            a.iter().zip(b).map(|(a, b)| core::array::from_fn(|i| f(a[i], b[i]))).collect()
        };
        let pixels = both(|a, b| 0.5 * (a + b));
        let scale = mean(&pixels, |c| c).powi(2).max(f64::MIN_POSITIVE);
        let noise = mean(&both(|a, b| 0.5 * (a - b)), |c| c * c) / scale;
        Self { pixels, scale, noise }
    }

    /// Mean squared error of a picture, relative.
    pub fn error(&self, picture: &Picture) -> f64 {
        let difference: Picture =
            picture.iter().zip(&self.pixels).map(|(p, r)| core::array::from_fn(|i| p[i] - r[i])).collect();
        mean(&difference, |c| c * c) / self.scale
    }
}

/// Mean over pixels and channels.
pub fn mean(pixels: &Picture, of: impl Fn(f64) -> f64) -> f64 {
    pixels.iter().flatten().map(|&c| of(c)).sum::<f64>() / (3 * pixels.len()).max(1) as f64
}
