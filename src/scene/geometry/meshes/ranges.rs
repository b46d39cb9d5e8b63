//! Ranges of the shared buffers, for meshes, bodies that bend and top-level trees.

use super::MeshPool;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::ops::Range;

impl MeshPool {
    /// Allocates triangles, vertices and nodes for a mesh or a body; `None` if they do not fit the device.
    pub(crate) fn allocate(
        &mut self,
        [triangles, vertices, nodes]: [u32; 3],
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<[Range<u32>; 3]> {
        let triangles = self.triangle_ranges.allocate(triangles);
        let vertices = self.vertex_ranges.allocate(vertices);
        let nodes = self.node_ranges.allocate(nodes);
        // wgpu compares the number of vertices of an acceleration structure with the limit of primitives, and those that its triangles may
        // refer to begin with the first one of the buffer.
        let is_traced = !self.ray_queries || vertices.end <= device.limits().max_blas_primitive_count;
        let fits = is_traced
            && self.nodes.reserve(self.node_ranges.end(), device, queue)
            && self.triangles.reserve(self.triangle_ranges.end(), device, queue)
            && self.vertices.reserve(self.vertex_ranges.end(), device, queue);
        if fits {
            return Some([triangles, vertices, nodes]);
        }
        self.release_ranges([triangles, vertices, nodes]);
        None
    }

    /// Frees the ranges of a mesh or a body.
    pub(super) fn release_ranges(&mut self, [triangles, vertices, nodes]: [Range<u32>; 3]) {
        self.triangle_ranges.release(triangles);
        self.vertex_ranges.release(vertices);
        self.node_ranges.release(nodes);
    }

    /// Frees the ranges of a body.
    pub(crate) fn release_body(&mut self, ranges: [Range<u32>; 3]) {
        self.has_room = true;
        self.release_ranges(ranges);
    }

    /// Allocates nodes for a top-level tree in the buffer of the bottom levels; `None` if they do not fit the device.
    pub(crate) fn allocate_nodes(
        &mut self,
        count: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<Range<u32>> {
        let range = self.node_ranges.allocate(count);
        if self.nodes.reserve(self.node_ranges.end(), device, queue) {
            return Some(range);
        }
        self.node_ranges.release(range);
        None
    }

    /// Frees the nodes of a top-level tree.
    pub(crate) fn release_nodes(&mut self, range: Range<u32>) {
        self.node_ranges.release(range);
    }
}
