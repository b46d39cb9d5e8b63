//! A tree over the analytic lights that rays can hit: spheres and rectangles.  It shares the node buffer of the instances' tree.

use bevy::{
    log::warn_once,
    render::renderer::{RenderDevice, RenderQueue},
};

use super::analytic::shape_bounds;
use crate::gpu_layout::GpuLight;
use crate::scene::{
    accel::{blas::Bounds, tlas::build_tlas},
    geometry::{gpu_tlas::GpuTlas, joined_trees::JoinedTrees, meshes::MeshPool},
};

/// The tree, and the boxes that it was built from.
#[derive(Debug, Default)]
pub(super) struct ShapeTree {
    boxes: Vec<(u32, Bounds)>,
    nodes: GpuTlas,
    /// The device had no memory for the tree, so that the next frame tries again.
    pub(super) is_missing: bool,
}

impl ShapeTree {
    /// Rebuilds the tree if a box has changed.  `lights`: the analytic lights in the order of their bins.  Returns the uploaded bytes.
    pub(super) fn update(
        &mut self,
        lights: &[GpuLight],
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> u64 {
        let lights = lights.iter().enumerate();
        let boxes: Vec<_> = lights.filter_map(|(bin, light)| Some((bin as u32, shape_bounds(light)?))).collect();
        if boxes == self.boxes && !self.is_missing {
            return 0;
        }
        // No shader traces rays against the lights of the last frame, so its nodes can go at once.
        meshes.release_nodes(core::mem::take(&mut self.nodes.range));
        let tlas = build_tlas(&boxes);
        self.boxes = boxes;
        let written = GpuTlas::write(&JoinedTrees::single(&tlas), 0, meshes, device, queue);
        self.is_missing = written.is_none();
        let (nodes, bytes) = written.unwrap_or_else(|| {
            warn_once!(
                "restir: the tree over {} lights does not fit this device; rays do not hit these lights",
                self.boxes.len()
            );
            (GpuTlas::default(), 0)
        });
        self.nodes = nodes;
        bytes
    }

    /// Root node and start of the list of bins, as `TopLevel::top_levels` gives them for instances.
    pub(super) fn root_and_indices(&self) -> [u32; 2] {
        [self.nodes.root(), self.nodes.indices()]
    }
}
