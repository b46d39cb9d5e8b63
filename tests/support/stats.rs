//! The statistics of the tests: chi-squared and z-tests, with a fixed false alarm rate over a family of tests.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};

/// The probability that a family of tests raises a false alarm.
pub const FAMILY_ALPHA: f64 = 1e-3;

/// Šidák: the level of each of `tests` tests so that the family has the level `FAMILY_ALPHA`.
pub fn sidak(tests: usize) -> f64 {
    1.0 - (1.0 - FAMILY_ALPHA).powf(1.0 / tests as f64)
}

/// The p-value of counts against expected counts.  Cells with an expectation below 5 are pooled; counts where (almost) nothing is
/// expected are a failure by themselves.
pub fn chi_squared(counts: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(counts.len(), expected.len());
    let mut order: Vec<usize> = (0..expected.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut statistic, mut cells) = (0.0, 0usize);
    let (mut pooled_count, mut pooled) = (0.0, 0.0);
    let mut add = |count: f64, expected: f64| {
        statistic += (count - expected).powi(2) / expected;
        cells += 1;
    };
    for i in order {
        if expected[i] < 5.0 {
            pooled_count += counts[i];
            pooled += expected[i];
            if pooled >= 5.0 {
                add(pooled_count, pooled);
                (pooled_count, pooled) = (0.0, 0.0);
            }
        } else {
            add(counts[i] + pooled_count, expected[i] + pooled);
            (pooled_count, pooled) = (0.0, 0.0);
        }
    }
    if pooled > 0.0 || pooled_count > 0.0 {
        add(pooled_count, pooled.max(0.1));
    }
    if cells < 2 {
        return if statistic < 25.0 { 1.0 } else { 0.0 };
    }
    ChiSquared::new((cells - 1) as f64).map_or(0.0, |d| d.sf(statistic))
}

/// The two-sided p-value of a mean against its expected value, from the sum and the sum of squares of `n` samples.
pub fn z_test(sum: f64, squares: f64, n: f64, value: f64) -> f64 {
    let mean = sum / n;
    let variance = (squares / n - mean * mean).max(0.0) / n;
    // Rounding of f32 samples does not count as evidence.
    let error = variance.sqrt() + 1e-6 * value.abs() + 1e-30;
    2.0 * Normal::standard().sf(((mean - value) / error).abs())
}

/// The mean of independent values and its standard error.
pub fn mean_and_error(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let values: Vec<f64> = values.into_iter().collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    (mean, (variance / n).sqrt())
}

/// A statistical test: its name, and its p-value as a function of a seed.
pub type Statistical<'a> = (String, Box<dyn Fn(u32) -> f64 + 'a>);

/// Runs statistical tests.  A failure is repeated once with another seed before it counts.
#[track_caller]
pub fn assert_family<'a>(tests: impl IntoIterator<Item = Statistical<'a>>) {
    let failures = failures_of_family(tests);
    assert!(failures.is_empty(), "{} failed:\n{}", failures.len(), failures.join("\n"));
}

/// The names and p-values of the tests that fail twice.
pub fn failures_of_family<'a>(tests: impl IntoIterator<Item = Statistical<'a>>) -> Vec<String> {
    let tests: Vec<_> = tests.into_iter().collect();
    let level = sidak(tests.len());
    tests
        .iter()
        .filter_map(|(name, p)| {
            let first = p(1);
            if first >= level {
                return None;
            }
            let second = p(2);
            (second.is_nan() || second < level).then(|| format!("{name}: p = {first:e}, then {second:e}"))
        })
        .collect()
}

/// A small random number generator for test inputs (`SplitMix64`).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn direction(&mut self) -> glam::DVec3 {
        let (z, phi) = (1.0 - 2.0 * self.unit(), std::f64::consts::TAU * self.unit());
        let r = (1.0 - z * z).sqrt();
        glam::DVec3::new(r * phi.cos(), r * phi.sin(), z)
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[(self.unit() * from.len() as f64) as usize]
    }
}

/// The difference of two means with its standard error and degrees of freedom (Welch 1947).
pub struct Welch {
    pub difference: f64,
    pub error: f64,
    pub freedom: f64,
}

/// Compares independent values of two kinds.
pub fn welch(a: &[f64], b: &[f64]) -> Welch {
    let of = |v: &[f64]| {
        let n = v.len() as f64;
        let mean = v.iter().sum::<f64>() / n;
        (mean, v.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0) / n, n - 1.0)
    };
    let ((mean_a, a, free_a), (mean_b, b, free_b)) = (of(a), of(b));
    let freedom = (a + b).powi(2) / (a * a / free_a + b * b / free_b).max(1e-300);
    Welch { difference: mean_a - mean_b, error: (a + b).sqrt().max(1e-300), freedom: freedom.max(1.0) }
}

/// Two one-sided t-tests (Schuirmann 1987): the p-value of the claim that two means differ by less than `margin`.
pub fn tost(a: &[f64], b: &[f64], margin: f64) -> f64 {
    let w = welch(a, b);
    let t = StudentsT::new(0.0, 1.0, w.freedom).expect("the number of degrees of freedom is positive");
    t.sf((margin - w.difference.abs()) / w.error)
}

/// The probability that [`tost`] finds two equal means equal at this level, with the given standard errors.
pub fn tost_power(w: &Welch, margin: f64, alpha: f64) -> f64 {
    let t = StudentsT::new(0.0, 1.0, w.freedom).expect("the number of degrees of freedom is positive");
    (2.0 * t.cdf(margin / w.error - t.inverse_cdf(1.0 - alpha)) - 1.0).max(0.0)
}

/// The p-value of all pairs having equal means: chi-squared of their z-scores.  Differences below `rounding` do not count as evidence.
pub fn chi_squared_of_differences(pairs: impl Iterator<Item = (Vec<f64>, Vec<f64>)>, rounding: f64) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (a, b) in pairs {
        let w = welch(&a, &b);
        let t = StudentsT::new(0.0, 1.0, w.freedom).expect("the number of degrees of freedom is positive");
        let p = t.sf(w.difference.abs() / w.error.hypot(rounding));
        let z = Normal::standard().inverse_cdf(p.clamp(1e-15, 0.5));
        sum += z * z;
        n += 1.0;
    }
    ChiSquared::new(n).map_or(0.0, |d| d.sf(sum))
}
