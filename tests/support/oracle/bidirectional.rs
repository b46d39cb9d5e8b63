//! MIS weights of bidirectional techniques by their definition: the density of every technique (s, t) for one path.

/// The number of values for each vertex of a [`Path`].
pub const VERTICES: usize = 10;

/// A path x0 (the camera) to xk (on a light), by densities and cosines alone.  Index i: at the vertex xi.  A light at infinity has the
/// cosine 1 and the distance 1 at xk; its `reverse[k - 1]` is a density in area.
#[repr(C)]
#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Path {
    pub k: u32,
    /// 1 if no ray can hit the light.
    pub delta_light: u32,
    /// Bit i: xi scatters by no delta lobe, so that techniques may join there.
    pub connectable: u32,
    /// The first vertex that this path and a shifted one share; 0 if there is no shifted path.
    pub reconnection: u32,
    /// The last vertex below which light scatters, so that light sub-paths end there; 0 if light scatters below no vertex.
    pub below: u32,
    /// The error that the kernel plants.
    pub error: u32,
    /// The number of candidates of next-event estimation at x1.
    pub candidates: u32,
    /// The number of samples of technique (k, 1).
    pub splats: f32,
    /// The number of connections of a vertex, each weighed against one light sub-path that the camera sees.
    pub connections: f32,
    /// Factors of the densities of light sub-paths: where next-event estimation finds the light, and where a delta lobe receives it.
    pub nee_share: f32,
    pub caustic_share: f32,
    /// The densities of the light's point, in area, of next-event estimation and of light sub-paths.
    pub nee: f32,
    pub light: f32,
    /// The cosine towards the vertex before.
    pub cos_in: [f32; VERTICES],
    /// The cosine towards the next vertex.
    pub cos_out: [f32; VERTICES],
    /// The squared distance to the vertex before.
    pub distance2: [f32; VERTICES],
    /// The density, in solid angle, of choosing this vertex from the one before.
    pub forward: [f32; VERTICES],
    /// The density of choosing it from the next one.
    pub reverse: [f32; VERTICES],
}

impl Path {
    fn is_connectable(&self, i: usize) -> bool {
        self.connectable & (1 << i) != 0
    }

    /// Whether technique (s, t) can find the path.
    pub fn exists(&self, s: usize, t: usize) -> bool {
        match (s, t) {
            (0, _) => self.delta_light == 0,
            (1, _) => t >= 2 && self.is_connectable(t - 1),
            _ if t <= self.below as usize => false,
            (_, 1) => self.is_connectable(1),
            _ => self.connections > 0.0 && self.is_connectable(t - 1) && self.is_connectable(t),
        }
    }

    /// The logarithm of the number of samples times the share and the density of technique (s, t), in the product measure of area.
    fn log_density(&self, s: usize, t: usize) -> f64 {
        let k = self.k as usize;
        let log = |x: f32| f64::from(x).ln();
        let forward = |i: usize| log(self.forward[i]) + log(self.cos_in[i]) - log(self.distance2[i]);
        let reverse = |i: usize| log(self.reverse[i]) + log(self.cos_out[i]) - log(self.distance2[i + 1]);
        let from_camera: f64 = (1..t.min(k + 1)).map(forward).sum();
        from_camera
            + match s {
                0 => 0.0,
                1 => log(self.nee) + if t == 2 { f64::from(self.candidates).ln() } else { 0.0 },
                _ => {
                    let count = log(if t == 1 { self.splats } else { self.connections });
                    let share = log(if self.is_connectable(k - 1) { self.nee_share } else { self.caustic_share });
                    count + share + log(self.light) + (t..k).map(reverse).sum::<f64>()
                }
            }
    }

    /// The weight of each technique by the balance heuristic, with index t; 0 for those that cannot find the path.
    pub fn weights(&self) -> [f64; VERTICES] {
        let k = self.k as usize;
        let mut densities = [f64::NEG_INFINITY; VERTICES];
        for (t, density) in densities.iter_mut().enumerate().take(k + 2).skip(1) {
            if self.exists(k + 1 - t, t) {
                *density = self.log_density(k + 1 - t, t);
            }
        }
        let largest = densities.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if largest == f64::NEG_INFINITY {
            return [0.0; VERTICES];
        }
        let shares = densities.map(|density| (density - largest).exp());
        let sum: f64 = shares.iter().sum();
        shares.map(|share| share / sum)
    }
}
