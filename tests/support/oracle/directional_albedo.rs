//! The fraction of light that GGX microfacets reflect with a single bounce, for the table of energy compensation (Turquin 2019).

use bevy_restir::testing::material::directional_albedo::SIZE;

/// Directional albedo of GGX reflection with F = 1: the mean of G2/G1 over visible normals, by the midpoint rule on `n` x `n` cells.  The error
/// is below 2.5 / n².
pub fn directional_albedo(alpha: f64, cos_o: f64, n: usize) -> f64 {
    let sin_o = (1.0 - cos_o * cos_o).max(0.0).sqrt();
    let smith = |cos: f64, sin: f64| 0.5 * ((1.0 + (alpha * sin / cos).powi(2)).sqrt() - 1.0);
    let lambda_o = smith(cos_o, sin_o);
    // Maps each cell to a visible normal by spherical caps (Dupuy and Benyoub 2023).
    let length = ((alpha * sin_o).powi(2) + cos_o * cos_o).sqrt();
    let stretched = [alpha * sin_o / length, cos_o / length];
    let mut sum = 0.0;
    for i in 0..n {
        // Most of the change lies at normals that are nearly tangential, so that the cells become narrower towards them.
        let v = 1.0 - (i as f64 + 0.5) / n as f64;
        let width = 4.0 * v.powi(3);
        let z = v.powi(4) * (1.0 + stretched[1]) - stretched[1];
        let r = (1.0 - z * z).max(0.0).sqrt();
        for j in 0..n {
            let phi = core::f64::consts::TAU * (j as f64 + 0.5) / n as f64;
            let cap = [r * phi.cos() + stretched[0], r * phi.sin(), z + stretched[1]];
            let h = [alpha * cap[0], alpha * cap[1], cap[2]];
            let h_length = h.iter().map(|x| x * x).sum::<f64>().sqrt();
            let h = h.map(|x| x / h_length);
            let cos_oh = sin_o * h[0] + cos_o * h[2];
            let cos_i = 2.0 * cos_oh * h[2] - cos_o;
            if cos_i > 0.0 {
                let lambda_i = smith(cos_i, (1.0 - cos_i * cos_i).max(0.0).sqrt());
                sum += width * (1.0 + lambda_o) / (1.0 + lambda_o + lambda_i);
            }
        }
    }
    sum / (n * n) as f64
}

/// The entry in this row and column of the table; the table in the repository has n = 768.
pub fn entry(row: usize, column: usize, n: usize) -> f64 {
    let at = |i: usize| i as f64 / (SIZE - 1) as f64;
    // A mirror loses nothing.  The albedo at cos = 0 is a limit, so it is evaluated slightly above 0.
    let (roughness, cos_o) = (at(row), at(column).max(1e-4));
    if roughness == 0.0 { 1.0 } else { directional_albedo(roughness * roughness, cos_o, n) }
}
