//! Fits the boxes of a top-level tree to instances that have moved, which takes a third of the time of a new tree (`docs/experiments.md`,
//! "Number of instances"), and less if few have.
//!
//! The tree keeps its topology, so that it gets slower to trace as instances move away from their neighbors: the [`cost`] measures by how
//! much.

use crate::gpu_layout::{NODE_STRIDE, NONE};
use crate::scene::accel::{
    blas::{Bounds, NO_BOUNDS, joined},
    tlas::Tlas,
};

const STRIDE: usize = NODE_STRIDE as usize;
const CHILDREN: usize = 8;
/// Share of the instances, as its reciprocal.  If more of them have moved, most nodes are due, and all are fitted in one pass.
const FEW: usize = 8;

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
    let power_below = ((extent / 255.0).to_bits() >> 52) as i32 - F64_BIAS;
    let exponent = power_below + i32::from(power_of_two(power_below) * 255.0 < extent);
    (exponent + 127).clamp(1, 254) as u32
}

const F64_BIAS: i32 = 1023;

fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + F64_BIAS) as u64) << 52)
}

fn cell(exponent: u32) -> f64 {
    power_of_two(exponent as i32 - 127)
}

/// The exact boxes of a tree, and the links by which a refit visits only nodes above instances that have moved.
pub(crate) struct Refit {
    /// By node; [`NONE`] for the root.
    parents: Vec<u32>,
    /// By the place of an instance in the list that the tree was built from: the node with its leaf.
    leaf_nodes: Vec<u32>,
    /// By node.
    boxes: Vec<Bounds>,
    /// By node: the areas of its children.
    areas: Vec<f64>,
    /// By node: it waits for its refit.
    is_due: Vec<bool>,
}

impl Refit {
    /// Fits all nodes of a tree to the bounds of `instances`, which are those that it was built from.  No instance was skipped.
    pub(crate) fn new(tree: &mut Tlas, instances: &[(u32, Bounds)]) -> Self {
        let count = tree.nodes.len() / STRIDE;
        let mut new = Self {
            parents: vec![NONE; count],
            leaf_nodes: vec![0; tree.order.len()],
            boxes: vec![NO_BOUNDS; count],
            areas: vec![0.0; count],
            is_due: vec![false; count],
        };
        for (index, node) in tree.nodes.chunks_exact(STRIDE).enumerate() {
            for slot in 0..CHILDREN {
                match child(node, slot) {
                    Child::Empty => {}
                    Child::Node(child) => new.parents[child] = index as u32,
                    Child::Leaf(first, end) => {
                        tree.order[first..end].iter().for_each(|place| new.leaf_nodes[*place as usize] = index as u32);
                    }
                }
            }
        }
        new.fit_all(tree, instances);
        new
    }

    /// Fits the tree after the bounds at some places of `instances` have changed.  Returns the nodes that may have changed, in ascending
    /// order.
    pub(crate) fn update(&mut self, tree: &mut Tlas, instances: &[(u32, Bounds)], moved: &[u32]) -> Vec<usize> {
        if FEW * moved.len() > instances.len() {
            self.fit_all(tree, instances);
            return (0..self.boxes.len()).collect();
        }
        for place in moved {
            self.is_due[self.leaf_nodes[*place as usize] as usize] = true;
        }
        let mut fitted = Vec::new();
        // Children come after their parent, so that a node waits for no node before it.
        for index in (0..self.boxes.len()).rev() {
            if !core::mem::take(&mut self.is_due[index]) {
                continue;
            }
            fitted.push(index);
            let has_changed = self.fit(index, tree, instances);
            if let Some(parent) = self.is_due.get_mut(self.parents[index] as usize).filter(|_| has_changed) {
                *parent = true;
            }
        }
        fitted.reverse();
        fitted
    }

    fn fit_all(&mut self, tree: &mut Tlas, instances: &[(u32, Bounds)]) {
        for index in (0..self.boxes.len()).rev() {
            self.fit(index, tree, instances);
        }
    }

    /// Fits a node to its children, and returns whether its own box has changed.
    fn fit(&mut self, index: usize, tree: &mut Tlas, instances: &[(u32, Bounds)]) -> bool {
        let Tlas { nodes, order, .. } = tree;
        let node = &mut nodes[index * STRIDE..][..STRIDE];
        let bounds_at = |position: usize| instances[order[position] as usize].1;
        let children: [Bounds; CHILDREN] = core::array::from_fn(|slot| match child(node, slot) {
            Child::Empty => NO_BOUNDS,
            Child::Node(child) => self.boxes[child],
            Child::Leaf(first, end) => (first..end).map(bounds_at).fold(NO_BOUNDS, joined),
        });
        let all = children.into_iter().fold(NO_BOUNDS, joined);
        write_boxes(node, &all, &children);
        self.areas[index] = area_of_children(node);
        bits(core::mem::replace(&mut self.boxes[index], all)) != bits(all)
    }

    /// The box around all instances; [`NO_BOUNDS`] if there are none.
    pub(crate) fn bounds(&self) -> Bounds {
        self.boxes.first().copied().unwrap_or(NO_BOUNDS)
    }

    /// The [`cost`] of the tree.
    pub(crate) fn cost(&self, tree: &Tlas) -> f64 {
        relative_cost(self.areas.iter().copied(), &tree.nodes)
    }
}

/// Zeros of different signs differ.
fn bits((low, high): Bounds) -> [[u32; 3]; 2] {
    [low, high].map(|corner| corner.map(f32::to_bits))
}

/// Planes of the boxes of children are low + q·cell, where q has 8 bits and the cell is a power of two.
fn write_boxes(node: &mut [[u32; 4]], (low, high): &Bounds, children: &[Bounds; CHILDREN]) {
    let mut exponents = 0;
    for k in 0..3 {
        let origin = f64::from(low[k]);
        let exponent = cell_exponent(f64::from(high[k]) - origin);
        exponents |= exponent << (8 * k);
        // A power of two, so that the product is that of a division.
        let per_cell = 1.0 / cell(exponent);
        // Eight low planes in two words, then eight high ones.
        let mut planes = [0; 4];
        for (slot, (child_low, child_high)) in children.iter().enumerate() {
            let place = |x: f32| (f64::from(x) - origin) * per_cell;
            let shift = 8 * (slot % 4);
            planes[slot / 4] |= rounded_down(place(child_low[k])) << shift;
            planes[slot / 4 + 2] |= rounded_up(place(child_high[k])) << shift;
        }
        node[2 + k] = planes;
        node[0][k] = low[k].to_bits();
    }
    node[0][3] = node[0][3] & 0xff00_0000 | exponents;
}

/// The greatest number of 8 bits that is at most `x`, or 0.
fn rounded_down(x: f64) -> u32 {
    // The conversion truncates, and takes numbers that are out of range to the nearest one within.
    (x as u32).min(255)
}

/// The least number of 8 bits that is at least `x`, or 255.
fn rounded_up(x: f64) -> u32 {
    let below = rounded_down(x);
    (below + u32::from(f64::from(below) < x)).min(255)
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

/// The areas of the children of a node, half of each.
fn area_of_children(node: &[[u32; 4]]) -> f64 {
    // Sums of the faces in cells: whole numbers, which need no decoding of the planes.
    let mut faces = [0; 3];
    for slot in (0..CHILDREN).filter(|slot| !is_empty(node, *slot)) {
        let plane = |k: usize, word: usize| node[2 + k][word + slot / 4] >> (8 * (slot % 4)) & 0xff;
        let [x, y, z]: [u32; 3] = core::array::from_fn(|k| plane(k, 2).saturating_sub(plane(k, 0)));
        faces = [faces[0] + x * y, faces[1] + y * z, faces[2] + z * x];
    }
    let [x, y, z]: [f64; 3] = core::array::from_fn(|k| cell(node[0][3] >> (8 * k) & 0xff));
    let [xy, yz, zx] = faces.map(f64::from);
    xy * x * y + yz * y * z + zx * z * x
}

fn is_empty(node: &[[u32; 4]], slot: usize) -> bool {
    let code = node[1][2 + slot / 4] >> (8 * (slot % 4)) & 0xff;
    node[0][3] >> (24 + slot) & 1 == 0 && code >> 5 == 0
}

/// Expected number of boxes that a random ray through the tree hits: the areas of all children relative to that of the root.
pub(crate) fn cost(nodes: &[[u32; 4]]) -> f64 {
    relative_cost(nodes.chunks_exact(STRIDE).map(area_of_children), nodes)
}

/// `areas`: those of the children, by node.
fn relative_cost(areas: impl Iterator<Item = f64>, nodes: &[[u32; 4]]) -> f64 {
    let mut all = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    if let Some(root) = nodes.get(..STRIDE) {
        for slot in (0..CHILDREN).filter(|slot| !is_empty(root, *slot)) {
            let [low, high] = child_box(root, slot);
            all = [core::array::from_fn(|k| all[0][k].min(low[k])), core::array::from_fn(|k| all[1][k].max(high[k]))];
        }
    }
    areas.sum::<f64>() / area(all).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::accel::tlas::build_tlas;

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
        let mut tree = tree.clone();
        let refit = Refit::new(&mut tree, moved);
        let bounds_at = |position: usize| moved[tree.order[position] as usize].1;
        let everything = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
        assert_eq!(enclosed(&tree.nodes, 0, &everything, &bounds_at), moved.len());
        assert_eq!(refit.cost(&tree), cost(&tree.nodes));
        tree.nodes
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

    #[test]
    fn a_refit_of_a_few_instances_gives_the_bits_of_a_refit_of_all() {
        for (count, seed) in [(1, 1), (2, 2), (9, 3), (500, 4), (3000, 5)] {
            let mut instances = boxes(count, seed, 100.0, 1.0);
            let mut tree = build_tlas(&instances);
            let mut refit = Refit::new(&mut tree, &instances);
            for round in 1..40 {
                // Some stay where they are, some move a little, and some far away and back.
                let movers = 1 + (round as usize * round as usize) % (count / 4 + 1);
                let choice = random(2 * movers, seed + 100 * round);
                let targets = boxes(movers, seed + 100 * round, [100.0, 1.0e6, 1.0e-3][round as usize % 3], 1.0);
                let mut moved = Vec::new();
                for (numbers, (_, target)) in choice.chunks_exact(2).zip(targets) {
                    let place = ((numbers[0] * count as f32) as usize).min(count - 1);
                    if numbers[1] > 0.2 {
                        instances[place].1 = target;
                    }
                    moved.push(place as u32);
                }
                let before = tree.nodes.clone();
                let fitted = refit.update(&mut tree, &instances, &moved);
                let mut all = tree.clone();
                let complete = Refit::new(&mut all, &instances);
                assert!(tree.nodes == all.nodes, "{movers} of {count}, round {round}");
                assert_eq!((refit.cost(&tree), refit.bounds()), (complete.cost(&all), complete.bounds()));
                let differs = |node: &usize| before[node * STRIDE..][..STRIDE] != tree.nodes[node * STRIDE..][..STRIDE];
                let changed: Vec<_> = (0..tree.nodes.len() / STRIDE).filter(differs).collect();
                assert!(fitted.is_sorted() && changed.iter().all(|node| fitted.binary_search(node).is_ok()));
            }
        }
    }

    #[test]
    fn a_refit_visits_only_nodes_above_the_instances_that_have_moved() {
        let mut instances = boxes(20_000, 1, 100.0, 0.1);
        let mut tree = build_tlas(&instances);
        let mut refit = Refit::new(&mut tree, &instances);
        let (low, high) = &mut instances[777].1;
        low[0] += 0.5;
        high[0] += 0.5;
        let fitted = refit.update(&mut tree, &instances, &[777]);
        assert!((1..=10).contains(&fitted.len()), "{} nodes", fitted.len());
        assert_eq!(refit.update(&mut tree, &instances, &[777]).len(), 1, "nothing has changed");
    }

    #[test]
    fn cells_are_the_least_powers_of_two_that_span_a_box() {
        for (extent, power) in [(255.0, 0), (255.000_000_1, 1), (254.999_999_9, 0), (510.0, 1), (128.0, 0), (127.0, -1)]
        {
            assert_eq!(cell_exponent(extent) as i32 - 127, power, "{extent}");
        }
        assert_eq!([cell_exponent(0.0), cell_exponent(1e-45), cell_exponent(1e300)], [1, 1, 254]);
        let rounded =
            [-1.0, 0.0, 0.5, 254.5, 1e9, f64::INFINITY, f64::NEG_INFINITY].map(|x| (rounded_down(x), rounded_up(x)));
        assert_eq!(rounded, [(0, 0), (0, 0), (0, 1), (254, 255), (255, 255), (255, 255), (0, 0)]);
    }
}
