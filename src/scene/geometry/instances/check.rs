//! Compares the pool with a visit of all instances, for tests.

use super::InstancePool;
use crate::gpu_layout::GpuInstance;
use crate::scene::{
    extract::instances::InstanceList,
    geometry::{
        instance_record::{EMPTY_SLOT, InstanceSources, new_record, shown_mesh, without_placement},
        totals::Totals,
    },
};

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

    /// Panics if a visit of all instances would change anything.
    pub(crate) fn check(&mut self, list: &InstanceList, sources: &mut InstanceSources) {
        let mut shown = 0;
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
            assert_eq!(self.get(slot).world_from_object, record.world_from_object);
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
        self.sort();
        let order: Vec<_> = self.in_order().map(|(_, live)| live.entity).collect();
        assert!(order.len() == shown && order.is_sorted());
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
}
