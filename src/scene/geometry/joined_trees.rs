//! Two trees with a common root, as the node buffer has them.
//!
//! Children of a node stand side by side, so the roots of the two trees are neighbors.  In units of a node, the order is:
//!
//! 1. the common root, the root of the main tree and the root of the tree over newcomers;
//! 2. the other nodes of the main tree, and its list of entries;
//! 3. the other nodes of the tree over newcomers, and its list; they come last, because their size changes often.
//!
//! Without newcomers, rays start at the root of the main tree.

use crate::scene::accel::{
    blas::{Bounds, bake},
    tlas::Tlas,
    wide_node::{Node, STRIDE, parent_of_two},
};

/// Units of the three roots.
const COMMON: usize = 0;
const MAIN: usize = 1;
const NEWCOMERS: usize = 2;
/// The first unit after them.
const REST: usize = 3;

static NO_TREE: Tlas = Tlas { nodes: Vec::new(), indices: Vec::new(), order: Vec::new() };

/// A main tree, and a tree over newcomers, which may be empty.
pub(crate) struct JoinedTrees<'a> {
    main: &'a Tlas,
    newcomers: &'a Tlas,
    common_root: Node,
}

impl<'a> JoinedTrees<'a> {
    /// A tree alone.
    pub(crate) fn single(main: &'a Tlas) -> Self {
        Self { main, newcomers: &NO_TREE, common_root: Node::default() }
    }

    /// Two trees with their bounds.
    pub(super) fn two(main: &'a Tlas, newcomers: &'a Tlas, bounds: [Bounds; 2]) -> Self {
        Self { main, newcomers, common_root: parent_of_two(bounds, MAIN as u32) }
    }

    /// Where the list of entries begins.  Leaves of both trees count from here.
    pub(super) fn list_start(&self) -> usize {
        REST + nodes_below_root(self.main)
    }

    /// Where the tree over newcomers begins, without its root.
    pub(super) fn newcomers_start(&self) -> usize {
        self.list_start() + size_of_list(self.main)
    }

    fn newcomers_list_start(&self) -> usize {
        self.newcomers_start() + nodes_below_root(self.newcomers)
    }

    /// The first unit that is not used.
    pub(super) fn end(&self) -> usize {
        match self.main.nodes.is_empty() {
            true => 0,
            false => self.newcomers_list_start() + size_of_list(self.newcomers),
        }
    }

    /// Index of the node in which rays start, where the units begin at the node `start`; `None` if there are no instances.
    pub(super) fn root(&self, start: u32) -> Option<u32> {
        let unit = if self.newcomers.nodes.is_empty() { MAIN } else { COMMON };
        (!self.main.nodes.is_empty()).then_some(start + unit as u32)
    }

    /// A unit, where the units begin at the node `start`.
    pub(super) fn unit(&self, unit: usize, start: u32) -> Node {
        let (list, newcomers) = (self.list_start(), self.newcomers_start());
        let newcomers_list = self.newcomers_list_start();
        // In each tree, the nodes below the root have the indices from 1 on.  Here those of the main tree begin at the unit `REST`, and those of
        // the other tree at the unit `newcomers`.
        let of_main = |node: usize| baked(self.main, node, start + (REST - 1) as u32, 0);
        let of_newcomers = |node: usize| {
            let entries_before = 4 * STRIDE * (newcomers_list - list);
            baked(self.newcomers, node, start + (newcomers - 1) as u32, entries_before as u32)
        };
        match unit {
            COMMON => {
                let mut node = self.common_root;
                bake(&mut node, start, 0);
                node
            }
            MAIN => of_main(0),
            NEWCOMERS => of_newcomers(0),
            unit if unit < list => of_main(unit - REST + 1),
            unit if unit < newcomers => part_of_list(self.main, unit - list),
            unit if unit < newcomers_list => of_newcomers(unit - newcomers + 1),
            unit => part_of_list(self.newcomers, unit - newcomers_list),
        }
    }

    /// The units that may have changed, in ascending order: those of these nodes of the main tree, and all units of the tree over newcomers if
    /// that was built again (`newcomers`).
    pub(super) fn changed_units(&self, main_nodes: &[usize], newcomers: bool) -> Vec<usize> {
        // The common root has the bounds of both trees.
        let mut units = if self.newcomers.nodes.is_empty() { Vec::new() } else { vec![COMMON] };
        units.extend(main_nodes.iter().map(|node| if *node == 0 { MAIN } else { node + REST - 1 }));
        if newcomers {
            units.push(NEWCOMERS);
            units.extend(self.newcomers_start()..self.end());
        }
        units.sort();
        units
    }
}

fn nodes_below_root(tree: &Tlas) -> usize {
    (tree.nodes.len() / STRIDE).saturating_sub(1)
}

fn size_of_list(tree: &Tlas) -> usize {
    tree.indices.len().div_ceil(STRIDE)
}

/// A node of a tree, with these numbers added to the indices of its children and of its entries; zeros if the tree does not have it.
fn baked(tree: &Tlas, node: usize, children: u32, entries: u32) -> Node {
    let Some(words) = tree.nodes.get(node * STRIDE..(node + 1) * STRIDE) else { return Node::default() };
    let mut node: Node = core::array::from_fn(|i| words[i]);
    bake(&mut node, children, entries);
    node
}

/// The part of a list of entries that fills a unit.
fn part_of_list(tree: &Tlas, part: usize) -> Node {
    core::array::from_fn(|i| tree.indices.get(part * STRIDE + i).copied().unwrap_or_default())
}

#[cfg(any(test, feature = "testing"))]
impl JoinedTrees<'_> {
    /// What rays reach if the units begin at the node `start`.
    pub(super) fn reached(&self, start: u32) -> crate::scene::accel::reached::Reached {
        let node_at = |index: u32| self.unit((index - start) as usize, start);
        let entry_at = |place: usize| {
            let unit = self.unit(self.list_start() + place / (4 * STRIDE), start);
            unit[place / 4 % STRIDE][place % 4]
        };
        crate::scene::accel::reached::Reached::new(self.root(start), node_at, entry_at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::accel::{blas::joined, reached::Reached, refit::Refit, tlas::build_tlas};

    /// Boxes in a row, with entries from `first` on.
    fn row(first: u32, count: u32) -> Vec<(u32, Bounds)> {
        let at = |i: u32| ([0.7 * i as f32, 1.0, -2.0], [0.7 * i as f32 + 1.0, 1.5, 3.0]);
        (first..first + count).map(|i| (i, at(i))).collect()
    }

    fn tree(entries: &[(u32, Bounds)]) -> Tlas {
        let mut tree = build_tlas(entries);
        _ = Refit::new(&mut tree, entries);
        tree
    }

    fn bounds(entries: &[(u32, Bounds)]) -> Bounds {
        entries.iter().map(|(_, bounds)| *bounds).reduce(joined).expect("there are entries")
    }

    #[test]
    fn rays_reach_the_entries_of_both_trees_wherever_they_lie() {
        for (main, newcomers) in [(1, 1), (1, 0), (9, 1), (300, 70), (300, 0), (21, 200)] {
            let (main, newcomers) = (row(1000, main), row(5, newcomers));
            let [large, small] = [&main, &newcomers].map(|entries| tree(entries));
            let trees = match newcomers.is_empty() {
                true => JoinedTrees::single(&large),
                false => JoinedTrees::two(&large, &small, [bounds(&main), bounds(&newcomers)]),
            };
            for start in [0, 77] {
                trees.reached(start).assert_holds(&[main.clone(), newcomers.clone()].concat());
            }
        }
        let nothing = Tlas::default();
        let trees = JoinedTrees::single(&nothing);
        assert_eq!((trees.end(), trees.root(5), trees.reached(5)), (0, None, Reached::default()));
    }

    #[test]
    fn changed_units_are_those_of_the_nodes() {
        let (main, newcomers) = (row(0, 300), row(1000, 70));
        let [large, small] = [&main, &newcomers].map(|entries| tree(entries));
        let trees = JoinedTrees::two(&large, &small, [bounds(&main), bounds(&newcomers)]);
        assert_eq!(trees.changed_units(&[0, 1, 7], false), [0, 1, 3, 9]);
        let all: Vec<usize> = (0..large.nodes.len() / STRIDE).collect();
        let lists = trees.list_start()..trees.newcomers_start();
        let expected: Vec<usize> = (0..trees.end()).filter(|unit| !lists.contains(unit)).collect();
        assert_eq!(trees.changed_units(&all, true), expected);
    }
}
