//! The subsurface model in f64: profile, lengths, and the density of probes.

use glam::DVec3;
use std::f64::consts::PI;

/// Below this radius, in units of d, the profile is constant.
pub const RADIUS_MIN: f64 = 1e-3;
/// The greatest distance, in units of d.
pub const REACH: f64 = 19.86;

/// The length d for a mean free path and an albedo.
pub fn length_of(mean_free_path: f64, albedo: f64) -> f64 {
    mean_free_path / (1.9 - albedo + 3.5 * (albedo - 0.8).powi(2))
}

/// The profile in units of d.
pub fn profile(r: f64) -> f64 {
    let r = r.max(RADIUS_MIN);
    ((-r).exp() + (-r / 3.0).exp()) / (8.0 * PI * r)
}

/// The integral over a disk of the profile that diverges at 0.
pub fn exact_cdf(r: f64) -> f64 {
    1.0 - 0.25 * (-r).exp() - 0.75 * (-r / 3.0).exp()
}

/// The integral over a disk of the profile.
pub fn cdf(r: f64) -> f64 {
    let core = PI * RADIUS_MIN.powi(2) * profile(0.0);
    if r < RADIUS_MIN { core * (r / RADIUS_MIN).powi(2) } else { core + exact_cdf(r) - exact_cdf(RADIUS_MIN) }
}

/// The integral over the plane.
pub fn total() -> f64 {
    cdf(1e3)
}

/// The inverse of [`exact_cdf`] in closed form, for the complement v = 1 - CDF.
pub fn exact_inverse(v: f64) -> f64 {
    let g = 1.0 + 4.0 * v * (2.0 * v + (1.0 + 4.0 * v * v).sqrt());
    3.0 * ((1.0 + g.powf(-1.0 / 3.0) + g.cbrt()) / (4.0 * v)).ln()
}

/// The radius at which the normalized CDF is `u`.
pub fn inverse(u: f64) -> f64 {
    let mass = u * total();
    let core = cdf(RADIUS_MIN);
    if mass < core {
        RADIUS_MIN * (mass / core).sqrt()
    } else {
        exact_inverse(1.0 - (mass - core + exact_cdf(RADIUS_MIN)))
    }
}

/// The mean of 1 - F over the cosine-weighted hemisphere, by Schlick's approximation.
pub fn mean_transmission(f0: f64) -> f64 {
    let f90 = if f0 > 0.0 { 1.0 } else { 0.0 };
    1.0 - f0 - (f90 - f0) / 21.0
}

/// A place from which probes start.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    pub position: DVec3,
    /// Tangent, bitangent, normal.
    pub frame: [DVec3; 3],
    /// d of the three channels; 0 for a channel that is diffuse.
    pub d: DVec3,
}

impl Origin {
    /// The joint density of a point and one technique, per area.
    pub fn density_of_technique(&self, axis: usize, channel: usize, point: DVec3, normal: DVec3) -> f64 {
        let (a, p) = [(self.frame[2], 0.5), (self.frame[0], 0.25), (self.frame[1], 0.25)][axis];
        let offset = point - self.position;
        let (r, across) = (offset.length(), (offset - offset.dot(a) * a).length());
        let (d, channels) = (self.d[channel], self.d.to_array().into_iter().filter(|d| *d > 0.0).count());
        if d <= 0.0 || r > REACH * d {
            return 0.0;
        }
        p * normal.dot(a).abs() * profile(across / d) / total() / (d * d) / channels as f64
    }

    fn density_of_axis(&self, axis: usize, point: DVec3, normal: DVec3) -> f64 {
        (0..3).map(|channel| self.density_of_technique(axis, channel, point, normal)).sum()
    }

    /// The marginal density of a point with this geometric normal over all techniques that can reach it.
    pub fn density(&self, point: DVec3, normal: DVec3) -> f64 {
        (0..3).map(|axis| self.density_of_axis(axis, point, normal)).sum()
    }

    /// The part of the density that belongs to one axis and to hits on one side: entering (cosine > 0) or leaving.
    pub fn density_of_side(&self, axis: usize, entering: bool, point: DVec3, normal: DVec3) -> f64 {
        let a = [self.frame[2], self.frame[0], self.frame[1]][axis];
        if (normal.dot(a) > 0.0) == entering { self.density_of_axis(axis, point, normal) } else { 0.0 }
    }
}

/// ∫ f dA over a triangle, refined near its greatest slope.
pub fn over_triangle(f: &dyn Fn(DVec3) -> f64, [a, b, c]: [DVec3; 3], tolerance: f64, depth: u32) -> f64 {
    let area = 0.5 * (b - a).cross(c - a).length();
    // Three points, exact for polynomials of degree 2.
    let rule = |[a, b, c]: [DVec3; 3], area: f64| {
        let at = |u: f64, v: f64| f((1.0 - u - v) * a + u * b + v * c);
        area / 3.0 * (at(1.0 / 6.0, 1.0 / 6.0) + at(2.0 / 3.0, 1.0 / 6.0) + at(1.0 / 6.0, 2.0 / 3.0))
    };
    let (ab, bc, ca) = (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a));
    let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
    let whole = rule([a, b, c], area);
    let sum: f64 = parts.iter().map(|p| rule(*p, 0.25 * area)).sum();
    if depth == 0 || (depth < 12 && (sum - whole).abs() <= tolerance) {
        return sum;
    }
    parts.iter().map(|p| over_triangle(f, *p, 0.4 * tolerance, depth - 1)).sum()
}
