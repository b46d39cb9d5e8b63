//! The change of a picture, and figures with their noise.

/// Figures below this many standard errors are noise.
const NOISE: f64 = 3.0;

/// A figure and its standard error.
#[derive(Clone, Copy, Debug)]
pub struct Figure {
    pub value: f64,
    pub error: f64,
}

impl Figure {
    /// The ratio of the means of independent parts and their wholes.
    fn ratio(parts: &[f64], wholes: &[f64]) -> Self {
        let (n, whole) = (parts.len() as f64, wholes.iter().sum::<f64>());
        let value = parts.iter().sum::<f64>() / whole;
        let squares: f64 = parts.iter().zip(wholes).map(|(part, whole)| (part - value * whole).powi(2)).sum();
        Self { value, error: (squares * n / (n - 1.0)).sqrt() / whole }
    }

    /// The median, with an error by the quartiles, which few outliers do not change.
    pub fn median(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
        // Of normally distributed values, the standard deviation is 0.741 times the distance of the quartiles, and the error of the median is
        // 1.253 times that of the mean.
        let deviation = if sorted.len() > 1 { 0.741 * (at(0.75) - at(0.25)) } else { f64::NAN };
        Self { value: at(0.5), error: 1.253 * deviation / (sorted.len() as f64).sqrt() }
    }

    /// The greatest amount that counts as noise.
    pub fn noise(self) -> f64 {
        NOISE * self.error
    }

    /// Whether it may be noise.  A figure of a single value has no error, and may be noise, too.
    pub fn is_noise(self) -> bool {
        self.value == 0.0 || self.error.is_nan() || self.value.abs() <= self.noise()
    }

    /// The figure in percent of a number.
    pub fn percent_of(self, whole: f64) -> Self {
        Self { value: 100.0 * self.value / whole, error: 100.0 * self.error / whole }
    }
}

/// The change of a picture, in percent of its mean.
#[derive(Clone, Copy, Debug)]
pub struct Change {
    /// Change of the mean.
    pub light: Figure,
    /// Mean absolute change of a pixel and channel, without that of noise.
    pub pixels: Figure,
}

impl Change {
    /// By independent pictures of each of two scenes, at least two.
    ///
    /// The absolute change of noisy pictures would be too large.  The change of each pair of pictures is therefore counted with the sign that
    /// the mean of the other pairs has there.  Where a pixel changes by less than its noise, the figure is too low.
    pub fn new(before: &[Vec<[f64; 3]>], after: &[Vec<[f64; 3]>]) -> Self {
        let flat = |picture: &Vec<[f64; 3]>| picture.iter().flatten().copied().collect::<Vec<f64>>();
        let changes: Vec<Vec<f64>> = before
            .iter()
            .zip(after)
            .map(|(before, after)| flat(before).into_iter().zip(flat(after)).map(|(b, a)| a - b).collect())
            .collect();
        let values = changes[0].len();
        let sums: Vec<f64> = (0..values).map(|i| changes.iter().map(|change| change[i]).sum()).collect();
        let signed = |change: &Vec<f64>| {
            let of_others = |(c, sum): (&f64, &f64)| if sum == c { 0.0 } else { c * (sum - c).signum() };
            change.iter().zip(&sums).map(of_others).sum::<f64>() / values as f64
        };
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let wholes: Vec<f64> = before.iter().map(|picture| mean(&flat(picture))).collect();
        let light: Vec<f64> = changes.iter().map(|change| mean(change)).collect();
        let pixels: Vec<f64> = changes.iter().map(signed).collect();
        let percent = |parts: &[f64]| Figure::ratio(parts, &wholes).percent_of(1.0);
        Self { light: percent(&light), pixels: percent(&pixels) }
    }

    /// Whether no pixel changed at all.
    pub fn is_nothing(&self) -> bool {
        [self.light, self.pixels].iter().all(|figure| figure.value == 0.0 && figure.error == 0.0)
    }
}
