//! Builds the top-level tree over the world bounds of instances, and has the affine algebra for it: the rows of a transform, its inverse
//! and the bounds of a transformed box.
//!
//! Bounds and inverses are computed in f64, and bounds are rounded outward, so that rays do not miss instances far from the origin.

use crate::gpu_layout::Rows;
use crate::scene::accel::blas::{Bounds, MAX_TLAS_DEPTH, build_tree};
use bevy::math::{Affine3A, Vec3};
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
    // Leaves have one instance each: a ray that enters an instance has more to do than a test of its box.  One level is that of the root
    // above two trees.
    let Some(tree) = build_tree(&boxes, BvhBuildParams::very_fast_build(), 1, MAX_TLAS_DEPTH - 1) else {
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
    let [a, b, c] = rows.map(|[x, y, z, _]| Vec3::new(x, y, z).as_dvec3());
    let translation = rows.map(|row| f64::from(row[3]));
    // The columns of the inverse times the determinant.
    let columns = [b.cross(c), c.cross(a), a.cross(b)];
    let determinant = a.dot(columns[0]);
    // Divided by the product of the row lengths, the determinant does not depend on scale: it is 1 for orthogonal rows.  Squares need no
    // roots, and those of f32 numbers do not overflow.
    let volume_squared = a.length_squared() * b.length_squared() * c.length_squared();
    if !determinant.is_finite() || determinant * determinant <= volume_squared * 1.0e-20 {
        return None;
    }
    let reciprocal = 1.0 / determinant;
    let [x, y, z] = columns.map(|column| column * reciprocal);
    let origin = -(x * translation[0] + y * translation[1] + z * translation[2]);
    let result: Rows = std::array::from_fn(|r| [x[r] as f32, y[r] as f32, z[r] as f32, origin[r] as f32]);
    let finite = result.iter().chain(rows).flatten().all(|x: &f32| x.is_finite());
    finite.then_some(result)
}
