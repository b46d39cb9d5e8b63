//! The statistics of the tests: chi-squared and z-tests, with a fixed false alarm rate over a family of tests.

use statrs::distribution::{ChiSquared, ContinuousCDF, DiscreteCDF, Normal, Poisson, StudentsT};

/// The probability that a family of tests raises a false alarm.
pub const FAMILY_ALPHA: f64 = 1e-3;

/// Šidák: the level of each of `tests` tests so that the family has the level `FAMILY_ALPHA`.
pub fn sidak(tests: usize) -> f64 {
    1.0 - (1.0 - FAMILY_ALPHA).powf(1.0 / tests as f64)
}

/// Cells that together are expected to hold fewer counts than this are empty: counts in them are a failure by themselves.
const EMPTY: f64 = 1e-3;

/// The p-value of counts against expected counts: the smaller of two, with Bonferroni's correction.  One is chi-squared over the cells,
/// where those with an expectation below 5 are pooled.  The other is the probability of so many counts where almost none is expected;
/// pooling would hide them.
pub fn chi_squared(counts: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(counts.len(), expected.len());
    let mut order: Vec<usize> = (0..expected.len()).collect();
    order.sort_by(|&a, &b| expected[a].total_cmp(&expected[b]));
    let (mut in_empty, mut expected_in_empty, mut cells) = (0.0, 0.0, order.as_slice());
    while let [first, rest @ ..] = cells
        && expected_in_empty + expected[*first] < EMPTY
    {
        (in_empty, expected_in_empty, cells) = (in_empty + counts[*first], expected_in_empty + expected[*first], rest);
    }
    let empty = if in_empty == 0.0 {
        1.0
    } else if expected_in_empty == 0.0 {
        0.0
    } else {
        Poisson::new(expected_in_empty).map_or(0.0, |d| d.sf(in_empty as u64 - 1))
    };
    (2.0 * empty.min(chi_squared_of_pooled(counts, expected, cells))).min(1.0)
}

/// Chi-squared over cells in ascending order of their expectation.
fn chi_squared_of_pooled(counts: &[f64], expected: &[f64], order: &[usize]) -> f64 {
    let (mut statistic, mut cells) = (0.0, 0usize);
    let (mut pooled_count, mut pooled) = (0.0, 0.0);
    for &i in order {
        (pooled_count, pooled) = (pooled_count + counts[i], pooled + expected[i]);
        if pooled >= 5.0 {
            statistic += (pooled_count - pooled).powi(2) / pooled;
            cells += 1;
            (pooled_count, pooled) = (0.0, 0.0);
        }
    }
    if pooled > 0.0 || pooled_count > 0.0 {
        let pooled = pooled.max(0.1);
        statistic += (pooled_count - pooled).powi(2) / pooled;
        cells += 1;
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

/// Runs statistical tests.  A test that fails goes on to four runs with different seeds, which are judged together.
#[track_caller]
pub fn assert_family<'a>(tests: impl IntoIterator<Item = Statistical<'a>>) {
    let failures = failures_of_family(tests);
    assert!(failures.is_empty(), "{} failed:\n{}", failures.len(), failures.join("\n"));
}

/// The names and p-values of the tests that fail, over four runs, at the level of the family.
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
            let pooled = fisher(&[first, p(2), p(3), p(4)]);
            eprintln!("{name}: p = {first:e}, over four runs {pooled:e}");
            (pooled.is_nan() || pooled < level).then(|| format!("{name}: p = {first:e}, over four runs {pooled:e}"))
        })
        .collect()
}

/// The p-value of independent p-values together (Fisher 1925).
pub fn fisher(p: &[f64]) -> f64 {
    let statistic: f64 = p.iter().map(|p| -2.0 * p.ln()).sum();
    ChiSquared::new(2.0 * p.len() as f64).map_or(0.0, |d| if statistic.is_finite() { d.sf(statistic) } else { 0.0 })
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
