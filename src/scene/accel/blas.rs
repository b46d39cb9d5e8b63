//! Builds a bottom-level tree from the triangles of a mesh: an 8-wide compressed tree (CWBVH; Ylitie, Karras and Laine 2017), the triangles
//! in the order of its leaves, and the vertices in the order of these triangles.
//!
//! The crate obvhs builds a binary tree by PLOC, improves it by reinsertion, and converts it.  Only this file and `tlas.rs` use obvhs.
//! Their interfaces take and return plain arrays, because obvhs has its own version of glam.

use crate::gpu_layout::{GpuTriangle, GpuVertex, NODE_STRIDE, NONE};
use crate::scene::geometry::{
    rig::Rig,
    triangulate::{Geometry, HalfColor},
};
use obvhs::{
    Boundable, BvhBuildParams,
    aabb::Aabb,
    bvh2::{Bvh2, node::Bvh2Node, reinsertion::ReinsertionOptimizer},
    cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh,
    ploc::PlocBuilder,
};

/// An axis-aligned box: its minimum and maximum corner.
pub type Bounds = ([f32; 3], [f32; 3]);

/// The box of no points.
pub(crate) const NO_BOUNDS: Bounds = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);

/// The box around two boxes.
pub(crate) fn joined(a: Bounds, b: Bounds) -> Bounds {
    (std::array::from_fn(|k| a.0[k].min(b.0[k])), std::array::from_fn(|k| a.1[k].max(b.1[k])))
}

/// Entries of the traversal stack, equal to `STACK_SIZE` in `shaders/trace/software.wgsl`.  Each level of a bottom-level tree takes at most
/// two entries (nodes and triangles), each level of the top level takes one, and entering an instance takes two.
pub const STACK_SIZE: u32 = 80;
/// Maximum number of levels of a bottom-level tree.
pub const MAX_BLAS_DEPTH: u32 = 32;
/// Maximum number of levels of a top-level tree.
pub const MAX_TLAS_DEPTH: u32 = STACK_SIZE - 2 * MAX_BLAS_DEPTH - 2;

// A deeper binary tree is not converted, because the conversion of obvhs recurses and could overflow the stack.
const MAX_BINARY_DEPTH: u32 = 160;

/// The tree of a mesh.  Its indices of nodes, triangles and vertices start at 0 until [`bake`] and [`bake_vertices`] add their offsets in the
/// shared buffers.
#[derive(Clone, Debug, Default)]
pub struct Blas {
    /// [`NODE_STRIDE`] elements for each node.
    pub nodes: Vec<[u32; 4]>,
    /// Triangles in the order of the leaves.
    pub triangles: Vec<GpuTriangle>,
    /// Vertices in the order in which `triangles` have them first, so that neighbors are near each other in memory.
    pub vertices: Vec<GpuVertex>,
    /// Second texture coordinates in the order of `triangles`; empty if the mesh has none.
    pub second_uvs: Vec<[[f32; 2]; 3]>,
    /// Vertex colors in the order of `triangles`; empty if the mesh has none.
    pub colors: Vec<[HalfColor; 3]>,
    /// Joints and morph targets of a mesh that bends.
    pub rig: Option<Rig>,
    /// Bounds of all triangles.
    pub bounds: Bounds,
}

#[cfg(feature = "testing")]
impl Blas {
    /// Number of levels, at most [`MAX_BLAS_DEPTH`].
    pub fn depth(&self) -> u32 {
        wide_depth(&self.nodes)
    }
}

/// Builds the tree of a mesh; `None` if it has no triangles.
pub fn build_blas(geometry: &Geometry) -> Option<Blas> {
    let tree = build_triangle_tree(&geometry.corners())?;
    let mut order_of_vertices = Vec::with_capacity(geometry.vertices.len());
    let mut places = vec![NONE; geometry.vertices.len()];
    let mut place_of = |vertex: u32| {
        let place = &mut places[vertex as usize];
        if *place == NONE {
            *place = order_of_vertices.len() as u32;
            order_of_vertices.push(vertex);
        }
        *place
    };
    let triangle = |&i: &u32| {
        let [a, b, c] = geometry.triangles[i as usize].map(&mut place_of);
        GpuTriangle { a, b, c }
    };
    let triangles = tree.order.iter().map(triangle).collect();
    Some(Blas {
        triangles,
        vertices: order_of_vertices.iter().map(|&i| geometry.vertices[i as usize]).collect(),
        second_uvs: tree.order.iter().filter_map(|&i| geometry.second_uvs.get(i as usize).copied()).collect(),
        colors: tree.order.iter().filter_map(|&i| geometry.colors.get(i as usize).copied()).collect(),
        rig: geometry.rig.as_ref().map(|vertices| vertices.pack(geometry, &order_of_vertices, &tree.nodes)),
        nodes: tree.nodes,
        bounds: tree.bounds,
    })
}

/// Adds the offsets of a tree in the shared buffers to its indices: `node_base` in nodes, `primitive_base` in triangles.
pub fn bake(nodes: &mut [[u32; 4]], node_base: u32, primitive_base: u32) {
    for node in nodes.chunks_exact_mut(NODE_STRIDE as usize) {
        node[1][0] = node[1][0].wrapping_add(node_base);
        node[1][1] = node[1][1].wrapping_add(primitive_base);
    }
}

/// Adds the offset of a mesh's vertices in the shared buffer to the indices of its triangles.
pub fn bake_vertices(triangles: &mut [GpuTriangle], vertex_base: u32) {
    for triangle in triangles {
        for vertex in [&mut triangle.a, &mut triangle.b, &mut triangle.c] {
            *vertex += vertex_base;
        }
    }
}

/// Bounds of the points.
pub(crate) fn bounds_of(points: &[[f32; 3]]) -> Bounds {
    points.iter().fold(NO_BOUNDS, |bounds, &point| joined(bounds, (point, point)))
}

/// A tree over boxes: its nodes, and the indices of the boxes in the order of its leaves.
pub(crate) struct Tree {
    pub(crate) nodes: Vec<[u32; 4]>,
    pub(crate) order: Vec<u32>,
    pub(crate) bounds: Bounds,
}

impl Tree {
    /// The tree scaled by 2^`times`.  A power of two changes exponents only, so nothing is rounded.
    fn doubled(mut self, times: i32) -> Self {
        if times == 0 {
            return self;
        }
        let scale = 2.0f32.powi(times);
        for node in self.nodes.chunks_exact_mut(NODE_STRIDE as usize) {
            // The first element has the origin of the grid of child boxes and, in three bytes, the exponents of its cells.
            let [x, y, z, exponents] = node[0];
            let [x, y, z] = [x, y, z].map(|bits| (f32::from_bits(bits) * scale).to_bits());
            node[0] = [x, y, z, exponents + times as u32 * 0x01_01_01];
        }
        let (min, max) = self.bounds;
        self.bounds = (min.map(|x| x * scale), max.map(|x| x * scale));
        self
    }
}

struct Leaf(Aabb);

impl Boundable for Leaf {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

/// Largest coordinate of the boxes that obvhs gets.  It adds up the areas of all nodes in f32: even 2^26 nodes of this size do not overflow.
const MAX_BUILDER_COORDINATE: f32 = (1u64 << 40) as f32;

/// Builds a tree over triangles; `None` if there are none.
pub(crate) fn build_triangle_tree(triangles: &[[[f32; 3]; 3]]) -> Option<Tree> {
    let boxes: Vec<Bounds> = triangles.iter().map(|corners| bounds_of(corners)).collect();
    build_tree(&boxes, BvhBuildParams::medium_build(), 3, MAX_BLAS_DEPTH)
}

/// Builds a tree over finite boxes, of which a leaf has at most `max_leaf`, 1 to 3.  If it is deeper than `max_depth`, a balanced tree
/// along a space-filling curve replaces it.
pub(crate) fn build_tree(boxes: &[Bounds], parameters: BvhBuildParams, max_leaf: u32, max_depth: u32) -> Option<Tree> {
    if boxes.is_empty() {
        return None;
    }
    let halvings = halvings_of(boxes);
    let scale = 0.5f32.powi(halvings);
    let corner = |corner: &[f32; 3]| corner.map(|x| x * scale).into();
    let leaves: Vec<Leaf> = boxes.iter().map(|(min, max)| Leaf(Aabb::new(corner(min), corner(max)))).collect();
    let balanced_tree = || convert(&balanced(&morton_order(boxes), &leaves), max_leaf, max_depth);
    let tree = match agglomeration_stalls(&leaves, &parameters) {
        true => balanced_tree(),
        false => {
            let mut binary = agglomerate(&leaves, &parameters);
            ReinsertionOptimizer::default().run(&mut binary, parameters.reinsertion_batch_ratio, None);
            convert(&binary, max_leaf, max_depth).or_else(balanced_tree)
        }
    };
    tree.map(|tree| tree.doubled(halvings))
}

/// How often the boxes must be halved to fit [`MAX_BUILDER_COORDINATE`].
fn halvings_of(boxes: &[Bounds]) -> i32 {
    let largest = boxes.iter().flat_map(|(min, max)| min.iter().chain(max)).fold(0.0f32, |most, x| most.max(x.abs()));
    (largest / MAX_BUILDER_COORDINATE).log2().ceil().max(0.0) as i32
}

fn agglomerate(leaves: &[Leaf], parameters: &BvhBuildParams) -> Bvh2 {
    PlocBuilder::new().build(
        parameters.ploc_search_distance,
        leaves,
        (0..leaves.len() as u32).collect(),
        parameters.sort_precision,
        parameters.search_depth_threshold,
    )
}

/// Where boxes are nested in each other, PLOC merges only one pair in each round, so that its time is quadratic: minutes for 1e5 boxes.  The
/// depth of the tree over a subset of the boxes reveals such input.
fn agglomeration_stalls(leaves: &[Leaf], parameters: &BvhBuildParams) -> bool {
    const SAMPLE: usize = 1024;
    if leaves.len() < 4 * SAMPLE {
        return false;
    }
    let sample: Vec<Leaf> = leaves.iter().step_by(leaves.len() / SAMPLE).map(|leaf| Leaf(leaf.0)).collect();
    binary_depth(&agglomerate(&sample, parameters)) > MAX_BINARY_DEPTH
}

/// Indices of the boxes, sorted by the Morton code of their centers with 10 bits per axis.
fn morton_order(boxes: &[Bounds]) -> Vec<u32> {
    let center = |(min, max): &Bounds| -> [f32; 3] { std::array::from_fn(|k| 0.5 * min[k] + 0.5 * max[k]) };
    let (low, high) = bounds_of(&boxes.iter().map(center).collect::<Vec<_>>());
    let code = |b: &Bounds| {
        let c = center(b);
        (0..3).fold(0u32, |code, k| {
            let cell = ((c[k] - low[k]) / (high[k] - low[k]).max(f32::MIN_POSITIVE) * 1023.0) as u32;
            (0..10).fold(code, |code, bit| code | (cell >> bit & 1) << (3 * bit + k as u32))
        })
    };
    let mut order: Vec<(u32, u32)> = boxes.iter().enumerate().map(|(i, b)| (code(b), i as u32)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

/// Converts a binary tree to a compressed 8-wide tree; `None` if either is too deep.
fn convert(binary: &Bvh2, max_leaf: u32, max_depth: u32) -> Option<Tree> {
    if binary_depth(binary) > MAX_BINARY_DEPTH {
        return None;
    }
    let wide = bvh2_to_cwbvh(binary, max_leaf, true, false);
    let nodes: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(bytemuck::cast_slice::<_, u8>(&wide.nodes));
    let bounds = (wide.total_aabb.min.into(), wide.total_aabb.max.into());
    (wide_depth(&nodes) <= max_depth).then_some(Tree { nodes, order: wide.primitive_indices, bounds })
}

fn binary_depth(tree: &Bvh2) -> u32 {
    let mut deepest = 0;
    let mut stack = vec![(0, 1)];
    while let Some((index, depth)) = stack.pop() {
        deepest = deepest.max(depth);
        let node: &Bvh2Node = &tree.nodes[index as usize];
        if !node.is_leaf() {
            stack.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
        }
    }
    deepest
}

/// Children come after their parent, so one pass suffices.
fn wide_depth(nodes: &[[u32; 4]]) -> u32 {
    let count = nodes.len() / NODE_STRIDE as usize;
    let mut depth = vec![1; count];
    for i in 0..count {
        let node = &nodes[i * NODE_STRIDE as usize..];
        let first = node[1][0] as usize;
        for child in first..first + (node[0][3] >> 24).count_ones() as usize {
            depth[child] = depth[i] + 1;
        }
    }
    depth.into_iter().max().unwrap_or(0)
}

/// Halves the list recursively, so that the depth is logarithmic for any boxes.
fn balanced(order: &[u32], leaves: &[Leaf]) -> Bvh2 {
    let mut tree = Bvh2 { nodes: vec![Bvh2Node::default()], primitive_indices: order.to_vec(), ..Default::default() };
    let mut stack = vec![(0, 0..order.len())];
    while let Some((index, range)) = stack.pop() {
        if range.len() == 1 {
            let first = range.start;
            tree.nodes[index] = Bvh2Node::new(leaves[order[first] as usize].0, 1, first as u32);
        } else {
            let middle = range.start + range.len() / 2;
            let children = tree.nodes.len();
            tree.nodes.extend([Bvh2Node::default(); 2]);
            tree.nodes[index] = Bvh2Node::new(Aabb::default(), 0, children as u32);
            stack.extend([(children, range.start..middle), (children + 1, middle..range.end)]);
        }
    }
    // Children come after their parent, so this reverse pass computes the boxes of the children first.
    for index in (0..tree.nodes.len()).rev() {
        let node = tree.nodes[index];
        if !node.is_leaf() {
            let first = node.first_index as usize;
            let both = tree.nodes[first].aabb().union(tree.nodes[first + 1].aabb());
            tree.nodes[index] = Bvh2Node::new(both, 0, first as u32);
        }
    }
    tree
}
