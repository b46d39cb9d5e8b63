//! Whether means differ by more than their own noise, with a limit for thousands of comparisons.

/// Standard errors that a comparison of many values may reach: one of 1.7 million reaches them by chance.
const ERRORS: f64 = 5.0;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The mean of independent values and its standard error.
pub fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let (n, mean) = (values.len() as f64, mean(values));
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (squares / (n * (n - 1.0))).sqrt())
}

/// Difference of the means of two series in standard errors.
pub fn difference(before: &[f64], after: &[f64]) -> f64 {
    let ((before, of_before), (after, of_after)) = (mean_and_error(before), mean_and_error(after));
    let difference = after - before;
    if difference == 0.0 { 0.0 } else { difference / of_before.hypot(of_after) }
}

/// Slope of a series in standard errors.
pub fn slope(values: &[f64]) -> f64 {
    let (n, mean) = (values.len() as f64, mean(values));
    let from_middle = |i: usize| i as f64 - 0.5 * (n - 1.0);
    let squares: f64 = (0..values.len()).map(|i| from_middle(i).powi(2)).sum();
    let slope = values.iter().enumerate().map(|(i, value)| from_middle(i) * (value - mean)).sum::<f64>() / squares;
    let rest = values.iter().enumerate().map(|(i, value)| (value - mean - slope * from_middle(i)).powi(2)).sum::<f64>();
    if slope == 0.0 { 0.0 } else { slope / (rest / (n - 2.0) / squares).sqrt() }
}

/// [`ERRORS`] for standard errors that are estimated from this many values.
pub fn limit(values: usize) -> f64 {
    student(ERRORS, values as f64 - 2.0)
}

/// The number of standard errors, estimated with this many degrees of freedom, that chance exceeds as seldom as a normal variable exceeds `z`: a
/// quantile of Student's distribution by the expansion of Cornish and Fisher.
pub fn student(z: f64, freedom: f64) -> f64 {
    let freedom = freedom.max(1.0);
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    let third = (3.0 * z.powi(7) + 19.0 * z.powi(5) + 17.0 * z.powi(3) - 15.0 * z) / 384.0;
    z + first / freedom + second / freedom.powi(2) + third / freedom.powi(3)
}
