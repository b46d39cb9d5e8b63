//! Builds the top-level tree over the world bounds of instances, and has the affine algebra for it: the rows of a transform, its inverse
//! and the bounds of a transformed box.
//!
//! Bounds and inverses are computed in f64, and bounds are rounded outward, so that rays do not miss instances far from the origin.

use crate::gpu_layout::Rows;
use crate::scene::accel::blas::{Bounds, MAX_TLAS_DEPTH, build_tree};
use bevy::math::Affine3A;
use obvhs::BvhBuildParams;

/// The tree over instances.  Its node indices start at 0 until [`bake`](crate::scene::accel::blas::bake) adds their offset (with the
/// primitive base 0).
#[derive(Clone, Debug, Default)]
pub struct Tlas {
    /// [`NODE_STRIDE`](crate::gpu_layout::NODE_STRIDE) elements for each node; empty if there is no instance.
    pub nodes: Vec<[u32; 4]>,
    /// Instance indices in the order of the leaves, packed four to an element of the node buffer.
    pub indices: Vec<[u32; 4]>,
    /// The place of each leaf's instance in the list that the tree was built from, if no instance was skipped; otherwise empty.
    pub order: Vec<u32>,
}

/// Builds the tree over pairs of an instance index and its world bounds.  Instances without finite bounds are skipped.
pub fn build_tlas(instances: &[(u32, Bounds)]) -> Tlas {
    let valid: Vec<&(u32, Bounds)> = instances.iter().filter(|(_, b)| is_valid(b)).collect();
    let boxes: Vec<Bounds> = valid.iter().map(|(_, bounds)| *bounds).collect();
    // Leaves have one instance each: a ray that enters an instance has more to do than a test of its box.
    let Some(tree) = build_tree(&boxes, BvhBuildParams::very_fast_build(), 1, MAX_TLAS_DEPTH) else {
        return Tlas::default();
    };
    let mut indices = vec![[0; 4]; tree.order.len().div_ceil(4)];
    for (position, &i) in tree.order.iter().enumerate() {
        indices[position / 4][position % 4] = valid[i as usize].0;
    }
    let order = if valid.len() == instances.len() { tree.order } else { Vec::new() };
    Tlas { nodes: tree.nodes, indices, order }
}

/// Largest accepted coordinate of an instance in the world, in meters: shaders square distances, which must not overflow.
pub const MAX_COORDINATE: f32 = 1.0e18;

fn is_valid((min, max): &Bounds) -> bool {
    (0..3).all(|k| min[k] <= max[k] && min[k].abs() < MAX_COORDINATE && max[k].abs() < MAX_COORDINATE)
}

/// The rows of an affine transform.
pub fn rows(affine: &Affine3A) -> Rows {
    let [x, y, z] = affine.matrix3.to_cols_array_2d();
    let t = affine.translation.to_array();
    std::array::from_fn(|k| [x[k], y[k], z[k], t[k]])
}

/// Bounds of a transformed box, rounded outward; `None` if they are not finite or beyond [`MAX_COORDINATE`].
pub fn world_bounds(rows: &Rows, (min, max): &Bounds) -> Option<Bounds> {
    let mut world = ([0.0; 3], [0.0; 3]);
    for (k, row) in rows.iter().enumerate() {
        let (mut low, mut high) = (f64::from(row[3]), f64::from(row[3]));
        for c in 0..3 {
            let a = f64::from(row[c]) * f64::from(min[c]);
            let b = f64::from(row[c]) * f64::from(max[c]);
            low += a.min(b);
            high += a.max(b);
        }
        world.0[k] = (low as f32).next_down();
        world.1[k] = (high as f32).next_up();
    }
    is_valid(&world).then_some(world)
}

/// The inverse of an affine transform; `None` if the transform is singular or not finite.
pub fn inverse(rows: &Rows) -> Option<Rows> {
    let m: [[f64; 4]; 3] = rows.map(|row| row.map(f64::from));
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let terms: [f64; 3] = std::array::from_fn(|c| m[0][c] * cofactor(0, c));
    let determinant: f64 = terms.iter().sum();
    // Divided by the product of the row lengths, the determinant does not depend on scale: it is 1 for orthogonal rows.
    let volume: f64 = m.iter().map(|r| (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt()).product();
    if !determinant.is_finite() || determinant.abs() <= volume * 1.0e-10 {
        return None;
    }
    let mut result = [[0.0; 4]; 3];
    for (r, row) in result.iter_mut().enumerate() {
        let linear: [f64; 3] = std::array::from_fn(|c| cofactor(c, r) / determinant);
        let translation = -(linear[0] * m[0][3] + linear[1] * m[1][3] + linear[2] * m[2][3]);
        *row = [linear[0] as f32, linear[1] as f32, linear[2] as f32, translation as f32];
    }
    let finite = result.iter().chain(rows).flatten().all(|x: &f32| x.is_finite());
    finite.then_some(result)
}
