//! Visits to instances of which only the transform has changed.

use bevy::{asset::AssetId, mesh::Mesh, render::sync_world::MainEntity};

use super::InstancePool;
use crate::gpu_layout::{INSTANCE_APPEARED, INSTANCE_DEFORMED, INSTANCE_MIRRORED};
use crate::scene::{
    accel::blas::Bounds,
    extract::instances::{ExtractedInstance, InstanceList, sorted},
    geometry::instance_record::{InstanceSources, Placement},
    geometry::meshes::MeshPool,
};

impl InstancePool {
    /// Visits those of the instances that have `moved` that are not `due` for another reason.  Returns the instances that are due for a
    /// complete visit, in the order of their entities.
    pub(super) fn follow(
        &mut self,
        mut due: Vec<MainEntity>,
        moved: &[MainEntity],
        list: &InstanceList,
        sources: &InstanceSources,
    ) -> Vec<MainEntity> {
        let mut rest = Vec::new();
        let mut bounds = MeshBounds { meshes: sources.meshes, last: None };
        for entity in moved {
            let has_followed = due.binary_search(entity).is_err()
                && list.get(*entity).is_some_and(|extracted| self.follow_one(extracted, &mut bounds));
            if !has_followed {
                rest.push(*entity);
            }
        }
        if rest.is_empty() {
            return due;
        }
        due.append(&mut rest);
        sorted(due)
    }

    /// Takes over the transform of an instance.  Returns false and does nothing if more than its placement changes.
    fn follow_one(&mut self, extracted: &ExtractedInstance, meshes: &mut MeshBounds) -> bool {
        let Some(&slot) = self.slots.get(&extracted.entity) else { return false };
        let index = slot as usize;
        if self.visited_in[index] == self.frame {
            return true;
        }
        let (record, Some(live)) = (&mut self.records[index], &mut self.live[index]) else { return false };
        // Bodies have places of their own.
        if record.flags & INSTANCE_DEFORMED != 0 || live.mesh != extracted.mesh {
            return false;
        }
        let Some(bounds) = meshes.bounds(live.mesh) else { return false };
        let Some(placement) = Placement::new(&extracted.world_from_object, &bounds) else { return false };
        // Other flags need another slot.
        if (record.flags & INSTANCE_MIRRORED != 0) != placement.is_mirrored {
            return false;
        }
        let has_moved = record.world_from_object != placement.world_from_object;
        record.previous_world_from_object = record.world_from_object;
        record.world_from_object = placement.world_from_object;
        record.object_from_world = placement.object_from_world;
        record.flags &= !INSTANCE_APPEARED;
        let before = live.traced_bounds();
        live.bounds = placement.bounds;
        self.top.note(slot, before, live.traced_bounds());
        self.emitters_changed |= live.emits;
        self.moved |= has_moved;
        if has_moved {
            self.settling.push(slot);
        }
        self.note_visit(slot);
        true
    }

    /// Visits the instances in these slots, which moved or appeared in the last frame, if they have not been visited yet: they rest now.
    pub(super) fn settle(&mut self, slots: &[u32]) {
        for &slot in slots {
            let index = slot as usize;
            let Some(live) = &self.live[index] else { continue };
            if self.visited_in[index] == self.frame {
                continue;
            }
            let record = &mut self.records[index];
            record.previous_world_from_object = record.world_from_object;
            record.flags &= !INSTANCE_APPEARED;
            self.emitters_changed |= live.emits;
            self.note_visit(slot);
        }
    }

    fn note_visit(&mut self, slot: u32) {
        self.visited_in[slot as usize] = self.frame;
        self.visited += 1;
        self.dirty.push(slot);
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
