//! The light table (`LightTable`) of this frame and, because temporal reuse reads it too, that of the last frame.  Ids are remapped in both
//! directions whenever the table changes.
//!
//! As long as the same emitters have as many lights, a change costs time and bytes in proportion to the number of bins and to the triangles
//! whose records change: no triangles of a mesh that becomes larger, or beside which a lamp flickers.  A mesh whose material is edited has
//! another slot, which the records of its triangles name.
//!
//! Emissive triangles beyond the device's limit are not in the table, but BSDF sampling still hits them: the picture is noisier, not darker.

use bevy::{
    asset::AssetId,
    ecs::resource::Resource,
    log::{warn, warn_once},
    mesh::Mesh,
    platform::collections::{HashMap, HashSet},
    render::{
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
    },
};
use std::ops::Range;

use super::{
    alias_table::AliasEntry,
    analytic::{AnalyticRecord, warn_about},
    emitter::{Emitter, gather},
    id_remap::{Group, LightRemap, Owner},
    shape_tree::ShapeTree,
    table::{LightTable, NextBins, triangles_of},
};
use crate::gpu_layout::*;
use crate::scene::{
    extract::{ExtractedScene, lights::AnalyticLight},
    features::SceneFeatures,
    geometry::instances::InstancePool,
    geometry::meshes::MeshPool,
    material::materials::MaterialPool,
    storage::{dirty_runs::dirty_runs, growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning},
};
use crate::warned::Warned;

/// The lights of the scene.
#[derive(Resource)]
pub(crate) struct LightPool {
    emitters: Vec<(MainEntity, Emitter)>,
    /// Lights that some cameras do not see, as in [`ExtractedScene`].
    hidden: HashMap<MainEntity, u32>,
    /// Bits of the cameras that do not see some light that another camera sees.
    pub(crate) hidden_from: u32,
    table: LightTable,
    uploaded: Vec<GpuLight>,
    pub gpu: GrowableBuffer<GpuLight>,
    /// The GPU has the table of this frame.
    pub fits: bool,
    /// Scene radius that the powers of directional lights were computed with, a power of two.
    radius: f32,
    /// Lights that a warning has named.
    warned: Warned<MainEntity>,
    /// Number of emissive triangles and of other lights that do not fit into the table.
    left_out: [u64; 2],
    overflow: OverflowWarning,
    pub features: SceneFeatures,
    /// Index of the last frame's table in the buffer, behind this frame's; 0 if both tables are equal.
    pub(crate) previous_at: u32,
    /// Number of bins of the last frame's table.
    pub(crate) previous_bins: u32,
    /// The last frame's table, or its bins if the rest is uploaded.
    previous: Vec<GpuLight>,
    /// Places and records of the triangles of the last frame's table that the uploaded one lacks.
    previous_triangles: Vec<(usize, Vec<GpuLight>)>,
    pending: Upload,
    /// The uploaded table of the last frame has the same groups as this frame's.
    previous_matches: bool,
    /// Bins of the instances whose triangles have other records in the uploaded table of the last frame.
    outdated: Vec<usize>,
    pub revision: u64,
    shapes: ShapeTree,
    /// Slots of the instances whose triangles are in the table.
    slots: Vec<u32>,
    /// Emitters that were looked at in this frame.
    pub visited: u64,
    /// Emissive triangles whose areas were computed in this frame.
    pub visited_triangles: u64,
}

/// Parts of the table that the GPU does not have yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Upload {
    #[default]
    Nothing,
    /// The bins, and the triangles of the outdated bins.
    Parts,
    Everything,
}

impl Default for LightPool {
    fn default() -> Self {
        Self {
            emitters: Vec::new(),
            hidden: HashMap::default(),
            hidden_from: 0,
            table: LightTable::default(),
            uploaded: Vec::new(),
            gpu: GrowableBuffer::new("lights"),
            fits: true,
            radius: 0.0,
            warned: Warned::default(),
            left_out: [0; 2],
            overflow: OverflowWarning::default(),
            features: SceneFeatures::empty(),
            previous_at: 0,
            previous_bins: 0,
            previous: Vec::new(),
            previous_triangles: Vec::new(),
            pending: Upload::default(),
            previous_matches: false,
            outdated: Vec::new(),
            revision: 0,
            shapes: ShapeTree::default(),
            slots: Vec::new(),
            visited: 0,
            visited_triangles: 0,
        }
    }
}

impl LightPool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("emitters", self.emitters.len()),
            ("lights", self.table.records.len()),
            ("hidden lights", self.hidden.len()),
            ("warnings of lights", self.warned.len()),
        ]
    }

    /// Updates the table from the scene, and sets the id of the first light of every emissive instance.  `limit`: number of lights that the
    /// device can bind.
    pub(crate) fn update(
        &mut self,
        scene: &mut ExtractedScene,
        instances: &mut InstancePool,
        meshes: &MeshPool,
        materials: &MaterialPool,
        limit: u32,
    ) {
        self.warned.begin_frame();
        self.update_table(scene, instances, meshes, materials, limit);
        let [triangles, others] = self.left_out;
        if self.overflow.should_warn(triangles + others, meshes.idle(&scene.instances) && !instances.waiting) {
            warn!(
                "restir: this device can bind {limit} lights at most: {triangles} emissive triangles are found by BSDF sampling only \
                 (noisier, not darker), {others} other lights are left out (darker)"
            );
        }
    }

    /// Panics if the two tables of this frame disagree about the lights that they have in common, or lack changes of triangles.
    #[cfg(feature = "testing")]
    pub(crate) fn check(&self) {
        if self.previous_at == 0 {
            return;
        }
        if self.pending != Upload::Everything {
            for (bin, group) in self.table.groups.iter().enumerate() {
                let (first, triangles) = (triangles_of(group).start, self.table.triangles(bin));
                let is_uploaded = |at: usize| self.uploaded[at..at + triangles.len()] == *triangles;
                assert!(self.outdated.contains(&bin) || is_uploaded(first), "bin {bin} has other triangles");
                let is_sent = self.previous_triangles.iter().any(|(sent, _)| *sent == first);
                assert!(is_sent || is_uploaded(self.previous_at as usize + first), "bin {bin} had other triangles");
            }
            return;
        }
        for (light, group) in self.table.bins().iter().zip(&self.table.groups) {
            let link = light.counterpart_or_mesh;
            if link == NONE {
                continue;
            }
            // The counterpart of a mesh is the first of its triangles.
            let before = match self.previous.get(link as usize) {
                Some(before) if link >= self.previous_bins => self.previous.get(before.counterpart_or_mesh as usize),
                before => before,
            };
            let key = |light: &GpuLight| match light.kind & LIGHT_KIND_BITS {
                LIGHT_MESH => (LIGHT_MESH, light.data[1]),
                kind => (kind, 1),
            };
            let before = before.map(|before| (before.counterpart_or_mesh, key(before)));
            assert_eq!(before, Some((group.first, key(light))), "light {} was light {link}", group.first);
        }
    }

    /// The meshes that emit light.
    pub(crate) fn emissive_meshes(&self) -> HashSet<AssetId<Mesh>> {
        self.emitters.iter().filter_map(|(_, emitter)| emitter.mesh()).collect()
    }

    /// Forgets the warnings about lights that are gone.
    pub(crate) fn forget_warnings(&mut self, exists: impl Fn(MainEntity) -> bool) {
        self.warned.retain(|entity| exists(*entity));
    }

    fn update_table(
        &mut self,
        scene: &mut ExtractedScene,
        instances: &mut InstancePool,
        meshes: &MeshPool,
        materials: &MaterialPool,
        limit: u32,
    ) {
        (self.previous_at, self.visited, self.visited_triangles) = (0, 0, 0);
        let has_new_emitters =
            core::mem::take(&mut scene.lights_changed) | instances.take_emitters_changed() | meshes.copies_arrived();
        let radius = (instances.top.radius.max(1e-3).log2().ceil()).exp2();
        let has_directional = self.features.intersects(SceneFeatures::LIGHT_DIRECTIONAL | SceneFeatures::SUN_DISK);
        let keeps_radius = radius == self.radius || !has_directional;
        if !has_new_emitters && keeps_radius {
            return;
        }
        let emitters = gather(scene, instances, meshes, materials);
        self.visited = emitters.len() as u64;
        let before = core::mem::replace(&mut self.emitters, emitters);
        let is_comparable = before.len() == self.emitters.len()
            && self.hidden == scene.hidden_lights
            && self.emitters.iter().zip(&before).all(|(new, old)| new.0 == old.0);
        let mut pairs = self.emitters.iter().zip(&before);
        if is_comparable && keeps_radius && pairs.all(|(new, old)| new.1.is_unchanged_from(&old.1)) {
            self.emitters = before;
            return;
        }
        self.radius = radius;
        if is_comparable && self.update_bins(&before, instances, meshes) {
            return;
        }
        self.hidden.clone_from(&scene.hidden_lights);
        self.hidden_from = self.hidden.values().fold(0, |all, bits| all | bits);
        self.rebuild(instances, meshes, limit);
    }

    /// Updates the bins and the triangles of instances that have changed, and visits no other triangles.  Returns false and does nothing if
    /// the set of lights in the table changes, or if no matching table of the last frame is uploaded.
    fn update_bins(
        &mut self,
        before: &[(MainEntity, Emitter)],
        instances: &mut InstancePool,
        meshes: &MeshPool,
    ) -> bool {
        let emitters = core::mem::take(&mut self.emitters);
        let bins = self.table.next_bins(&emitters, before, self.radius, instances, meshes);
        let is_updated = bins.is_some_and(|bins| {
            // If only lights outside the table have changed, black ones for example, nothing changes.
            let is_unchanged = self.table.has(&bins);
            if !is_unchanged && self.previous_matches {
                self.replace_bins(bins, instances);
            }
            is_unchanged || self.previous_matches
        });
        for ((entity, new), (_, old)) in emitters.iter().zip(before).filter(|_| is_updated) {
            if let Emitter::Analytic(light) = new
                && !new.is_unchanged_from(old)
            {
                warn_about(*entity, light, &AnalyticRecord::new(light, self.radius), &mut self.warned);
            }
        }
        self.emitters = emitters;
        is_updated
    }

    fn replace_bins(&mut self, bins: NextBins, instances: &mut InstancePool) {
        self.previous.clear();
        self.previous.extend_from_slice(self.table.bins());
        for (light, group) in self.previous.iter_mut().zip(&self.table.groups) {
            light.counterpart_or_mesh = group.first;
        }
        let changed: Vec<usize> = bins.changed.iter().map(|changed| changed.bin).collect();
        let mut outdated = core::mem::replace(&mut self.outdated, changed);
        outdated.extend_from_slice(&self.outdated);
        outdated.sort_unstable();
        outdated.dedup();
        let triangles = |bin: usize| (triangles_of(&self.table.groups[bin]).start, self.table.triangles(bin).to_vec());
        self.previous_triangles = outdated.into_iter().map(triangles).collect();
        // A slot that has changed its owner since then has no light yet.
        let analytic = self.table.analytic_count();
        for changed in &bins.changed {
            instances.set_first_light(self.slots[changed.bin - analytic], NONE);
        }
        for changed in &bins.changed {
            self.slots[changed.bin - analytic] = changed.mesh.slot;
            instances.set_first_light(changed.mesh.slot, self.table.groups[changed.bin].first);
        }
        self.visited_triangles = self.table.replace(bins);
        self.previous_at = self.table.records.len().max(1) as u32;
        self.previous_bins = self.table.groups.len() as u32;
        self.pending = Upload::Parts;
    }

    /// Builds the table.  Instances that were in the last one keep their tables, if these hold.
    fn rebuild(&mut self, instances: &mut InstancePool, meshes: &MeshPool, limit: u32) {
        let old = core::mem::take(&mut self.table);
        self.features = SceneFeatures::empty();
        // A slot that has changed its owner since then has no light yet.
        self.slots.drain(..).for_each(|slot| instances.set_first_light(slot, NONE));
        self.left_out = [0; 2];
        let emitters = core::mem::take(&mut self.emitters);
        let mut emissive = Vec::new();
        let mut record_count = 0;
        for (entity, emitter) in &emitters {
            let (kind, count) = match emitter {
                Emitter::Analytic(light) => {
                    let Some((light, power)) = self.add_analytic(*entity, light, limit) else { continue };
                    self.table.records.push(light);
                    self.table.powers.push(power);
                    record_count += 1;
                    (light.kind & LIGHT_KIND_BITS, 1)
                }
                Emitter::Mesh(mesh) => {
                    // Rays find its light even if the table has no room for it.
                    self.features |= SceneFeatures::LIGHT_TRIANGLES;
                    if record_count + mesh.record_count() > u64::from(limit) {
                        self.left_out[0] += u64::from(mesh.triangle_count);
                        continue;
                    }
                    let Some(corners) = meshes.get(mesh.mesh).and_then(|mesh| mesh.corners.as_ref()) else { continue };
                    record_count += mesh.record_count();
                    emissive.push((mesh, corners));
                    (LIGHT_TRIANGLE, mesh.triangle_count)
                }
            };
            let first = self.table.groups.len() as u32;
            self.table.groups.push(Group { owner: Owner { entity: *entity, kind }, first, count });
        }
        let mut next = self.table.groups.len() as u32;
        for group in self.table.groups.iter_mut().filter(|group| group.count != 1) {
            group.first = next;
            next += group.count;
        }
        let remap = LightRemap::new(&old.groups, &self.table.groups);
        let (analytic, old_analytic) = (self.table.records.len(), old.analytic_count());
        for ((mesh, _), group) in emissive.iter().zip(&self.table.groups[analytic..]) {
            self.table.records.push(mesh.bin(group.first));
        }
        for (bin, (mesh, corners)) in (analytic..).zip(emissive) {
            let kept = remap.previous_groups[bin].and_then(|before| {
                let table = old.meshes[before - old_analytic];
                let entries = old.triangles(before).iter().map(AliasEntry::from);
                mesh.area_by(&table).map(|area| (table, entries.collect::<Vec<_>>(), area))
            });
            let (table, entries, area) = kept.unwrap_or_else(|| {
                let (table, entries) = mesh.build(corners.corners(), &instances.get(mesh.slot).world_from_object);
                self.visited_triangles += entries.len() as u64;
                (table, entries, table.area)
            });
            if mesh.triangle_count != 1 {
                self.table.records.extend(mesh.lights(bin as u32, entries));
            }
            self.table.powers.push(mesh.power(area));
            self.table.meshes.push(table);
            instances.set_first_light(mesh.slot, self.table.groups[bin].first);
            self.slots.push(mesh.slot);
        }
        self.emitters = emitters;
        self.table.write_selection_probabilities();
        self.previous_matches = old.groups == self.table.groups;
        // An emissive instance that is edited has another slot, which the records of its triangles name.
        let bins = if self.previous_matches { analytic..self.table.groups.len() } else { 0..0 };
        self.outdated = bins.filter(|bin| old.triangles(*bin) != self.table.triangles(*bin)).collect();
        self.previous_at = self.table.records.len().max(1) as u32;
        self.previous_bins = old.groups.len() as u32;
        self.previous = old.records;
        self.previous_triangles.clear();
        // Temporal reuse looks lights up in both frames.
        for (light, counterpart) in self.table.records.iter_mut().zip(remap.previous_from_current) {
            light.counterpart_or_mesh = counterpart;
        }
        for (light, counterpart) in self.previous.iter_mut().zip(remap.current_from_previous) {
            light.counterpart_or_mesh = counterpart;
        }
        self.pending = Upload::Everything;
    }

    /// Record and power of an analytic light; `None` if it cannot be in the table.
    fn add_analytic(&mut self, entity: MainEntity, light: &AnalyticLight, limit: u32) -> Option<(GpuLight, f64)> {
        let mut record = AnalyticRecord::new(light, self.radius);
        warn_about(entity, light, &record, &mut self.warned);
        if !record.can_be_sampled() {
            return None;
        }
        if self.table.records.len() as u32 >= limit {
            self.left_out[1] += 1;
            return None;
        }
        record.light.kind |= self.hidden.get(&entity).map_or(0, |hidden| hidden << LIGHT_HIDDEN_SHIFT);
        self.features |= record.features;
        Some((record.light, record.power))
    }

    /// Uploads changes.  Returns the number of bytes.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        self.fits = true;
        match core::mem::take(&mut self.pending) {
            Upload::Nothing => 0,
            Upload::Parts => {
                self.revision += 1;
                self.upload_parts(queue)
            }
            Upload::Everything => {
                self.revision += 1;
                self.upload_everything(device, queue)
            }
        }
    }

    fn upload_parts(&mut self, queue: &RenderQueue) -> u64 {
        let last = self.previous_at as usize;
        let mut parts = vec![(0, self.table.bins()), (last, &self.previous[..])];
        let changed = |bin: &usize| (triangles_of(&self.table.groups[*bin]).start, self.table.triangles(*bin));
        parts.extend(self.outdated.iter().map(changed));
        parts.extend(self.previous_triangles.iter().map(|(first, lights)| (last + first, &lights[..])));
        parts
            .into_iter()
            .map(|(first, lights)| {
                let uploaded = &mut self.uploaded[first..first + lights.len()];
                let runs = dirty_runs(uploaded, lights);
                uploaded.copy_from_slice(lights);
                let write = |run: Range<usize>| self.gpu.write((first + run.start) as u32, &lights[run], queue);
                runs.into_iter().map(write).sum::<u64>()
            })
            .sum()
    }

    fn upload_everything(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let mut both = self.table.records.clone();
        both.resize(both.len().max(self.previous_at as usize), GpuLight::default());
        both.append(&mut self.previous);
        if !self.gpu.reserve(both.len() as u32, device, queue) {
            warn_once!(
                "restir: the table of {} lights does not fit this device or its memory; Bevy lights all cameras until it fits",
                self.table.records.len()
            );
            (self.fits, self.previous_matches) = (false, false);
            // The next frame tries again: memory may have become free.
            self.pending = Upload::Everything;
            return 0;
        }
        let runs = dirty_runs(&self.uploaded, &both);
        let bytes = self.gpu.write_runs(&runs, &both, device, queue);
        self.uploaded = both;
        bytes
    }

    /// Updates the tree over spheres and rectangles.  Returns the uploaded bytes.
    pub(crate) fn build_shapes(&mut self, meshes: &mut MeshPool, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.pending == Upload::Nothing && !self.shapes.is_missing {
            return 0;
        }
        let analytic = self.table.analytic_count();
        self.shapes.update(&self.table.records[..analytic], meshes, device, queue)
    }

    /// Root node of the tree over spheres and rectangles, and the start of its list of light ids; no root if nothing emits.
    pub(crate) fn shapes(&self) -> [u32; 2] {
        if self.count() > 0 { self.shapes.root_and_indices() } else { [NONE, 0] }
    }

    /// Number of directional lights with a disk, which come first among the analytic lights.
    pub(crate) fn sun_count(&self) -> u32 {
        let suns = self.table.records.iter().take_while(|light| light.kind & LIGHT_KIND_BITS == LIGHT_SUN).count();
        (suns as u32).min(self.count())
    }

    /// Sum of the powers of the table.
    pub(crate) fn power(&self) -> f64 {
        self.table.power
    }

    /// Largest probability of the environment beside the table.
    pub(crate) fn environment_limit(&self) -> f32 {
        self.table.environment_limit
    }

    /// Number of records in the table, if lights can be selected from it.
    pub(crate) fn count(&self) -> u32 {
        if self.table.power > 0.0 { self.table.records.len() as u32 } else { 0 }
    }

    /// Number of bins, if lights can be selected from the table.
    pub(crate) fn bin_count(&self) -> u32 {
        if self.table.power > 0.0 { self.table.groups.len() as u32 } else { 0 }
    }

    /// Number of lights that can be selected from the table.
    pub(crate) fn selectable(&self) -> u64 {
        if self.table.power > 0.0 { self.table.light_count() } else { 0 }
    }
}
