//! The top-level tree over instances' world boxes, and the affine algebra that it needs: rows of a transform, its inverse,
//! the box of a transformed box.  All of it in f64 and rounded outwards, so that nothing is lost far from the origin.

use crate::gpu_layout::Rows;
use crate::scene::accel::blas::{Bounds, MAX_TLAS_DEPTH, build_tree};
use bevy::math::Affine3A;
use obvhs::BvhBuildParams;

/// The tree over instances, its node numbers counted from 0 until [`crate::scene::accel::blas::bake`] moves them (primitive base 0).
#[derive(Clone, Debug, Default)]
pub struct Tlas {
    /// [`crate::gpu_layout::NODE_STRIDE`] a node; none when there is nothing to hit.
    pub nodes: Vec<[u32; 4]>,
    /// Instance numbers in the order of the leaves, four to a word of `nodes`' buffer.
    pub indices: Vec<[u32; 4]>,
    /// Of all instances.
    pub bounds: Bounds,
    /// Levels, at most [`MAX_TLAS_DEPTH`].
    pub depth: u32,
}

/// Builds the tree over (instance number, world box).  Boxes that are not finite are left out.
pub fn build_tlas(instances: &[(u32, Bounds)]) -> Tlas {
    let sound: Vec<&(u32, Bounds)> = instances.iter().filter(|(_, b)| is_sound(b)).collect();
    let boxes: Vec<Bounds> = sound.iter().map(|(_, bounds)| *bounds).collect();
    let Some(tree) = build_tree(&boxes, BvhBuildParams::very_fast_build(), MAX_TLAS_DEPTH) else {
        return Tlas::default();
    };
    let mut indices = vec![[0; 4]; tree.order.len().div_ceil(4)];
    for (place, &i) in tree.order.iter().enumerate() {
        indices[place / 4][place % 4] = sound[i as usize].0;
    }
    Tlas { nodes: tree.nodes, indices, bounds: tree.bounds, depth: tree.depth }
}

fn is_sound((min, max): &Bounds) -> bool {
    // Squares of extents must not overflow in the builder.
    (0..3).all(|k| min[k] <= max[k] && min[k].abs() < 1.0e18 && max[k].abs() < 1.0e18)
}

/// The rows of an affine transform.
pub fn rows(affine: &Affine3A) -> Rows {
    let [x, y, z] = affine.matrix3.to_cols_array_2d();
    let t = affine.translation.to_array();
    std::array::from_fn(|k| [x[k], y[k], z[k], t[k]])
}

/// The box of a transformed box, rounded outwards; None if it is not finite.
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
    is_sound(&world).then_some(world)
}

/// The inverse of an affine transform; None where it is singular, or where a number is not finite.
pub fn inverse(rows: &Rows) -> Option<Rows> {
    let m: [[f64; 4]; 3] = rows.map(|row| row.map(f64::from));
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let terms: [f64; 3] = std::array::from_fn(|c| m[0][c] * cofactor(0, c));
    let determinant: f64 = terms.iter().sum();
    // Against the product of the rows' lengths, the determinant is a pure number: 1 for orthogonal rows.
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
