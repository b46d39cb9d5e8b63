//! Russian roulette in f64.  A path that survives with the probabilities q has the density ∏ q (Lin et al. 2026, supplement, 6), so that
//! its weight is divided by ∏ q and its contribution is not.  From the third scattering event on, q is the greatest channel of the
//! throughput that the survivors carry, at most 0.95.

use glam::DVec3;

/// The first scattering event with roulette.
const FROM: i32 = 3;
const GREATEST: f64 = 0.95;

/// The probability to survive up to and including each event from 1 to `events`, where each multiplies the throughput by `albedo`.
pub fn survival(albedo: DVec3, events: i32) -> Vec<f64> {
    let mut carried = 1.0;
    (1..=events)
        .map(|event| {
            if event >= FROM {
                let throughput = albedo.powf(f64::from(event)).max_element();
                carried *= (throughput / carried).min(GREATEST);
            }
            carried
        })
        .collect()
}

/// In a closed room of this albedo and emission 1, for each number n of events that a path may survive: its probability, and the light
/// that the path collects.
pub fn furnace(albedo: DVec3, events: i32) -> Vec<(f64, DVec3)> {
    let survival = survival(albedo, events);
    let mut light = DVec3::ZERO;
    (0..events as usize)
        .map(|i| {
            light += albedo.powf((i + 1) as f64) / survival[i];
            let next = survival.get(i + 1).copied().unwrap_or(0.0);
            (survival[i] - next, light)
        })
        .collect()
}
