//! Top-level trees in the buffer that holds the nodes of all trees: those of instances and of analytic area lights.

use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::bake,
    accel::tlas::Tlas,
    geometry::meshes::MeshPool,
    storage::{dirty_runs::joined_runs, uploads::Uploads},
};

const STRIDE: usize = NODE_STRIDE as usize;

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
        let nodes = (tlas.nodes.len() / STRIDE) as u32;
        let mut words: Vec<[u32; 4]> = tlas.nodes.iter().chain(&tlas.indices).copied().collect();
        let count = (words.len() as u32).div_ceil(NODE_STRIDE);
        words.resize(count as usize * STRIDE, [0; 4]);
        let range = meshes.allocate_nodes(count, device, queue)?;
        bake(&mut words[..tlas.nodes.len()], range.start, 0);
        let bytes = meshes.nodes.write(range.start, bytemuck::cast_slice(&words), queue);
        Some((Self { range, nodes }, bytes))
    }

    /// Writes some nodes, in ascending order, of a tree with the topology of this one.  Returns the number of bytes sent.
    fn write_nodes(&self, tlas: &Tlas, nodes: &[usize], meshes: &MeshPool, uploads: &mut Uploads) -> u64 {
        let mut runs = joined_runs(nodes.iter().copied());
        let mut words: Vec<[u32; 4]> = Vec::new();
        for run in &runs {
            words.extend_from_slice(&tlas.nodes[run.start * STRIDE..run.end * STRIDE]);
        }
        bake(&mut words, self.range.start, 0);
        let first = self.range.start as usize;
        runs.iter_mut().for_each(|run| *run = first + run.start..first + run.end);
        meshes.nodes.write_packed(&runs, bytemuck::cast_slice(&words), uploads)
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

/// The top levels of this frame and of the last one.  Two copies of a tree that is refitted take turns, and each gets the nodes that have
/// changed since its own last turn.
#[derive(Debug, Default)]
pub(super) struct TlasPair {
    current: GpuTlas,
    /// The tree that `current` has replaced.
    replaced: Option<GpuTlas>,
    /// The nodes whose contents differ between `replaced` and `current`; `None` if the two have different topologies.
    differences: Option<Vec<usize>>,
    /// `replaced` is the top level of the last frame.  Otherwise both frames have `current`.
    is_replaced_now: bool,
}

impl TlasPair {
    /// Begins a frame in which nothing has changed yet.
    pub(super) fn begin_frame(&mut self, meshes: &mut MeshPool) {
        self.is_replaced_now = false;
        if self.differences.is_none() {
            self.release_replaced(meshes);
        }
    }

    fn release_replaced(&mut self, meshes: &mut MeshPool) {
        if let Some(old) = self.replaced.take() {
            meshes.release_nodes(old.range);
        }
    }

    /// Writes a new tree.  Returns the number of bytes sent; `None` if the device has no room.
    pub(super) fn replace(
        &mut self,
        tlas: &Tlas,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<u64> {
        self.differences = None;
        self.release_replaced(meshes);
        let (fresh, bytes) = GpuTlas::write(tlas, meshes, device, queue)?;
        self.turn_to(fresh);
        Some(bytes)
    }

    /// Writes the tree of `current`, some nodes of which have changed, in ascending order.  Returns the number of bytes sent; `None` if the
    /// device has no room.
    pub(super) fn refit(
        &mut self,
        tlas: &Tlas,
        changed: Vec<usize>,
        meshes: &mut MeshPool,
        uploads: &mut Uploads,
    ) -> Option<u64> {
        let Some(old) = self.replaced.take_if(|_| self.differences.is_some()) else {
            let bytes = self.replace(tlas, meshes, uploads.device, uploads.queue)?;
            self.differences = Some(changed);
            return Some(bytes);
        };
        let mut missing = self.differences.take().unwrap_or_default();
        missing.extend(&changed);
        // Two sorted lists, which this sort merges.
        missing.sort();
        missing.dedup();
        let bytes = old.write_nodes(tlas, &missing, meshes, uploads);
        self.turn_to(old);
        self.differences = Some(changed);
        Some(bytes)
    }

    fn turn_to(&mut self, fresh: GpuTlas) {
        self.replaced = Some(core::mem::replace(&mut self.current, fresh));
        self.is_replaced_now = true;
    }

    /// The top levels of this frame and of the last one.
    pub(super) fn both(&self) -> [&GpuTlas; 2] {
        let previous = self.replaced.as_ref().filter(|_| self.is_replaced_now);
        [&self.current, previous.unwrap_or(&self.current)]
    }
}
