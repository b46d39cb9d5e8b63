//! Keeps every `StandardMaterial` that an instance uses in a slot of the material buffer.
//!
//! Temporal reuse also evaluates the materials of the last frame.  So a slot never changes: a material that is edited, or whose textures
//! change, gets another slot, and the old one stays for one more frame.

use bevy::{
    asset::AssetId,
    ecs::resource::Resource,
    image::Image,
    log::{warn, warn_once},
    pbr::StandardMaterial,
    platform::collections::{HashMap, HashSet},
    render::{
        render_resource::TextureFormat,
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntityHashSet,
    },
};
use core::ops::Range;

use crate::gpu_layout::*;
use crate::scene::{
    extract::{ExtractedScene, instances::InstanceList},
    features::SceneFeatures,
    material::{
        pack::{features_of, mean_emission, pack},
        texture_slots::{add_record, textures_of},
    },
    storage::{
        data_texture::{DataTexture, Reserved},
        dirty_runs::joined_runs,
        growable_buffer::GrowableBuffer,
        overflow_warning::OverflowWarning,
        range_allocator::RangeAllocator,
        uploads::Uploads,
    },
    texture::textures::TexturePool,
};
use crate::warned::Warned;

/// A material in use.
struct Slot {
    id: AssetId<StandardMaterial>,
    features: SceneFeatures,
    /// Mean radiance of its emission, cd/m², over its texture; 0 where it does not emit.
    mean_emission: [f32; 3],
    /// Record of its textures in the texture table.
    record: Range<u32>,
    /// The slot has its contents.
    is_packed: bool,
}

/// The materials of the scene, on the CPU and on the GPU.
#[derive(Resource)]
pub(crate) struct MaterialPool {
    sources: HashMap<AssetId<StandardMaterial>, StandardMaterial>,
    by_id: HashMap<AssetId<StandardMaterial>, u32>,
    /// `None`: the slot is free.
    slots: Vec<Option<Slot>>,
    free: Vec<u32>,
    /// Slots that only the last frame used.
    retired: Vec<u32>,
    packed: Vec<GpuMaterial>,
    /// Slots that have not been uploaded since they changed.
    dirty: Vec<usize>,
    pub gpu: GrowableBuffer<GpuMaterial>,
    /// The GPU has the materials and the texture table of this frame.
    pub fits: bool,
    /// Texture records of all materials that have textures.
    packed_table: Vec<[u32; 4]>,
    records: RangeAllocator,
    dirty_table: Vec<usize>,
    pub table: DataTexture<[u32; 4]>,
    /// Numbers of slots and of entries of the texture table that the device can bind.
    limits: [u32; 2],
    overflow: OverflowWarning,
    /// Materials that have come since slots were last assigned.
    arrived: Vec<AssetId<StandardMaterial>>,
    /// A material in use has no slot.
    is_short: bool,
    /// Materials whose slots or contents have changed since [`Self::take_changed`]; some more than once.
    changed: Vec<AssetId<StandardMaterial>>,
    /// Materials that were looked at in this frame.
    pub visited: u64,
    /// Materials that a warning has named.
    warned: Warned<AssetId<StandardMaterial>>,
    emissive_luminance: f32,
    /// Slots that must be packed again.
    stale: Vec<u32>,
    all_stale: bool,
    /// Counts slots of the last frame that had to be overwritten, because the device cannot bind another one.
    pub edit_revision: u64,
}

impl Default for MaterialPool {
    fn default() -> Self {
        Self {
            sources: HashMap::default(),
            by_id: HashMap::default(),
            slots: Vec::new(),
            free: Vec::new(),
            retired: Vec::new(),
            packed: Vec::new(),
            dirty: Vec::new(),
            gpu: GrowableBuffer::new("materials"),
            fits: true,
            packed_table: Vec::new(),
            records: RangeAllocator::default(),
            dirty_table: Vec::new(),
            table: DataTexture::new("texture table", TextureFormat::Rgba32Uint, 1),
            limits: [u32::MAX; 2],
            overflow: OverflowWarning::default(),
            arrived: Vec::new(),
            is_short: false,
            changed: Vec::new(),
            visited: 0,
            warned: Warned::default(),
            emissive_luminance: 0.0,
            stale: Vec::new(),
            all_stale: false,
            edit_revision: 0,
        }
    }
}

impl MaterialPool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("sources of materials", self.sources.len()),
            ("materials", self.by_id.len()),
            ("slots of materials", self.slots.len()),
            ("records of textures", self.records.end() as usize),
            ("warnings of materials", self.warned.len()),
        ]
    }

    /// Reads the limits of the device.
    pub(crate) fn limit_to(&mut self, device: &RenderDevice) {
        self.limits = [GrowableBuffer::<GpuMaterial>::limit(device), DataTexture::<[u32; 4]>::limit(device)];
    }

    /// Takes the materials that have changed in the main world.
    pub(crate) fn update_sources(&mut self, scene: &mut ExtractedScene) {
        self.warned.begin_frame();
        self.visited = 0;
        self.release_retired();
        for id in scene.removed_materials.drain() {
            self.warned.forget(&id);
            self.sources.remove(&id);
            self.release(id);
        }
        for (id, material) in scene.materials.drain() {
            self.stale.extend(self.by_id.get(&id));
            self.arrived.push(id);
            self.sources.insert(id, material);
        }
        if self.emissive_luminance != scene.emissive_luminance {
            self.emissive_luminance = scene.emissive_luminance;
            self.all_stale = true;
        }
    }

    /// Gives up the slot of a material; the next frame frees it.
    fn release(&mut self, id: AssetId<StandardMaterial>) {
        self.retired.extend(self.by_id.remove(&id));
        self.changed.push(id);
    }

    /// Whether a slot was assigned or given up, or must be packed.
    pub(crate) fn has_changed(&self) -> bool {
        self.all_stale || !self.stale.is_empty() || !self.changed.is_empty()
    }

    /// Takes the materials whose slots or contents have changed since the last call; some more than once.
    pub(crate) fn take_changed(&mut self) -> Vec<AssetId<StandardMaterial>> {
        core::mem::take(&mut self.changed)
    }

    /// Frees the slots that the last frame was the last to use.
    fn release_retired(&mut self) {
        for slot in self.retired.drain(..) {
            if let Some(slot) = self.slots[slot as usize].take() {
                self.records.release(slot.record);
            }
            self.free.push(slot);
        }
    }

    /// Frees slots that temporal reuse may still read, so that all histories restart.
    fn release_retired_early(&mut self) {
        self.edit_revision += 1;
        self.release_retired();
    }

    /// Assigns slots to materials that have arrived, and to those of instances whose material was replaced.  If there are too few slots,
    /// frees those of unused materials.  `settled`: the scene is loaded, so that the number of missing materials is final and a warning can
    /// name it.
    pub(crate) fn make_room(&mut self, instances: &mut InstanceList, settled: bool) {
        let mut arrived = core::mem::take(&mut self.arrived);
        arrived.sort_unstable();
        arrived.retain(|id| instances.users_of_material(*id).next().is_some());
        let repainted = instances.take_repainted();
        let used = repainted.into_iter().filter_map(|entity| Some(instances.get(entity)?.material));
        for id in used.chain(arrived) {
            self.visited += 1;
            self.is_short |= self.slot_or_assign(id).is_none() && self.is_left_out(id);
        }
        let mut left_out = 0;
        if self.is_short {
            left_out = self.assign_slots(instances);
            if left_out > 0 {
                let used: HashSet<_> = instances.materials().map(|(id, _)| id).collect();
                let unused: Vec<_> = self.by_id.keys().filter(|id| !used.contains(*id)).copied().collect();
                unused.into_iter().for_each(|id| self.release(id));
                left_out = self.assign_slots(instances);
            }
            self.is_short = left_out > 0;
        }
        if self.overflow.should_warn(left_out, settled) {
            warn!(
                "restir: {left_out} objects are left out, because this device can bind {} materials at most",
                self.limits[0]
            );
        }
    }

    /// Assigns slots to all materials in use, in the order of their first instances.  Returns the number of instances whose material gets
    /// none.
    fn assign_slots(&mut self, instances: &InstanceList) -> u64 {
        let first = |users: &MainEntityHashSet| users.iter().copied().min();
        let mut all: Vec<_> = instances.materials().map(|(id, users)| (first(users), id, users.len())).collect();
        all.sort_unstable();
        let mut left_out = 0;
        for (_, id, users) in all {
            self.visited += 1;
            if self.slot_or_assign(id).is_none() && self.is_left_out(id) {
                left_out += users as u64;
            }
        }
        left_out
    }

    /// Whether a loaded material has no slot because the device cannot bind more.
    pub(crate) fn is_left_out(&self, id: AssetId<StandardMaterial>) -> bool {
        self.sources.contains_key(&id) && !self.by_id.contains_key(&id)
    }

    /// The slot of a material, assigned on first use; `None` if the asset is not loaded or the device cannot bind more materials.
    pub(crate) fn slot_or_assign(&mut self, id: AssetId<StandardMaterial>) -> Option<u32> {
        if let Some(&slot) = self.by_id.get(&id) {
            return Some(slot);
        }
        if !self.sources.contains_key(&id) {
            return None;
        }
        if self.free.is_empty() && self.is_full() && !self.retired.is_empty() {
            self.release_retired_early();
        }
        let slot = self.take_slot(id)?;
        self.stale.push(slot);
        Some(slot)
    }

    fn is_full(&self) -> bool {
        self.slots.len() as u32 >= self.limits[0]
    }

    /// Gives a material a slot that no frame uses; `None` if the device cannot bind more.
    fn take_slot(&mut self, id: AssetId<StandardMaterial>) -> Option<u32> {
        let slot = match self.free.pop() {
            Some(slot) => slot,
            None if self.is_full() => return None,
            None => {
                self.slots.push(None);
                self.slots.len() as u32 - 1
            }
        };
        let (features, mean_emission) = (SceneFeatures::empty(), [0.0; 3]);
        self.slots[slot as usize] = Some(Slot { id, features, mean_emission, record: 0..0, is_packed: false });
        self.by_id.insert(id, slot);
        self.changed.push(id);
        Some(slot)
    }

    /// Images that the materials in use need, and whether an instance shows them.  An image may come more than once.
    pub(crate) fn images(&self, instances: &InstanceList) -> impl Iterator<Item = (AssetId<Image>, bool)> {
        let materials = self.slots.iter().flatten().filter_map(|slot| Some((slot.id, self.sources.get(&slot.id)?)));
        materials.flat_map(|(id, material)| {
            let is_shown = instances.users_of_material(id).next().is_some();
            textures_of(material).map(move |texture| (texture.image.id(), is_shown))
        })
    }

    /// Packs the materials that have changed, or all of them if a texture has changed.
    pub(crate) fn pack(&mut self, textures: &TexturePool, textures_changed: bool) {
        let mut stale = core::mem::take(&mut self.stale);
        if core::mem::take(&mut self.all_stale) || textures_changed {
            stale.clear();
            stale.extend(0..self.slots.len() as u32);
        }
        for slot in stale {
            let Some(id) = self.in_use(slot).map(|slot| slot.id) else { continue };
            if self.by_id.get(&id) == Some(&slot) {
                self.pack_material(id, slot, textures);
            }
        }
    }

    fn pack_material(&mut self, id: AssetId<StandardMaterial>, mut index: u32, textures: &TexturePool) {
        let Some(source) = self.sources.get(&id) else { return };
        self.visited += 1;
        let (mut material, has_replaced) = pack(source, self.emissive_luminance);
        if has_replaced && self.warned.is_due(id) {
            warn!("restir: material {id} has values that are NaN or infinite; they are replaced");
        }
        let mut record = Vec::new();
        let features;
        (material.textures, features) = add_record(source, textures, &mut record);
        let mean_emission = mean_emission(source, &material, textures);
        let is_edited = self.differs(index, &material, &record);
        if is_edited {
            match self.take_slot(id) {
                Some(fresh) => self.retired.push(core::mem::replace(&mut index, fresh)),
                None => {
                    self.edit_revision += 1;
                    self.changed.push(id);
                }
            }
        }
        if is_edited || self.in_use(index).is_some_and(|slot| !slot.is_packed) {
            self.write_slot(index, material, features, record);
        }
        if let Some(slot) = &mut self.slots[index as usize]
            && slot.mean_emission != mean_emission
        {
            slot.mean_emission = mean_emission;
            self.changed.push(id);
        }
    }

    /// Whether a packed slot differs from a material and its texture record.
    fn differs(&self, index: u32, material: &GpuMaterial, record: &[[u32; 4]]) -> bool {
        let Some(slot) = self.in_use(index).filter(|slot| slot.is_packed) else { return false };
        let last = &self.packed[index as usize];
        let last_record = &self.packed_table[slot.record.start as usize..slot.record.end as usize];
        GpuMaterial { texture_record: last.texture_record, ..*material } != *last || record != last_record
    }

    fn write_slot(
        &mut self,
        index: u32,
        mut material: GpuMaterial,
        mut texture_features: SceneFeatures,
        mut record: Vec<[u32; 4]>,
    ) {
        let Some(old) = self.slots[index as usize].as_mut().map(|slot| core::mem::take(&mut slot.record)) else {
            return;
        };
        self.records.release(old);
        let mut place = self.records.allocate(record.len() as u32);
        if place.end > self.limits[1] {
            warn_once!(
                "restir: the texture slots of all materials exceed a table of {} entries, which is all that this device can bind; \
                 some materials are rendered without textures",
                self.limits[1]
            );
            self.records.release(core::mem::take(&mut place));
            (material.textures, texture_features) = (0, SceneFeatures::empty());
            record.clear();
        }
        material.texture_record = place.start;
        for (entry, at) in record.into_iter().zip(place.start as usize..) {
            set(&mut self.packed_table, at, entry, &mut self.dirty_table);
        }
        set(&mut self.packed, index as usize, material, &mut self.dirty);
        if let Some(slot) = &mut self.slots[index as usize] {
            *slot =
                Slot { features: features_of(&material) | texture_features, record: place, is_packed: true, ..*slot };
        }
    }

    /// Uploads changes.  Returns the number of bytes.
    pub(crate) fn upload(&mut self, uploads: &mut Uploads) -> u64 {
        self.fits = true;
        let (device, queue) = (uploads.device, uploads.queue);
        let bytes = self.upload_table(device, queue);
        if self.dirty.is_empty() {
            return bytes;
        }
        self.dirty.sort_unstable();
        self.dirty.dedup();
        // The slots fit a binding, but the device's memory may be full; then the slots stay dirty, and the next frame tries again.
        if !self.gpu.reserve(self.packed.len() as u32, device, queue) {
            self.fits = false;
            return bytes;
        }
        let runs = joined_runs(self.dirty.drain(..));
        bytes + self.gpu.write_runs(&runs, &self.packed, uploads)
    }

    fn upload_table(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.dirty_table.is_empty() {
            return 0;
        }
        self.dirty_table.sort_unstable();
        self.dirty_table.dedup();
        match self.table.reserve(self.packed_table.len() as u32, device) {
            Reserved::Kept => {}
            Reserved::Replaced => self.dirty_table = (0..self.packed_table.len()).collect(),
            Reserved::Failed => {
                self.fits = false;
                return 0;
            }
        }
        let runs = joined_runs(self.dirty_table.drain(..));
        runs.into_iter().map(|r| self.table.write(r.start as u32, &self.packed_table[r], queue)).sum()
    }

    /// The packed material of a slot.
    pub(crate) fn get(&self, slot: u32) -> Option<&GpuMaterial> {
        self.packed.get(slot as usize)
    }

    /// The slot of a material, if it has one.
    pub(crate) fn slot(&self, id: AssetId<StandardMaterial>) -> Option<u32> {
        self.by_id.get(&id).copied()
    }

    /// Features that shaders need for a slot.
    pub(crate) fn features(&self, slot: u32) -> SceneFeatures {
        self.in_use(slot).map_or(SceneFeatures::empty(), |s| s.features)
    }

    /// Mean radiance of a slot's emission, cd/m².
    pub(crate) fn mean_emission(&self, slot: u32) -> [f32; 3] {
        self.in_use(slot).map_or([0.0; 3], |s| s.mean_emission)
    }

    /// Whether the triangles of an instance with this slot are lights.
    pub(crate) fn emits(&self, slot: u32) -> bool {
        self.mean_emission(slot) != [0.0; 3]
    }

    fn in_use(&self, slot: u32) -> Option<&Slot> {
        self.slots.get(slot as usize)?.as_ref()
    }
}

/// Writes an element, extending the array if necessary, and marks it as dirty if it has changed.
fn set<T: Copy + Default + PartialEq>(all: &mut Vec<T>, index: usize, element: T, dirty: &mut Vec<usize>) {
    let is_new = index >= all.len();
    if is_new {
        all.resize(index + 1, T::default());
    }
    if is_new || all[index] != element {
        all[index] = element;
        dirty.push(index);
    }
}

#[cfg(test)]
mod tests;
