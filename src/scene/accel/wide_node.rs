//! Nodes of 8-wide compressed trees on the CPU: reads and writes their children and the children's boxes (`shaders/trace/tree.wgsl` has the
//! layout).

use crate::gpu_layout::NODE_STRIDE;
use crate::scene::accel::blas::{Bounds, NO_BOUNDS, joined};

pub(crate) const STRIDE: usize = NODE_STRIDE as usize;
pub(crate) const CHILDREN: usize = 8;

/// The words of a node.
pub(crate) type Node = [[u32; 4]; STRIDE];

/// A child of a node.
pub(crate) enum Child {
    Empty,
    /// Index of the node.
    Node(usize),
    /// Positions of the first primitive and of the one after the last, in the order of the leaves.
    Leaf(usize, usize),
}

/// The child in a slot of a node.
pub(crate) fn child(node: &[[u32; 4]], slot: usize) -> Child {
    let inner = node[0][3] >> 24;
    let code = node[1][2 + slot / 4] >> (8 * (slot % 4)) & 0xff;
    if inner & 1 << slot != 0 {
        let before = (inner & ((1 << slot) - 1)).count_ones();
        return Child::Node((node[1][0] + before) as usize);
    }
    let (first, count) = (node[1][1] + (code & 31), (code >> 5).count_ones());
    if count == 0 { Child::Empty } else { Child::Leaf(first as usize, (first + count) as usize) }
}

/// Takes a leaf out of a node: no ray hits an empty slot, whatever its box.
pub(crate) fn remove_leaf(node: &mut [[u32; 4]], slot: usize) {
    node[1][2 + slot / 4] &= !(0xff_u32 << (8 * (slot % 4)));
}

/// A node above two nodes with these bounds, which stand side by side from the index `first` on.
pub(crate) fn parent_of_two(children: [Bounds; 2], first: u32) -> Node {
    // Two inner children, whose bytes have the positions of their bits in the result of a test.
    let mut node = [[0, 0, 0, 0b11 << 24], [first, 0, 0x3938, 0], [0; 4], [0; 4], [0; 4]];
    let mut boxes = [NO_BOUNDS; CHILDREN];
    boxes[..2].copy_from_slice(&children);
    write_boxes(&mut node, &joined(children[0], children[1]), &boxes);
    node
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

/// Writes the boxes of a node's children, rounded outward.  Each plane is low + q·cell, where q has 8 bits and the cell is a power of two.  The
/// first bounds are those of all children.
pub(crate) fn write_boxes(node: &mut [[u32; 4]], (low, high): &Bounds, children: &[Bounds; CHILDREN]) {
    let mut exponents = 0;
    for k in 0..3 {
        // A node without children has no low corner.
        let low = if low[k] <= high[k] { low[k] } else { 0.0 };
        let origin = f64::from(low);
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
        node[0][k] = low.to_bits();
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
pub(crate) fn child_box(node: &[[u32; 4]], slot: usize) -> [[f64; 3]; 2] {
    let plane = |k: usize, word: usize| {
        let q = node[2 + k][word + slot / 4] >> (8 * (slot % 4)) & 0xff;
        let exponent = node[0][3] >> (8 * k) & 0xff;
        f64::from(f32::from_bits(node[0][k])) + f64::from(q) * cell(exponent)
    };
    [0, 2].map(|word| core::array::from_fn(|k| plane(k, word)))
}

/// Half of the area of a box.
pub(crate) fn area([low, high]: [[f64; 3]; 2]) -> f64 {
    let [x, y, z]: [f64; 3] = core::array::from_fn(|k| (high[k] - low[k]).max(0.0));
    x * y + y * z + z * x
}

/// The areas of the children of a node, half of each.
pub(crate) fn area_of_children(node: &[[u32; 4]]) -> f64 {
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

/// Whether a slot of a node has no child.
pub(crate) fn is_empty(node: &[[u32; 4]], slot: usize) -> bool {
    let code = node[1][2 + slot / 4] >> (8 * (slot % 4)) & 0xff;
    node[0][3] >> (24 + slot) & 1 == 0 && code >> 5 == 0
}

#[cfg(test)]
mod tests {
    use super::*;

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
