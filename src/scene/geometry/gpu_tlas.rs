//! Top-level trees in the buffer that holds the nodes of all trees: those of instances and of analytic area lights.

use bevy::render::renderer::{RenderDevice, RenderQueue};
use std::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    geometry::{joined_trees::JoinedTrees, meshes::MeshPool},
    storage::{dirty_runs::joined_runs, uploads::Uploads},
};

/// Least room for the tree over newcomers, once there is one, in units of a node: 20 KB.
const MIN_ROOM: u32 = 256;

/// A top level in the node buffer.
#[derive(Clone, Debug, Default)]
pub(crate) struct GpuTlas {
    pub range: Range<u32>,
    /// Index of the root node; `None` for an empty tree.
    root: Option<u32>,
    /// Place of the list of entries, in units of a node.
    list: u32,
}

impl GpuTlas {
    /// Writes trees to the node buffer and returns them with the number of bytes sent; `None` if the device has no room.  `room`: that of
    /// the tree over newcomers, in units of a node.
    pub(crate) fn write(
        trees: &JoinedTrees,
        room: u32,
        meshes: &mut MeshPool,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<(Self, u64)> {
        let count = trees.end().max(trees.newcomers_start() + room as usize);
        let count = if trees.end() == 0 { 0 } else { count as u32 };
        let range = meshes.allocate_nodes(count, device, queue)?;
        let units: Vec<_> = (0..trees.end()).map(|unit| trees.unit(unit, range.start)).collect();
        let bytes = meshes.nodes.write(range.start, &units, queue);
        let mut new = Self { range, root: None, list: 0 };
        new.point_to(trees);
        Some((new, bytes))
    }

    /// Writes some units of trees, in ascending order.  The trees must fit this range, and their main tree must have the topology of the one
    /// here.  Returns the number of bytes sent.
    fn write_units(&mut self, trees: &JoinedTrees, units: &[usize], meshes: &MeshPool, uploads: &mut Uploads) -> u64 {
        let mut runs = joined_runs(units.iter().copied());
        let units: Vec<_> = runs.iter().cloned().flatten().map(|unit| trees.unit(unit, self.range.start)).collect();
        let first = self.range.start as usize;
        runs.iter_mut().for_each(|run| *run = first + run.start..first + run.end);
        self.point_to(trees);
        meshes.nodes.write_packed(&runs, &units, uploads)
    }

    fn point_to(&mut self, trees: &JoinedTrees) {
        self.root = trees.root(self.range.start);
        self.list = self.range.start + trees.list_start() as u32;
    }

    fn has_room_for(&self, trees: &JoinedTrees) -> bool {
        trees.end() <= self.range.len()
    }

    /// Index of the root node; `NONE` for an empty tree.
    pub(crate) fn root(&self) -> u32 {
        self.root.unwrap_or(NONE)
    }

    /// Position of the list of entries in the node buffer, in elements of 16 bytes.
    pub(crate) fn indices(&self) -> u32 {
        self.list * NODE_STRIDE
    }
}

/// The top levels of this frame and of the last one.  As long as the main tree keeps its topology, two copies take turns, and each gets what
/// has changed since its own last turn.
#[derive(Debug, Default)]
pub(super) struct TlasPair {
    current: GpuTlas,
    /// The top level that `current` has replaced.
    replaced: Option<GpuTlas>,
    /// The units whose contents differ between `replaced` and `current`, in ascending order; `None` if the main trees of the two have
    /// different topologies.
    differences: Option<Vec<usize>>,
    /// `replaced` is the top level of the last frame.  Otherwise both frames have `current`.
    is_replaced_now: bool,
    /// Room of the next copy for the tree over newcomers, in units.
    room: u32,
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

    /// Writes trees whose main tree is a new one.  Returns the number of bytes sent; `None` if the device has no room.
    pub(super) fn replace(&mut self, trees: &JoinedTrees, meshes: &mut MeshPool, uploads: &Uploads) -> Option<u64> {
        self.differences = None;
        self.release_replaced(meshes);
        let needed = (trees.end() - trees.newcomers_start().min(trees.end())) as u32;
        let wanted = (2 * needed).max(MIN_ROOM);
        if needed > self.room || self.room > wanted {
            self.room = wanted;
        }
        let (fresh, bytes) = GpuTlas::write(trees, self.room, meshes, uploads.device, uploads.queue)?;
        self.turn_to(fresh);
        Some(bytes)
    }

    /// Writes trees that differ from those of `current` in some units, which are in ascending order.  Returns the number of bytes sent; `None`
    /// if the device has no room.
    pub(super) fn update(
        &mut self,
        trees: &JoinedTrees,
        changed: Vec<usize>,
        meshes: &mut MeshPool,
        uploads: &mut Uploads,
    ) -> Option<u64> {
        let Some(mut old) = self.replaced.take_if(|old| self.differences.is_some() && old.has_room_for(trees)) else {
            let bytes = self.replace(trees, meshes, uploads)?;
            self.differences = Some(changed);
            return Some(bytes);
        };
        let mut missing = self.differences.take().unwrap_or_default();
        missing.extend(&changed);
        // Two sorted lists, which this sort merges.
        missing.sort();
        missing.dedup();
        // The tree over newcomers may have been larger.
        missing.truncate(missing.partition_point(|unit| *unit < trees.end()));
        let bytes = old.write_units(trees, &missing, meshes, uploads);
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
