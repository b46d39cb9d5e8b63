//! Which settings the advice of a sweep may name.

/// Share of a squared error from which on the bias decides it.
const MOST: f64 = 0.5;
/// Number of standard errors from which on a bias is no noise.
const SIGNIFICANT: f64 = 3.0;

/// The part of a squared error that is bias, and that no further frame removes.  `block_bias`: root mean square of the bias of blocks, relative
/// to the picture as the error is.
pub fn share_of_bias(block_bias: f64, squared_error: f64) -> f64 {
    // The error lacks the worst pixels, and the bias does not.
    (block_bias.powi(2) / squared_error.max(f64::MIN_POSITIVE)).min(1.0)
}

/// Whether most of the error is bias.  `bias`: relative difference of the mean, and its standard error.
pub fn is_mostly_bias(bias: [f64; 2], share: f64) -> bool {
    let [difference, standard_error] = bias;
    share > MOST && difference.abs() > SIGNIFICANT * standard_error
}
