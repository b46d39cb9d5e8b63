//! Fits the boxes of a top-level tree to instances that have moved, which takes a third of the time of a new tree (`docs/experiments.md`,
//! "Number of instances"), and less if few have.  Instances can also be taken out of the tree.
//!
//! The tree keeps its topology, so that it gets slower to trace as instances move away from their neighbors: the [cost](Refit::cost) measures
//! by how much.

use crate::gpu_layout::NONE;
use crate::scene::accel::{
    blas::{Bounds, NO_BOUNDS, joined},
    tlas::Tlas,
    wide_node::{
        CHILDREN, Child, STRIDE, area, area_of_children, child, child_box, is_empty, remove_leaf, write_boxes,
    },
};

/// Share of the instances, as its reciprocal, above which all nodes are fitted in one pass: if more have moved or gone, most nodes are due.
const FEW: usize = 8;

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

    /// Fits the tree after the bounds at the places `moved` of `instances` have changed, and takes the instances at the places `gone` out of
    /// it.  Returns the nodes that may have changed, in ascending order.
    pub(crate) fn update(
        &mut self,
        tree: &mut Tlas,
        instances: &[(u32, Bounds)],
        moved: &[u32],
        gone: &[u32],
    ) -> Vec<usize> {
        gone.iter().for_each(|place| self.remove(tree, *place));
        if FEW * (moved.len() + gone.len()) > instances.len() {
            self.fit_all(tree, instances);
            return (0..self.boxes.len()).collect();
        }
        for place in moved.iter().chain(gone) {
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

    /// Takes the leaf of an instance out of its node.  The leaf has no other instance.
    fn remove(&self, tree: &mut Tlas, place: u32) {
        let Tlas { nodes, order, .. } = tree;
        let node = &mut nodes[self.leaf_nodes[place as usize] as usize * STRIDE..][..STRIDE];
        for slot in 0..CHILDREN {
            if matches!(child(node, slot), Child::Leaf(first, _) if order[first] == place) {
                remove_leaf(node, slot);
            }
        }
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

    /// Expected number of boxes that a random ray through the tree hits: the areas of all children relative to that of the root.
    pub(crate) fn cost(&self, tree: &Tlas) -> f64 {
        relative_cost(self.areas.iter().copied(), &tree.nodes)
    }
}

/// Zeros of different signs differ.
fn bits((low, high): Bounds) -> [[u32; 3]; 2] {
    [low, high].map(|corner| corner.map(f32::to_bits))
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
    use crate::scene::accel::{reached::Reached, tlas::build_tlas, wide_node::Node};

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

    fn cost(nodes: &[[u32; 4]]) -> f64 {
        relative_cost(nodes.chunks_exact(STRIDE).map(area_of_children), nodes)
    }

    fn boxes(count: usize, seed: u32, scale: f32, size: f32) -> Vec<(u32, Bounds)> {
        let numbers = random(6 * count, seed);
        let at = |c: &[f32], k: usize| (c[k] - 0.5) * scale;
        let bounds = |c: &[f32]| -> Bounds {
            (core::array::from_fn(|k| at(c, k)), core::array::from_fn(|k| at(c, k) + c[3 + k] * size))
        };
        numbers.chunks_exact(6).enumerate().map(|(i, c)| (7 * i as u32, bounds(c))).collect()
    }

    /// Asserts that rays reach these instances, and no others, through boxes that enclose them.
    fn assert_holds(tree: &Tlas, instances: &[(u32, Bounds)]) {
        let node_at = |index: u32| -> Node { core::array::from_fn(|i| tree.nodes[index as usize * STRIDE + i]) };
        Reached::new(Some(0), node_at, |place| tree.indices[place / 4][place % 4]).assert_holds(instances);
    }

    fn refitted(tree: &Tlas, moved: &[(u32, Bounds)]) -> Vec<[u32; 4]> {
        let mut tree = tree.clone();
        let refit = Refit::new(&mut tree, moved);
        assert_holds(&tree, moved);
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
                let fitted = refit.update(&mut tree, &instances, &moved, &[]);
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
        let fitted = refit.update(&mut tree, &instances, &[777], &[]);
        assert!((1..=10).contains(&fitted.len()), "{} nodes", fitted.len());
        assert_eq!(refit.update(&mut tree, &instances, &[777], &[]).len(), 1, "nothing has changed");
    }

    #[test]
    fn instances_that_are_taken_out_are_not_reached_and_leave_boxes_that_fit_the_rest() {
        for count in [1, 2, 9, 500, 3000] {
            let mut instances = boxes(count, 6, 100.0, 1.0);
            let mut tree = build_tlas(&instances);
            let mut refit = Refit::new(&mut tree, &instances);
            let mut rest: Vec<u32> = (0..count as u32).collect();
            for round in 0.. {
                // Few go at first, and many at last; some of the others move.
                let many = (1 + round * round / 2).min(rest.len());
                let gone: Vec<u32> = (0..many).map(|i| rest.swap_remove(131 * (i + round) % rest.len())).collect();
                let moved: Vec<u32> = rest.iter().copied().skip(round).take(round % 4).collect();
                for place in &moved {
                    instances[*place as usize].1 = boxes(1, *place + round as u32, 120.0, 1.0)[0].1;
                }
                refit.update(&mut tree, &instances, &moved, &gone);
                let left: Vec<_> = rest.iter().map(|place| instances[*place as usize]).collect();
                assert_holds(&tree, &left);
                assert_eq!(refit.bounds(), left.iter().map(|(_, bounds)| *bounds).fold(NO_BOUNDS, joined));
                assert_eq!(refit.cost(&tree), cost(&tree.nodes));
                assert!(tree.nodes.iter().flatten().all(|word| *word != f32::INFINITY.to_bits()), "round {round}");
                if rest.is_empty() {
                    break;
                }
            }
        }
    }
}
