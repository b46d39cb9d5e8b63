//! Fits the boxes of a top-level tree to instances that have moved, which takes a third of the time of a new tree (`docs/experiments.md`,
//! "Number of instances").
//!
//! The tree keeps its topology, so that it gets slower to trace as instances move away from their neighbors: [`cost`] measures by how much.

use crate::gpu_layout::NODE_STRIDE;
use crate::scene::accel::blas::{Bounds, NO_BOUNDS, joined};

const STRIDE: usize = NODE_STRIDE as usize;
const CHILDREN: usize = 8;

/// A child of a node (`shaders/trace/tree.wgsl` has the layout).
enum Child {
    Empty,
    /// Index of the node.
    Node(usize),
    /// Positions of the first primitive and of the one after the last, in the order of the leaves.
    Leaf(usize, usize),
}

fn child(node: &[[u32; 4]], slot: usize) -> Child {
    let inner = node[0][3] >> 24;
    let code = node[1][2 + slot / 4] >> (8 * (slot % 4)) & 0xff;
    if inner & 1 << slot != 0 {
        let before = (inner & ((1 << slot) - 1)).count_ones();
        return Child::Node((node[1][0] + before) as usize);
    }
    let (first, count) = (node[1][1] + (code & 31), (code >> 5).count_ones());
    if count == 0 { Child::Empty } else { Child::Leaf(first as usize, (first + count) as usize) }
}

/// Exponent, with its bias of 127, of the least power of two that is at least `extent` / 255.
fn cell_exponent(extent: f64) -> u32 {
    if extent <= 0.0 {
        return 1;
    }
    let exponent = (extent / 255.0).log2().ceil() as i32;
    // The logarithm is rounded.
    let exponent = exponent + i32::from(2f64.powi(exponent) * 255.0 < extent);
    (exponent + 127).clamp(1, 254) as u32
}

fn cell(exponent: u32) -> f64 {
    2f64.powi(exponent as i32 - 127)
}

/// Fits a tree to the bounds of its primitives.  Nodes are as [`build_tlas`](super::tlas::build_tlas) leaves them: children come after their
/// parent.  `bounds_at`: of a primitive, by its position in the order of the leaves.
pub(crate) fn refit(nodes: &mut [[u32; 4]], bounds_at: impl Fn(usize) -> Bounds) {
    let mut boxes = vec![NO_BOUNDS; nodes.len() / STRIDE];
    for index in (0..boxes.len()).rev() {
        let node = &mut nodes[index * STRIDE..][..STRIDE];
        let children: [Bounds; CHILDREN] = core::array::from_fn(|slot| match child(node, slot) {
            Child::Empty => NO_BOUNDS,
            Child::Node(child) => boxes[child],
            Child::Leaf(first, end) => (first..end).map(&bounds_at).fold(NO_BOUNDS, joined),
        });
        boxes[index] = children.into_iter().fold(NO_BOUNDS, joined);
        write_boxes(node, &boxes[index], &children);
    }
}

/// Planes of the boxes of children are low + q·cell, where q has 8 bits and the cell is a power of two.
fn write_boxes(node: &mut [[u32; 4]], (low, high): &Bounds, children: &[Bounds; CHILDREN]) {
    let mut exponents = 0;
    for k in 0..3 {
        let origin = f64::from(low[k]);
        let exponent = cell_exponent(f64::from(high[k]) - origin);
        exponents |= exponent << (8 * k);
        // Eight low planes in two words, then eight high ones.
        let mut planes = [0; 4];
        for (slot, (child_low, child_high)) in children.iter().enumerate() {
            let place = |x: f32| (f64::from(x) - origin) / cell(exponent);
            let shift = 8 * (slot % 4);
            planes[slot / 4] |= (place(child_low[k]).floor().clamp(0.0, 255.0) as u32) << shift;
            planes[slot / 4 + 2] |= (place(child_high[k]).ceil().clamp(0.0, 255.0) as u32) << shift;
        }
        node[2 + k] = planes;
        node[0][k] = low[k].to_bits();
    }
    node[0][3] = node[0][3] & 0xff00_0000 | exponents;
}

/// Low and high corner of the box of a child, as a ray sees it.
fn child_box(node: &[[u32; 4]], slot: usize) -> [[f64; 3]; 2] {
    let plane = |k: usize, word: usize| {
        let q = node[2 + k][word + slot / 4] >> (8 * (slot % 4)) & 0xff;
        let exponent = node[0][3] >> (8 * k) & 0xff;
        f64::from(f32::from_bits(node[0][k])) + f64::from(q) * cell(exponent)
    };
    [0, 2].map(|word| core::array::from_fn(|k| plane(k, word)))
}

/// Half of the area of a box.
fn area([low, high]: [[f64; 3]; 2]) -> f64 {
    let [x, y, z]: [f64; 3] = core::array::from_fn(|k| (high[k] - low[k]).max(0.0));
    x * y + y * z + z * x
}

/// Expected number of boxes that a random ray through the tree hits: the areas of all children relative to that of the root.
pub(crate) fn cost(nodes: &[[u32; 4]]) -> f64 {
    let mut all = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    let mut sum = 0.0;
    for (index, node) in nodes.chunks_exact(STRIDE).enumerate() {
        for slot in (0..CHILDREN).filter(|slot| !matches!(child(node, *slot), Child::Empty)) {
            let [low, high] = child_box(node, slot);
            sum += area([low, high]);
            if index == 0 {
                all = core::array::from_fn(|end| {
                    core::array::from_fn(|k| if end == 0 { all[0][k].min(low[k]) } else { all[1][k].max(high[k]) })
                });
            }
        }
    }
    sum / area(all).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::accel::tlas::{Tlas, build_tlas};

    /// Numbers in 0..1 without a pattern.
    fn random(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            let x = (state >> ((state >> 28) + 4) ^ state).wrapping_mul(277_803_737);
            (x >> 22 ^ x) as f32 / u32::MAX as f32
        };
        (0..count).map(|_| next()).collect()
    }

    fn boxes(count: usize, seed: u32, scale: f32, size: f32) -> Vec<(u32, Bounds)> {
        let numbers = random(6 * count, seed);
        let at = |c: &[f32], k: usize| (c[k] - 0.5) * scale;
        let bounds = |c: &[f32]| -> Bounds {
            (core::array::from_fn(|k| at(c, k)), core::array::from_fn(|k| at(c, k) + c[3 + k] * size))
        };
        numbers.chunks_exact(6).enumerate().map(|(i, c)| (7 * i as u32, bounds(c))).collect()
    }

    fn contains(outer: &[[f64; 3]; 2], inner: &Bounds) -> bool {
        (0..3).all(|k| outer[0][k] <= f64::from(inner.0[k]) && f64::from(inner.1[k]) <= outer[1][k])
    }

    /// Asserts that the boxes of all nodes enclose their primitives, and counts these.
    fn enclosed(
        nodes: &[[u32; 4]],
        index: usize,
        within: &[[f64; 3]; 2],
        bounds_at: &impl Fn(usize) -> Bounds,
    ) -> usize {
        let node = &nodes[index * STRIDE..][..STRIDE];
        (0..CHILDREN)
            .map(|slot| match child(node, slot) {
                Child::Empty => 0,
                Child::Node(child) => {
                    let seen = child_box(node, slot);
                    enclosed(nodes, child, &seen, bounds_at)
                }
                Child::Leaf(first, end) => {
                    let seen = child_box(node, slot);
                    (first..end)
                        .for_each(|i| assert!(contains(&seen, &bounds_at(i)) && contains(within, &bounds_at(i))));
                    end - first
                }
            })
            .sum()
    }

    fn refitted(tree: &Tlas, moved: &[(u32, Bounds)]) -> Vec<[u32; 4]> {
        let mut nodes = tree.nodes.clone();
        let bounds_at = |position: usize| moved[tree.order[position] as usize].1;
        refit(&mut nodes, bounds_at);
        let everything = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
        assert_eq!(enclosed(&nodes, 0, &everything, &bounds_at), moved.len());
        nodes
    }

    #[test]
    fn refitted_boxes_enclose_instances_that_moved_anywhere() {
        for count in [1, 2, 9, 500] {
            for (scale, size) in [(10.0, 1.0), (1.0e17, 1.0e16), (1.0e-6, 1.0e-9), (1.0e3, 0.0)] {
                let tree = build_tlas(&boxes(count, 1, 10.0, 1.0));
                refitted(&tree, &boxes(count, 2, scale, size));
            }
        }
    }

    #[test]
    fn the_cost_tells_a_tree_that_fits_from_one_that_does_not() {
        let rest = boxes(2000, 1, 100.0, 1.0);
        let tree = build_tlas(&rest);
        let built = cost(&tree.nodes);
        let same = cost(&refitted(&tree, &rest));
        assert!((same / built - 1.0).abs() < 0.02, "{built} to {same}");
        let shifted: Vec<_> = rest.iter().map(|(i, (a, b))| (*i, (a.map(|x| x + 30.0), b.map(|x| x + 30.0)))).collect();
        let moved = cost(&refitted(&tree, &shifted));
        assert!((moved / built - 1.0).abs() < 0.02, "{built} to {moved}");
        let mixed = cost(&refitted(&tree, &boxes(2000, 2, 100.0, 1.0)));
        assert!(mixed > 5.0 * built, "{built} to {mixed}");
    }
}
