//! Keeps a [`GpuInstance`] in a stable slot for each mesh instance of the scene.
//!
//! Temporal reuse traces rays through the scene of the last frame.  So each record has the transform of the last frame, the top level of the
//! last frame is kept beside the new one, and everything else about a slot never changes: an instance that is edited gets another slot.  The
//! slot of an instance that has disappeared, or that was edited, keeps its record for one frame with the flag [`INSTANCE_GONE`], and a slot
//! that the last frame did not have carries [`INSTANCE_APPEARED`].
//!
//! A frame visits the instances that are due: changed ones, instances of a changed mesh or material, and those that the last frame left
//! unsettled, because they moved, appeared or wait for something.  Most visits are to instances that have only moved, and are short.

#[cfg(feature = "testing")]
mod check;
mod follow;
mod problems;

use bevy::{
    asset::AssetId,
    ecs::resource::Resource,
    log::{warn, warn_once},
    mesh::Mesh,
    render::sync_world::{MainEntity, MainEntityHashMap, MainEntityHashSet},
};

use crate::gpu_layout::*;
use crate::scene::{
    asset_wait::AssetWait,
    extract::{ExtractedScene, instances::ExtractedInstance},
    features::SceneFeatures,
    geometry::bodies::BodyPool,
    geometry::instance_record::{
        EMPTY_SLOT, InstanceSources, LiveInstance, freed, seen_by, shown_mesh, without_placement,
    },
    geometry::meshes::MeshPool,
    geometry::top_level::TopLevel,
    geometry::totals::Totals,
    storage::{
        dirty_runs::joined_runs, growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning, uploads::Uploads,
    },
};
use crate::warned::Warned;
use problems::InstanceProblem;

/// Share of the instances, as its reciprocal.  They are sorted if more than this share have come since the last sort.
const SORT_SHARE: usize = 8;

/// The instances of the scene.
#[derive(Resource)]
pub(crate) struct InstancePool {
    slots: MainEntityHashMap<u32>,
    free: Vec<u32>,
    /// Slots that the last frame used and this one does not, with their entities: those of instances that have disappeared or were edited.
    gone: Vec<(u32, MainEntity)>,
    /// By slot.
    records: Vec<GpuInstance>,
    /// By slot; `None` for free slots and those of instances that are gone.
    live: Vec<Option<LiveInstance>>,
    /// The live instances with their slots, in the order of their entities.
    order: Vec<(MainEntity, u32)>,
    /// The instances that are not in `order` yet.
    newcomers: Vec<(MainEntity, u32)>,
    pub totals: Totals,
    /// Slots whose records have changed since the GPU got them; some more than once.
    dirty: Vec<u32>,
    /// What the last comparison found.
    #[cfg(feature = "testing")]
    checked: check::Checked,
    /// Instances to visit in the next frame even if nothing changes.
    unsettled: Vec<MainEntity>,
    /// Slots of instances that have moved or appeared in this frame.
    settling: Vec<u32>,
    /// Number of this frame.
    frame: u64,
    /// The last frames in which the instances were visited, by slot.
    visited_in: Vec<u64>,
    /// Meshes that instances of this frame show while their own are built; the pool of meshes takes them.
    pub substitutes: Vec<AssetId<Mesh>>,
    /// Instances whose triangles are lights.
    emitters: MainEntityHashSet,
    /// Instances whose triangles are lights, or were, that may have changed since [`Self::take_changed_emitters`]; some more than once.
    changed_emitters: Vec<MainEntity>,
    /// Instances that were visited in this frame.
    pub visited: u64,
    /// An instance has moved in this frame.
    moved: bool,
    /// An instance has got a new slot in this frame, because it appeared or was edited.
    appeared: bool,
    /// Instances of this frame for which the device has no slot.
    left_out: u64,
    pub gpu: GrowableBuffer<GpuInstance>,
    /// The GPU has the records of this frame.
    pub fits: bool,
    pub top: TopLevel,
    /// Entities that a warning has named.
    warned: Warned<(MainEntity, InstanceProblem)>,
    asset_wait: AssetWait,
    overflow: OverflowWarning,
    /// Some instance waits for its mesh or material.
    pub waiting: bool,
    /// Counts the frames in which instances moved, appeared or disappeared.
    pub motion_revision: u64,
    /// Counts the frames in which instances appeared or disappeared, or were edited.
    pub membership_revision: u64,
    /// Counts edits of instances that had to keep their slot, because the device cannot bind another one.
    pub edit_revision: u64,
}

impl Default for InstancePool {
    fn default() -> Self {
        Self {
            slots: MainEntityHashMap::default(),
            free: Vec::new(),
            gone: Vec::new(),
            records: Vec::new(),
            live: Vec::new(),
            order: Vec::new(),
            newcomers: Vec::new(),
            totals: Totals::default(),
            dirty: Vec::new(),
            #[cfg(feature = "testing")]
            checked: check::Checked::default(),
            unsettled: Vec::new(),
            settling: Vec::new(),
            frame: 0,
            visited_in: Vec::new(),
            substitutes: Vec::new(),
            emitters: MainEntityHashSet::default(),
            changed_emitters: Vec::new(),
            visited: 0,
            moved: false,
            appeared: false,
            left_out: 0,
            gpu: GrowableBuffer::new("instances"),
            fits: true,
            top: TopLevel::default(),
            warned: Warned::default(),
            asset_wait: AssetWait::default(),
            overflow: OverflowWarning::default(),
            waiting: true,
            motion_revision: 0,
            membership_revision: 0,
            edit_revision: 0,
        }
    }
}

impl InstancePool {
    /// A pool with this top level.
    pub(crate) fn new(top: TopLevel) -> Self {
        Self { top, ..Default::default() }
    }

    /// Takes the instances that must be visited although nothing about them has changed.
    pub(crate) fn take_unsettled(&mut self) -> Vec<MainEntity> {
        core::mem::take(&mut self.unsettled)
    }

    /// Visits the instances that are `due`, in the order of their entities, and those that have only `moved`.  Call it after materials are
    /// packed and before light ids are set.
    pub(crate) fn update(
        &mut self,
        due: Vec<MainEntity>,
        moved: &[MainEntity],
        scene: &ExtractedScene,
        sources: &mut InstanceSources,
    ) {
        self.begin_frame();
        let last_settling = core::mem::take(&mut self.settling);
        let due = self.follow(due, moved, &scene.instances, sources);
        self.visited += due.len() as u64;
        for &entity in &due {
            let shown = scene.instances.get(entity).and_then(|extracted| self.show(extracted, sources));
            match shown {
                Some((slot, live)) => self.enter(slot, live),
                None => {
                    self.leave(entity);
                    sources.subsurface.release(entity);
                }
            }
        }
        self.settle(&last_settling);
        self.retire(sources.bodies);
        let membership_changed = self.appeared || !self.gone.is_empty();
        self.membership_revision += u64::from(membership_changed);
        self.motion_revision += u64::from(self.moved || membership_changed);
        if self.overflow.should_warn(self.left_out, sources.meshes.shown_are_built(&scene.instances) && !self.waiting) {
            let (left_out, limit) = (self.left_out, sources.limit);
            warn!("restir: {left_out} objects are left out, because this device binds at most {limit} instances");
        }
    }

    fn begin_frame(&mut self) {
        (self.waiting, self.moved, self.appeared, self.left_out, self.visited) = (false, false, false, 0, 0);
        self.frame += 1;
        self.asset_wait.begin_frame();
        self.warned.begin_frame();
        for (slot, _) in core::mem::take(&mut self.gone) {
            self.write(slot, freed(self.get(slot)));
            self.free.push(slot);
        }
    }

    /// Replaces the record of a slot, and marks it for the upload if that changes it.
    fn write(&mut self, slot: u32, record: GpuInstance) {
        if core::mem::replace(&mut self.records[slot as usize], record) != record {
            self.dirty.push(slot);
        }
    }

    /// Writes the record of an instance; `None` if it is not shown.
    fn show(&mut self, extracted: &ExtractedInstance, sources: &mut InstanceSources) -> Option<(u32, LiveInstance)> {
        let entity = extracted.entity;
        let last = self.slots.get(&entity).and_then(|slot| self.live_in(*slot));
        let mesh = shown_mesh(extracted, last, sources.meshes);
        if mesh != extracted.mesh {
            self.waiting = true;
            self.unsettled.push(entity);
            self.substitutes.push(mesh);
        }
        let (mut instance, bounds) = self.record_of(extracted, mesh, sources)?;
        let mut features = sources.materials.features(instance.material);
        features.set(SceneFeatures::VERTEX_COLORS, instance.flags & INSTANCE_VERTEX_COLORS != 0);
        // Probes do not find an instance that casts no shadows.
        let subsurface = extracted.subsurface.filter(|_| extracted.casts_shadows);
        instance.flags |= sources.subsurface.flags_of(entity, subsurface);
        features.set(SceneFeatures::SUBSURFACE, instance.flags & INSTANCE_SUBSURFACE != 0);
        let Some(slot) = self.slot_of(entity, &mut instance, sources.limit) else {
            self.left_out += 1;
            self.unsettled.push(entity);
            return None;
        };
        let mut moved = instance.world_from_object != instance.previous_world_from_object;
        if instance.flags & INSTANCE_DEFORMED != 0 {
            features |= SceneFeatures::DEFORMATION;
            moved |= sources.bodies.get(entity).is_some_and(|body| body.moved);
        }
        self.moved |= moved;
        if moved || instance.flags & INSTANCE_APPEARED != 0 {
            self.settling.push(slot);
        }
        self.visited_in[slot as usize] = self.frame;
        self.write(slot, instance);
        // A `NotShadowCaster` is not in the tree.  The camera still sees it, because the visibility pass rasterizes it.
        let ray_mask = if extracted.casts_shadows { extracted.camera_mask } else { 0 };
        let live = LiveInstance {
            entity,
            mesh,
            material: instance.material,
            camera_mask: seen_by(extracted),
            ray_mask,
            triangles: instance.triangle_count,
            features,
            // An instance that no ray can hit lights nothing.
            emits: ray_mask != 0 && sources.materials.emits(instance.material),
            bounds,
        };
        Some((slot, live))
    }

    /// Takes over an instance that is shown.
    fn enter(&mut self, slot: u32, live: LiveInstance) {
        let old = self.live[slot as usize].replace(live);
        self.top.note(slot, old.and_then(|old| old.traced_bounds()), live.traced_bounds());
        if live.emits || old.is_some_and(|old| old.emits) {
            self.changed_emitters.push(live.entity);
        }
        if old.is_some_and(|old| LiveInstance { bounds: live.bounds, ..old } == live) {
            return;
        }
        if live.emits != old.is_some_and(|old| old.emits) {
            match live.emits {
                true => _ = self.emitters.insert(live.entity),
                false => _ = self.emitters.remove(&live.entity),
            }
        }
        match old {
            Some(old) => self.totals.subtract(&old),
            None => self.newcomers.push((live.entity, slot)),
        }
        self.totals.add(&live);
    }

    /// Gives up an instance that is not shown.
    fn leave(&mut self, entity: MainEntity) {
        if let Some(slot) = self.slots.remove(&entity) {
            self.give_up(slot, entity);
        }
    }

    /// Gives up a slot of an entity.  It keeps its record until the next frame.
    fn give_up(&mut self, slot: u32, entity: MainEntity) {
        self.gone.push((slot, entity));
        let Some(old) = self.live[slot as usize].take() else { return };
        self.top.note(slot, old.traced_bounds(), None);
        if old.emits {
            self.changed_emitters.push(old.entity);
            self.emitters.remove(&old.entity);
        }
        self.totals.subtract(&old);
    }

    /// Marks the slots of instances that have disappeared, and those that edited instances had.
    fn retire(&mut self, bodies: &BodyPool) {
        let gone = core::mem::take(&mut self.gone);
        for &(slot, entity) in &gone {
            let record = *self.get(slot);
            // The body of an edited instance is posed in this frame, and its triangles of the last frame lie behind the new ones.  A body that
            // has disappeared is not posed, so that its first triangles are still those of the last frame.
            let is_posed = bodies.get(entity).is_some_and(|body| body.triangles().start == record.first_triangle);
            let outdated = if is_posed { INSTANCE_APPEARED } else { INSTANCE_APPEARED | INSTANCE_DEFORMED };
            let marked = GpuInstance {
                previous_world_from_object: record.world_from_object,
                first_light: NONE,
                flags: record.flags & !outdated | INSTANCE_GONE,
                ..record
            };
            self.write(slot, marked);
        }
        self.gone = gone;
    }

    /// The slot of an entity: that of the last frame if the instance has at most moved, else another one.  `None` if it has none and all
    /// `limit` slots are taken.  Completes its record from that of the last frame.
    fn slot_of(&mut self, entity: MainEntity, instance: &mut GpuInstance, limit: u32) -> Option<u32> {
        let last = self.slots.get(&entity).copied();
        let mut is_edited = false;
        if let Some(slot) = last {
            let old = &self.records[slot as usize];
            is_edited = without_placement(old) != without_placement(instance);
            instance.previous_world_from_object = old.world_from_object;
            instance.first_light = old.first_light;
        }
        if last.is_some() && !is_edited {
            return last;
        }
        let slot = match self.free.pop() {
            Some(slot) => slot,
            None if self.records.len() as u32 >= limit => {
                self.edit_revision += u64::from(last.is_some());
                return last;
            }
            None => {
                self.records.push(EMPTY_SLOT);
                self.live.push(None);
                self.visited_in.push(0);
                self.records.len() as u32 - 1
            }
        };
        self.slots.insert(entity, slot);
        let mut keeps_triangles = false;
        if let Some(last) = last {
            keeps_triangles = self.records[last as usize].first_triangle == instance.first_triangle;
            self.give_up(last, entity);
        }
        // An edited instance that keeps its triangles also keeps its last transform, because its points can be followed to the last frame.
        if !keeps_triangles {
            instance.previous_world_from_object = instance.world_from_object;
        }
        instance.first_light = NONE;
        instance.flags |= INSTANCE_APPEARED;
        self.appeared = true;
        Some(slot)
    }

    /// Sets the light id of the first triangle in a slot; those of the other triangles follow it.
    pub(crate) fn set_first_light(&mut self, slot: u32, light: u32) {
        self.write(slot, GpuInstance { first_light: light, ..*self.get(slot) });
    }

    /// The slots whose records have changed in this frame, and those that the GPU does not have yet for lack of memory; some more than once.
    pub(super) fn changed_slots(&self) -> &[u32] {
        &self.dirty
    }

    /// The record of a slot.
    pub(crate) fn get(&self, slot: u32) -> &GpuInstance {
        &self.records[slot as usize]
    }

    /// The live instance in a slot.
    pub(crate) fn live_in(&self, slot: u32) -> Option<&LiveInstance> {
        self.live.get(slot as usize)?.as_ref()
    }

    /// All live instances with their slots, in the order of the slots.
    pub(crate) fn live(&self) -> impl Iterator<Item = (u32, &LiveInstance)> {
        self.live.iter().enumerate().filter_map(|(slot, live)| Some((slot as u32, live.as_ref()?)))
    }

    /// Whether the list of [`Self::in_order`] is up to date.
    fn is_sorted(&self) -> bool {
        self.newcomers.is_empty() && self.order.len() as u64 == self.totals.instances
    }

    /// Brings the list of [`Self::in_order`] up to date.  It looks at all instances, so frames that do not need the list leave it as it is.
    pub(super) fn sort(&mut self) {
        if self.is_sorted() {
            return;
        }
        let live = &self.live;
        let is_live = |(entity, slot): &(MainEntity, u32)| {
            live[*slot as usize].as_ref().is_some_and(|live| live.entity == *entity)
        };
        self.order.retain(is_live);
        self.order.extend(self.newcomers.drain(..).filter(is_live));
        // This sort is fast where most of the list is in order.
        self.order.sort();
        // An instance may have given up its slot and taken it again.
        self.order.dedup();
    }

    /// The live instances with their slots, in the order of their entities.  Call [`Self::sort`] before.
    pub(super) fn in_order(&self) -> impl Iterator<Item = (u32, &LiveInstance)> {
        debug_assert!(self.is_sorted());
        self.order.iter().filter_map(|(_, slot)| Some((*slot, self.live_in(*slot)?)))
    }

    /// The instances whose triangles are lights, with their slots, in the order of their entities.
    pub(crate) fn emitters(&self) -> Vec<(u32, &LiveInstance)> {
        let mut emitters: Vec<_> = self.emitters.iter().filter_map(|entity| self.emitter(*entity)).collect();
        emitters.sort_unstable_by_key(|(_, live)| live.entity);
        emitters
    }

    /// The instance of an entity with its slot, if its triangles are lights.
    pub(crate) fn emitter(&self, entity: MainEntity) -> Option<(u32, &LiveInstance)> {
        let slot = *self.slots.get(&entity)?;
        Some((slot, self.live_in(slot)?)).filter(|(_, live)| live.emits)
    }

    /// Takes the instances whose triangles are lights, or were, that may have changed since the last call; some more than once.
    pub(crate) fn take_changed_emitters(&mut self) -> Vec<MainEntity> {
        core::mem::take(&mut self.changed_emitters)
    }

    /// Brings the top level up to date.
    pub(crate) fn update_top_level(&mut self, meshes: &mut MeshPool, bodies: &BodyPool, uploads: &mut Uploads) {
        let mut top = core::mem::take(&mut self.top);
        top.begin_frame();
        // The device's own trees need the list in each frame.  For others, newcomers wait until they are many.
        if top.structures.is_some() || SORT_SHARE * self.newcomers.len() > self.order.len() {
            self.sort();
        }
        let has_changed = match top.structures.is_some() {
            true => top.update_structures(self, meshes, bodies, uploads.device, uploads.queue),
            false => top.update(self, meshes, uploads),
        };
        self.motion_revision += u64::from(has_changed);
        self.top = top;
    }

    /// Uploads the records that changed.  Returns the number of bytes sent.
    pub(crate) fn upload(&mut self, uploads: &mut Uploads) -> u64 {
        self.fits = true;
        if self.dirty.is_empty() {
            return 0;
        }
        self.dirty.sort();
        self.dirty.dedup();
        if !self.gpu.reserve(self.records.len() as u32, uploads.device, uploads.queue) {
            warn_once!(
                "restir: the records of {} instances do not fit this device or its memory; Bevy lights all cameras until they fit",
                self.records.len()
            );
            // The slots stay dirty, and the next frame tries again.
            self.fits = false;
            return 0;
        }
        let runs = joined_runs(self.dirty.drain(..).map(|slot| slot as usize));
        self.gpu.write_runs(&runs, &self.records, uploads)
    }

    /// Number of slots, including free ones.
    pub(crate) fn len(&self) -> u32 {
        self.records.len() as u32
    }
}
