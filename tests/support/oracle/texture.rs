//! Texture sampling in f64: wrap modes, bilinear filter, box-filtered levels, and the mean over a footprint.

use glam::{DVec2, DVec4};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

/// Texels in rows, with linear values.
#[derive(Clone, Debug)]
pub struct Level {
    pub width: usize,
    pub height: usize,
    pub texels: Vec<DVec4>,
}

impl Level {
    pub fn new(width: usize, height: usize, texel: impl Fn(usize, usize) -> DVec4) -> Self {
        let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
        Self { width, height, texels }
    }

    /// The next coarser level: each texel is the mean of those that it covers.
    pub fn halved(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let cover = |i: usize, n: usize, j: usize, m: usize| {
            let scale = m as f64 / n as f64;
            (((i + 1) as f64 * scale).min((j + 1) as f64) - (i as f64 * scale).max(j as f64)).max(0.0) / scale
        };
        Self::new(width, height, |x, y| {
            let mut sum = DVec4::ZERO;
            for j in 0..self.height {
                for i in 0..self.width {
                    let weight = cover(x, width, i, self.width) * cover(y, height, j, self.height);
                    sum += weight * self.texels[j * self.width + i];
                }
            }
            sum
        })
    }
}

/// An image and its levels, down to one texel along its shorter side.
#[derive(Clone, Debug)]
pub struct Texture {
    pub levels: Vec<Level>,
    pub wrap: [Wrap; 2],
    pub nearest: bool,
}

fn wrapped(i: i64, n: usize, wrap: Wrap) -> usize {
    let n = n as i64;
    (match wrap {
        Wrap::Clamp => i.clamp(0, n - 1),
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirror => {
            let m = i.rem_euclid(2 * n);
            if m < n { m } else { 2 * n - 1 - m }
        }
    }) as usize
}

impl Texture {
    pub fn new(image: Level, wrap: [Wrap; 2], nearest: bool) -> Self {
        let mut levels = vec![image];
        while levels.last().is_some_and(|l| l.width.min(l.height) > 1) {
            levels.push(levels[levels.len() - 1].halved());
        }
        Self { levels, wrap, nearest }
    }

    fn texel(&self, level: usize, x: i64, y: i64) -> DVec4 {
        let l = &self.levels[level];
        l.texels[wrapped(y, l.height, self.wrap[1]) * l.width + wrapped(x, l.width, self.wrap[0])]
    }

    /// Bilinear; with a nearest filter, the nearest texel of the image itself.
    pub fn sample_level(&self, level: usize, uv: DVec2) -> DVec4 {
        let at = uv * DVec2::new(self.levels[level].width as f64, self.levels[level].height as f64);
        if self.nearest && level == 0 {
            return self.texel(0, at.x.floor() as i64, at.y.floor() as i64);
        }
        let low = (at - 0.5).floor();
        let f = at - 0.5 - low;
        let (x, y) = (low.x as i64, low.y as i64);
        let row = |y| self.texel(level, x, y).lerp(self.texel(level, x + 1, y), f.x);
        row(y).lerp(row(y + 1), f.y)
    }

    /// Interpolates between two levels.
    pub fn sample_at(&self, level: f64, uv: DVec2) -> DVec4 {
        let level = level.clamp(0.0, (self.levels.len() - 1) as f64);
        let low = level.floor();
        let above = self.sample_level((low as usize + 1).min(self.levels.len() - 1), uv);
        self.sample_level(low as usize, uv).lerp(above, level - low)
    }

    /// The mean over an ellipse with these conjugate diameters, by brute force.
    pub fn mean_over_ellipse(&self, uv: DVec2, axes: [DVec2; 2]) -> DVec4 {
        const RINGS: u32 = 16;
        const SPOKES: u32 = 32;
        let mut sum = DVec4::ZERO;
        for ring in 0..RINGS {
            // Rings of equal area.
            let r = 0.5 * ((f64::from(ring) + 0.5) / f64::from(RINGS)).sqrt();
            for spoke in 0..SPOKES {
                let (sin, cos) = (std::f64::consts::TAU * (f64::from(spoke) + 0.5) / f64::from(SPOKES)).sin_cos();
                sum += self.sample_level(0, uv + r * (cos * axes[0] + sin * axes[1]));
            }
        }
        sum / f64::from(RINGS * SPOKES)
    }

    /// The recipe of the shader: up to four samples along the longer axis of an ellipse with these diameters, from the level that suits the
    /// shorter axis.
    pub fn sample_area(&self, uv: DVec2, axes: [DVec2; 2]) -> DVec4 {
        let size = DVec2::new(self.levels[0].width as f64, self.levels[0].height as f64);
        // The singular values of the matrix of both diameters, and the direction of the larger one.
        let [a, b] = axes.map(|a| a * size);
        let (e, f) = (0.5 * (a.x + b.y), 0.5 * (a.x - b.y));
        let (g, h) = (0.5 * (a.y + b.x), 0.5 * (a.y - b.x));
        let (long, short) = (e.hypot(h) + f.hypot(g), (e.hypot(h) - f.hypot(g)).abs());
        let axis = DVec2::from_angle(0.5 * (h.atan2(e) + g.atan2(f))) * long / size;
        let across = short.max(long / 4.0).max(1.0);
        let taps = (long / across - 0.01).ceil().clamp(1.0, 4.0) as usize;
        (0..taps)
            .map(|tap| {
                let along = (tap as f64 + 0.5) / taps as f64 - 0.5;
                self.sample_at(across.log2(), uv + along * axis) / taps as f64
            })
            .sum()
    }
}

pub fn srgb_to_linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

pub fn linear_to_srgb(c: f64) -> f64 {
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}
