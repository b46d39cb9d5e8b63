//! A plane at z = 0 in front of the camera of [`Rig::new`], and the radiance that it should have.

use super::app::*;
use bevy::prelude::*;
use core::f64::consts::PI;

/// The point of the plane that a pixel shows.
pub fn on_plane(size: UVec2, at: UVec2) -> Vec2 {
    let extent = 5.0 * (0.5 * PerspectiveProjection::default().fov).tan();
    let ndc = (at.as_vec2() + 0.5) / size.as_vec2() * Vec2::new(2.0, -2.0) + Vec2::new(-1.0, 1.0);
    ndc * extent * Vec2::new(size.x as f32 / size.y as f32, 1.0)
}

/// Asserts that the mean relative difference to the expectation is within 0.2 % and its own noise.
pub fn check_mean(rig: &mut Rig, frames: u32, name: &str, expected: impl Fn(Vec2) -> f64) {
    let picture = rig.picture(frames);
    let ratios = picture.iter().map(|(at, color)| f64::from(color.x) / expected(on_plane(picture.size, at)) - 1.0);
    let (mean, error) = mean_and_error(ratios);
    eprintln!("{name}: off by {mean:.5}, standard error {error:.5}");
    assert!(error < 0.01, "{name}: the test has no power: standard error {error}");
    assert!(mean.abs() < 4.0 * error + 0.002, "{name}: {mean} off, standard error {error}");
    rig.assert_sound();
}

/// The form factor of a rectangle for a point on a parallel plane at distance `c`; the corners are relative to the point.
pub fn form_factor(low: [f64; 2], high: [f64; 2], c: f64) -> f64 {
    // The form factor of the rectangle between the foot of the point and a corner (Howell, catalog C-11).
    let corner = |x: f64, y: f64| {
        let (a, b) = (x / c, y / c);
        let (p, q) = ((1.0 + a * a).sqrt(), (1.0 + b * b).sqrt());
        (a / p * (b / p).atan() + b / q * (a / q).atan()) / (2.0 * PI)
    };
    corner(high[0], high[1]) - corner(low[0], high[1]) - corner(high[0], low[1]) + corner(low[0], low[1])
}
