//! Top-level trees in the buffer that holds the nodes of all trees: those of instances and of analytic area lights.

use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{accel::blas::bake, accel::tlas::Tlas, geometry::meshes::MeshPool};

/// A top-level tree in the node buffer.
#[derive(Clone, Debug, Default)]
pub(crate) struct GpuTlas {
    /// Range of the nodes and of the packed instance indices behind them.
    pub range: Range<u32>,
    nodes: u32,
}

impl GpuTlas {
    /// Writes a tree to the node buffer and returns it with the number of bytes sent; `None` if the device has no room.
    pub(crate) fn write(
        tlas: &Tlas,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<(Self, u64)> {
        let nodes = (tlas.nodes.len() / NODE_STRIDE as usize) as u32;
        let mut words: Vec<[u32; 4]> = tlas.nodes.iter().chain(&tlas.indices).copied().collect();
        let count = (words.len() as u32).div_ceil(NODE_STRIDE);
        words.resize((count * NODE_STRIDE) as usize, [0; 4]);
        let range = meshes.allocate_nodes(count, device, queue)?;
        bake(&mut words[..(nodes * NODE_STRIDE) as usize], range.start, 0);
        let bytes = meshes.nodes.write(range.start, bytemuck::cast_slice(&words), queue);
        Some((Self { range, nodes }, bytes))
    }

    /// Index of the root node, or `NONE` for an empty tree.
    pub(crate) fn root(&self) -> u32 {
        if self.nodes == 0 { NONE } else { self.range.start }
    }

    /// Position of the instance indices in the node buffer, in elements of 16 bytes.
    pub(crate) fn indices(&self) -> u32 {
        (self.range.start + self.nodes) * NODE_STRIDE
    }
}
