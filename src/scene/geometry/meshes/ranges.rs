//! Ranges of the shared buffers for bodies that bend and for top-level trees.

use super::MeshPool;
use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::ops::Range;

impl MeshPool {
    /// Allocates triangles and nodes for a body of a mesh that bends; `None` if they do not fit the device.
    pub(crate) fn allocate_body(
        &mut self,
        triangles: u32,
        nodes: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<(Range<u32>, Range<u32>)> {
        let (triangles, nodes) = (self.triangle_ranges.allocate(triangles), self.node_ranges.allocate(nodes));
        let fits = self.nodes.reserve(self.node_ranges.end(), device, queue)
            && self.triangles.reserve(self.triangle_ranges.end(), device, queue)
            && self.attributes.reserve(self.triangle_ranges.end(), device, queue);
        if fits {
            return Some((triangles, nodes));
        }
        self.release_body(triangles, nodes);
        None
    }

    /// Frees the ranges of a body.
    pub(crate) fn release_body(&mut self, triangles: Range<u32>, nodes: Range<u32>) {
        self.has_room = true;
        self.triangle_ranges.release(triangles);
        self.node_ranges.release(nodes);
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
