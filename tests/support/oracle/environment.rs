//! The environment in f64: a bilinear equirectangular map.

use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Radiance in rows from north to south.
#[derive(Clone)]
pub struct Map {
    pub width: usize,
    pub height: usize,
    pub texels: Vec<DVec3>,
}

impl Map {
    pub fn new(width: usize, height: usize, texel: impl Fn(usize, usize) -> DVec3) -> Self {
        let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
        Self { width, height, texels }
    }

    fn texel(&self, x: i64, y: i64) -> DVec3 {
        let x = x.rem_euclid(self.width as i64) as usize;
        let y = y.clamp(0, self.height as i64 - 1) as usize;
        self.texels[y * self.width + x]
    }

    /// Bilinear interpolation; (u, v) as of `uv`.
    pub fn at(&self, u: f64, v: f64) -> DVec3 {
        let (x, y) = (u * self.width as f64 - 0.5, v * self.height as f64 - 0.5);
        let (i, j) = (x.floor() as i64, y.floor() as i64);
        let (s, t) = (x - x.floor(), y - y.floor());
        let top = self.texel(i, j).lerp(self.texel(i + 1, j), s);
        top.lerp(self.texel(i, j + 1).lerp(self.texel(i + 1, j + 1), s), t)
    }

    pub fn radiance(&self, d: DVec3) -> DVec3 {
        let (u, v) = uv(d);
        self.at(u, v)
    }

    /// Solid angle times mean luminance for a cell of a `width` x `height` table, by brute force.
    pub fn importance(&self, x: usize, y: usize, width: usize, height: usize) -> f64 {
        const STEPS: usize = 64;
        let mut sum = 0.0;
        for j in 0..STEPS {
            for i in 0..STEPS {
                let at = |k: usize, cell: usize, n: usize| (cell as f64 + (k as f64 + 0.5) / STEPS as f64) / n as f64;
                sum += luminance(self.at(at(i, x, width), at(j, y, height)));
            }
        }
        sum / (STEPS * STEPS) as f64 * solid_angle(y, width, height)
    }
}

pub fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

pub fn uv(d: DVec3) -> (f64, f64) {
    (0.5 + d.x.atan2(-d.z) / TAU, d.y.clamp(-1.0, 1.0).acos() / PI)
}

pub fn direction(u: f64, v: f64) -> DVec3 {
    let (phi, theta) = ((u - 0.5) * TAU, v * PI);
    DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

pub fn solid_angle(y: usize, width: usize, height: usize) -> f64 {
    let cos = |y: usize| (y as f64 / height as f64 * PI).cos();
    TAU / width as f64 * (cos(y) - cos(y + 1))
}
