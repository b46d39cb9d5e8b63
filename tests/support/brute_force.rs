//! The oracle for rays: tests every triangle of every instance in f64, without a tree.

use super::scenes::{Ray, TestScene};

type V = [f64; 3];

/// Triangles in world space.
pub struct BruteForce {
    triangles: Vec<[V; 3]>,
}

/// The distances of the closest hit with slightly shrunk and slightly grown triangles: an f32 answer must lie between them.
#[derive(Clone, Copy, Debug)]
pub struct Closest {
    pub shrunk: f64,
    pub grown: f64,
}

pub fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl BruteForce {
    pub fn new(scene: &TestScene) -> Self {
        let mut triangles = Vec::new();
        for instance in &scene.instances {
            for corners in scene.corners_of(instance) {
                triangles.push(corners.map(|v| {
                    instance
                        .world_from_object
                        .map(|r| (0..3).map(|k| f64::from(r[k]) * f64::from(v[k])).sum::<f64>() + f64::from(r[3]))
                }));
            }
        }
        Self { triangles }
    }

    /// Triangles of all instances, in their order.
    pub fn triangles(&self) -> &[[V; 3]] {
        &self.triangles
    }

    /// `margin` is in barycentric units.
    pub fn closest(&self, ray: &Ray, margin: f64) -> Closest {
        let (o, d) = (ray.origin.map(f64::from), ray.direction.map(f64::from));
        let mut best = Closest { shrunk: f64::from(ray.t_max), grown: f64::from(ray.t_max) };
        for [v0, v1, v2] in &self.triangles {
            let (e1, e2) = (sub(*v1, *v0), sub(*v2, *v0));
            let p = cross(d, e2);
            let determinant = dot(e1, p);
            if determinant == 0.0 {
                continue;
            }
            let s = sub(o, *v0);
            let q = cross(s, e1);
            let (u, v, t) = (dot(s, p) / determinant, dot(d, q) / determinant, dot(e2, q) / determinant);
            let inside = u.min(v).min(1.0 - u - v);
            if t > f64::from(ray.t_min) {
                if inside > margin && t < best.shrunk {
                    best.shrunk = t;
                }
                if inside > -margin && t < best.grown {
                    best.grown = t;
                }
            }
        }
        best
    }
}
