//! What rays can reach in a top level, for tests.

use crate::scene::accel::{
    blas::{Bounds, MAX_TLAS_DEPTH},
    wide_node::{CHILDREN, Child, Node, child, child_box},
};

/// Low and high corner of a part of space.
type Space = [[f64; 3]; 2];

/// The nodes and the entries that rays can reach.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reached {
    /// Nodes with their indices, parents before their children.
    pub nodes: Vec<(u32, Node)>,
    /// Entries of leaves, each with the space that all boxes on the way to it have in common.
    pub entries: Vec<(u32, Space)>,
}

impl Reached {
    /// Goes down from a root.  `node_at`: the node with an index; `entry_at`: the entry at a place of the list that leaves refer to.
    pub(crate) fn new(root: Option<u32>, node_at: impl Fn(u32) -> Node, entry_at: impl Fn(usize) -> u32) -> Self {
        const EVERYWHERE: Space = [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]];
        let mut reached = Self::default();
        let mut waiting: Vec<(u32, u32, Space)> = root.map(|root| (root, 1, EVERYWHERE)).into_iter().collect();
        while let Some((index, level, within)) = waiting.pop() {
            assert!(level <= MAX_TLAS_DEPTH, "a ray's stack has no room for level {level}");
            let node = node_at(index);
            for slot in 0..CHILDREN {
                let space = common(&within, &widened(child_box(&node, slot), &node));
                match child(&node, slot) {
                    Child::Empty => {}
                    Child::Node(below) => waiting.push((below as u32, level + 1, space)),
                    Child::Leaf(first, end) => {
                        reached.entries.extend((first..end).map(|place| (entry_at(place), space)));
                    }
                }
            }
            reached.nodes.push((index, node));
        }
        reached
    }

    /// Panics unless rays can reach each of these entries in one way, within all of its bounds, and nothing else.
    pub fn assert_holds(&self, entries: &[(u32, Bounds)]) {
        let mut reached = self.entries.clone();
        let mut expected = entries.to_vec();
        reached.sort_by_key(|(entry, _)| *entry);
        expected.sort_by_key(|(entry, _)| *entry);
        let found: Vec<u32> = reached.iter().map(|(entry, _)| *entry).collect();
        let wanted: Vec<u32> = expected.iter().map(|(entry, _)| *entry).collect();
        let differs = || found.iter().zip(&wanted).find(|(found, wanted)| found != wanted);
        let (many, more) = (found.len(), wanted.len());
        assert!(found == wanted, "rays reach {many} entries of {more}; the first one that differs: {:?}", differs());
        for ((entry, space), (_, bounds)) in reached.iter().zip(&expected) {
            assert!(
                contains(space, bounds),
                "entry {entry}, {bounds:?}, is partly outside of the boxes on the way to it: {space:?}"
            );
        }
    }
}

fn contains([low, high]: &Space, bounds: &Bounds) -> bool {
    (0..3).all(|k| low[k] <= f64::from(bounds.0[k]) && f64::from(bounds.1[k]) <= high[k])
}

/// A box of a node, widened by the rounding of its planes: each is the sum of a corner and a number of cells, in f64.  Denormal numbers count as 0
/// where a driver has set the processor so.
fn widened([low, high]: Space, node: &Node) -> Space {
    let rounding = |k: usize| {
        let corner = f64::from(f32::from_bits(node[0][k]));
        f64::from(f32::MIN_POSITIVE) + 1e-15 * (corner.abs() + low[k].abs() + high[k].abs())
    };
    [core::array::from_fn(|k| low[k] - rounding(k)), core::array::from_fn(|k| high[k] + rounding(k))]
}

fn common(a: &Space, b: &Space) -> Space {
    [core::array::from_fn(|k| a[0][k].max(b[0][k])), core::array::from_fn(|k| a[1][k].min(b[1][k]))]
}
