//! Integrals over parts of the sphere, by adaptive Gauss quadrature.

use glam::DVec3;
use std::f64::consts::TAU;

/// Nodes and weights of 4-point Gauss-Legendre on [0, 1].
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_9),
    (0.330_009_478_207_571_9, 0.326_072_577_431_273_1),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_1),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_9),
];

fn gauss(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    let (dx, dy) = (x[1] - x[0], y[1] - y[0]);
    let mut sum = 0.0;
    for (s, ws) in GAUSS {
        for (t, wt) in GAUSS {
            sum += ws * wt * f(x[0] + s * dx, y[0] + t * dy);
        }
    }
    sum * dx * dy
}

/// The number of halvings that are always made, so that a thin strip between coarse nodes is not missed.
const ALWAYS: u32 = 3;

/// ∫∫ f(x, y) over a rectangle, to `tolerance` in each part or at most `depth` halvings.
pub fn rectangle(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], tolerance: f64, depth: u32) -> f64 {
    let parts = 1 << ALWAYS;
    let part = |range: [f64; 2], i: i32| {
        let step = (range[1] - range[0]) / f64::from(parts);
        [range[0] + step * f64::from(i), range[0] + step * f64::from(i + 1)]
    };
    let tolerance = tolerance / f64::from(parts);
    (0..parts * parts)
        .map(|i| {
            let (x, y) = (part(x, i % parts), part(y, i / parts));
            refine(f, x, y, gauss(f, x, y), tolerance, depth - ALWAYS)
        })
        .sum()
}

fn refine(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], whole: f64, tolerance: f64, depth: u32) -> f64 {
    let (mx, my) = ((x[0] + x[1]) / 2.0, (y[0] + y[1]) / 2.0);
    let parts =
        [([x[0], mx], [y[0], my]), ([mx, x[1]], [y[0], my]), ([x[0], mx], [my, y[1]]), ([mx, x[1]], [my, y[1]])];
    let values = parts.map(|(x, y)| gauss(f, x, y));
    let sum: f64 = values.iter().sum();
    if depth == 0 || (sum - whole).abs() <= tolerance {
        return sum;
    }
    parts.iter().zip(values).map(|(&(x, y), v)| refine(f, x, y, v, tolerance / 2.0, depth - 1)).sum()
}

/// Cells around an axis: bands between the given polar angles, each cut into `sectors`.
pub struct PolarCells {
    frame: [DVec3; 3],
    bands: Vec<f64>,
    sectors: usize,
}

impl PolarCells {
    /// Bands that grow geometrically from the angle `finest` to π.
    pub fn about(axis: DVec3, finest: f64, bands: usize, sectors: usize) -> Self {
        let (t, b) = axis.any_orthonormal_pair();
        let ratio = std::f64::consts::PI / finest;
        let mut edges = vec![0.0];
        edges.extend((0..bands).map(|i| finest * ratio.powf(i as f64 / (bands - 1) as f64)));
        Self { frame: [t, b, axis], bands: edges, sectors }
    }

    pub fn count(&self) -> usize {
        (self.bands.len() - 1) * self.sectors
    }

    pub fn cell_of(&self, w: DVec3) -> usize {
        let [t, b, axis] = self.frame;
        let theta = axis.cross(w).length().atan2(axis.dot(w));
        let phi = b.dot(w).atan2(t.dot(w)).rem_euclid(TAU);
        let band = self.bands[1..].partition_point(|&edge| edge <= theta).min(self.bands.len() - 2);
        let sector = ((phi / TAU * self.sectors as f64) as usize).min(self.sectors - 1);
        band * self.sectors + sector
    }

    /// ∫ f dω over every cell.
    pub fn integrate(&self, f: impl Fn(DVec3) -> f64, tolerance: f64) -> Vec<f64> {
        let [t, b, axis] = self.frame;
        let of_angles = |theta: f64, phi: f64| {
            let (s, c) = theta.sin_cos();
            f(s * phi.cos() * t + s * phi.sin() * b + c * axis) * s
        };
        (0..self.count())
            .map(|i| {
                let (band, sector) = (i / self.sectors, i % self.sectors);
                let step = TAU / self.sectors as f64;
                let phi = [sector as f64 * step, (sector + 1) as f64 * step];
                rectangle(&of_angles, [self.bands[band], self.bands[band + 1]], phi, tolerance, 9)
            })
            .collect()
    }
}
