//! Compares the pool with a visit of all instances, for tests.

use bevy::platform::collections::HashSet;

use super::InstancePool;
use crate::gpu_layout::{GpuInstance, INSTANCE_APPEARED};
use crate::scene::{
    extract::instances::InstanceList,
    geometry::{
        instance_record::{EMPTY_SLOT, InstanceSources, new_record, shown_mesh, without_placement},
        totals::Totals,
    },
};

/// The records of the last check.
#[derive(Default)]
pub(super) struct Checked {
    frame: u64,
    records: Vec<GpuInstance>,
}

impl InstancePool {
    /// Lengths of the pool's tables.
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("instances", self.slots.len()),
            ("slots of instances", self.records.len()),
            ("instances at rest", self.top.resting.len()),
            ("warnings of instances", self.warned.len()),
        ]
    }

    /// Panics unless rays reach each instance that they can hit in one way only, and nothing else.
    pub(crate) fn check_top_level(&self) {
        self.top.check(self);
    }

    /// Panics if a visit of all instances would change anything.
    pub(crate) fn check(&mut self, list: &InstanceList, sources: &mut InstanceSources) {
        let mut shown = 0;
        let settling: HashSet<u32> = self.settling.iter().copied().collect();
        for extracted in list.visible() {
            let slot = self.slots.get(&extracted.entity).copied();
            let mesh = shown_mesh(extracted, slot.and_then(|slot| self.live_in(slot)), sources.meshes);
            let Ok((record, bounds)) = new_record(extracted, mesh, sources) else {
                assert_eq!(slot, None, "entity {} cannot be shown", *extracted.entity);
                continue;
            };
            let Some(slot) = slot else {
                assert!(self.left_out > 0, "entity {} is missing", *extracted.entity);
                continue;
            };
            shown += 1;
            let subsurface = extracted.subsurface.filter(|_| extracted.casts_shadows);
            let flags = record.flags | sources.subsurface.flags_of(extracted.entity, subsurface);
            let known = GpuInstance { flags, ..record };
            assert_eq!(without_placement(self.get(slot)), without_placement(&known), "entity {}", *extracted.entity);
            self.check_motion(slot, &record, settling.contains(&slot));
            let live = self.live_in(slot).expect("the slot is in use");
            assert_eq!((live.entity, live.bounds), (extracted.entity, bounds));
            let emits = live.ray_mask != 0 && sources.materials.emits(live.material);
            assert_eq!((live.emits, self.emitters.contains(&live.entity)), (emits, emits));
        }
        assert_eq!(self.slots.len(), shown, "instances that the scene does not have");
        self.check_slots();
        let mut totals = Totals::default();
        self.live().for_each(|(_, live)| totals.add(live));
        assert_eq!(self.totals, totals);
        if self.is_sorted() {
            let order: Vec<_> = self.in_order().map(|(_, live)| live.entity).collect();
            assert!(order.len() == shown && order.is_sorted());
        }
        self.check_marks();
        self.checked = Checked { frame: self.frame, records: self.records.clone() };
    }

    /// The record that a slot had in the last frame; `None` if that frame had no such slot or was not checked.
    fn last_record(&self, slot: u32) -> Option<&GpuInstance> {
        self.checked.records.get(slot as usize).filter(|_| self.checked.frame + 1 == self.frame)
    }

    /// Panics if a record has changed since the last frame and would not be uploaded.
    fn check_marks(&self) {
        if self.checked.frame + 1 != self.frame {
            return;
        }
        let dirty: HashSet<u32> = self.dirty.iter().copied().collect();
        for slot in 0..self.len() {
            let record = self.get(slot);
            // Lights were set after the last check.
            let with_light = |last: &GpuInstance| GpuInstance { first_light: record.first_light, ..*last };
            let is_same = self.last_record(slot).is_some_and(|last| with_light(last) == *record);
            assert!(is_same || dirty.contains(&slot), "slot {slot} has changed and would not be uploaded");
        }
    }

    /// Panics unless each slot is used, given up or free, and those that are free have no record.
    fn check_slots(&self) {
        let gone = self.gone.iter().map(|(slot, _)| slot);
        let mut slots: Vec<u32> = self.slots.values().chain(gone).chain(&self.free).copied().collect();
        slots.sort_unstable();
        assert!(slots.into_iter().eq(0..self.len()), "a slot is lost, or has two owners");
        let stale = self.free.iter().find(|slot| *self.get(**slot) != EMPTY_SLOT);
        assert_eq!(stale, None, "a free slot has a record");
    }

    /// Panics if the transforms of a slot are not those of this frame and of the last one.  `is_settling`: the next frame visits it.
    fn check_motion(&self, slot: u32, expected: &GpuInstance, is_settling: bool) {
        let record = self.get(slot);
        assert_eq!(record.world_from_object, expected.world_from_object);
        assert_eq!(record.object_from_world, expected.object_from_world);
        let has_appeared = record.flags & INSTANCE_APPEARED != 0;
        let has_moved = record.previous_world_from_object != record.world_from_object;
        assert!(is_settling || !has_appeared && !has_moved, "slot {slot} would not settle");
        if let Some(last) = self.last_record(slot).filter(|_| !has_appeared) {
            assert_eq!(record.previous_world_from_object, last.world_from_object, "slot {slot}");
        }
    }
}
