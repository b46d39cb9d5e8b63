//! Visits to instances of which only the transform has changed.

use bevy::{
    asset::AssetId,
    mesh::Mesh,
    render::sync_world::MainEntity,
    tasks::{ComputeTaskPool, ParallelSlice},
};

use super::InstancePool;
use crate::gpu_layout::{GpuInstance, INSTANCE_APPEARED, INSTANCE_DEFORMED, INSTANCE_MIRRORED};
use crate::scene::{
    accel::blas::Bounds,
    extract::instances::{InstanceList, sorted},
    geometry::instance_record::{InstanceSources, Placement},
    geometry::meshes::MeshPool,
};

/// Number of moving instances whose placements one task computes.  Fewer need no task.
const PART: usize = 1024;

/// The mesh of an instance that has moved, and where the instance is now.
type Move = (AssetId<Mesh>, Placement);

impl InstancePool {
    /// Visits the `moved` instances that are not `due` for another reason.  Returns the instances that are due for a complete visit, in the
    /// order of their entities.
    pub(super) fn follow(
        &mut self,
        mut due: Vec<MainEntity>,
        moved: &[MainEntity],
        list: &InstanceList,
        sources: &InstanceSources,
    ) -> Vec<MainEntity> {
        let mut rest = Vec::new();
        let parts = moves(moved, &due, list, sources.meshes);
        for (entity, new) in moved.iter().zip(parts.into_iter().flatten()) {
            if !new.is_some_and(|new| self.follow_one(*entity, new)) {
                rest.push(*entity);
            }
        }
        if rest.is_empty() {
            return due;
        }
        due.append(&mut rest);
        sorted(due)
    }

    /// Takes over the placement of an instance.  Returns false and does nothing if more than that changes.
    fn follow_one(&mut self, entity: MainEntity, (mesh, placement): Move) -> bool {
        let Some(&slot) = self.slots.get(&entity) else { return false };
        let index = slot as usize;
        if self.visited_in[index] == self.frame {
            return true;
        }
        let (record, Some(live)) = (&mut self.records[index], &mut self.live[index]) else { return false };
        // Bodies have places of their own, and other flags need another slot.
        let is_mirrored = record.flags & INSTANCE_MIRRORED != 0;
        if record.flags & INSTANCE_DEFORMED != 0 || live.mesh != mesh || is_mirrored != placement.is_mirrored {
            return false;
        }
        let before = live.traced_bounds();
        live.bounds = placement.bounds;
        self.top.note(slot, before, live.traced_bounds());
        if live.emits {
            self.changed_emitters.push(entity);
        }
        if record.world_from_object == placement.world_from_object {
            self.rest(slot);
            return true;
        }
        record.previous_world_from_object = record.world_from_object;
        record.world_from_object = placement.world_from_object;
        record.object_from_world = placement.object_from_world;
        record.flags &= !INSTANCE_APPEARED;
        self.dirty.push(slot);
        self.moved = true;
        self.settling.push(slot);
        self.note_visit(slot);
        true
    }

    /// Visits the instances in these slots, which moved or appeared in the last frame, unless this frame has visited them: they have come to
    /// rest.  Their lights do not depend on what this changes.
    pub(super) fn settle(&mut self, slots: &[u32]) {
        for &slot in slots {
            let index = slot as usize;
            if self.live[index].is_none() || self.visited_in[index] == self.frame {
                continue;
            }
            self.rest(slot);
        }
    }

    /// Visits an instance that has not moved.
    fn rest(&mut self, slot: u32) {
        let record = *self.get(slot);
        let flags = record.flags & !INSTANCE_APPEARED;
        self.write(slot, GpuInstance { previous_world_from_object: record.world_from_object, flags, ..record });
        self.note_visit(slot);
    }

    fn note_visit(&mut self, slot: u32) {
        self.visited_in[slot as usize] = self.frame;
        self.visited += 1;
    }
}

/// The moves of these instances, in their order and in consecutive parts.  `None` for those that are due for a complete visit, and for those
/// that cannot be shown.
fn moves(moved: &[MainEntity], due: &[MainEntity], list: &InstanceList, meshes: &MeshPool) -> Vec<Vec<Option<Move>>> {
    let of_part = |_: usize, part: &[MainEntity]| -> Vec<Option<Move>> {
        let mut mesh_bounds = MeshBounds { meshes, last: None };
        let move_of = |entity: &MainEntity| {
            let is_due = due.binary_search(entity).is_ok();
            let extracted = list.get(*entity).filter(|_| !is_due)?;
            let bounds = mesh_bounds.bounds(extracted.mesh)?;
            Some((extracted.mesh, Placement::new(&extracted.world_from_object, &bounds)?))
        };
        part.iter().map(move_of).collect()
    };
    match moved.len() > PART {
        true => moved.par_chunk_map(ComputeTaskPool::get(), PART, of_part),
        false => vec![of_part(0, moved)],
    }
}

/// Looks up the bounds of meshes.  Many instances in a row show the same mesh.
struct MeshBounds<'a> {
    meshes: &'a MeshPool,
    last: Option<(AssetId<Mesh>, Bounds)>,
}

impl MeshBounds<'_> {
    /// The bounds of a mesh that has been built.
    fn bounds(&mut self, mesh: AssetId<Mesh>) -> Option<Bounds> {
        if self.last.is_none_or(|(last, _)| last != mesh) {
            self.last = Some((mesh, self.meshes.get(mesh)?.bounds));
        }
        self.last.map(|(_, bounds)| bounds)
    }
}
