//! The light table (`LightTable`) of this frame and, because temporal reuse reads it too, that of the last frame.
//!
//! The time of a change grows with the number of bins and of emissive instances, and with the number of triangles whose records change.  An
//! emissive instance that moves and keeps its size changes nothing.  A mesh whose material is edited gets another slot, which the records of
//! its triangles name.
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
    analytic::{AnalyticRecord, warn_about},
    emitter::{Emitter, gather, is_unchanged_mesh, meshes_of},
    records::LightRecords,
    shape_tree::ShapeTree,
    table::{LightTable, NextTable},
};
use crate::gpu_layout::*;
use crate::scene::{
    extract::{ExtractedScene, lights::AnalyticLight},
    features::SceneFeatures,
    geometry::instances::InstancePool,
    geometry::meshes::MeshPool,
    material::materials::MaterialPool,
    storage::{growable_buffer::GrowableBuffer, overflow_warning::OverflowWarning, uploads::Uploads},
};
use crate::warned::Warned;

/// The lights of the scene.
#[derive(Resource)]
pub(crate) struct LightPool {
    /// Everything that emits, in the order of [`gather`].
    pub(super) emitters: Vec<(MainEntity, Emitter)>,
    /// The list of emissive meshes or of their versions has changed in this frame.
    pub meshes_changed: bool,
    /// Lights that some cameras do not see, as in [`ExtractedScene`].
    hidden: HashMap<MainEntity, u32>,
    /// Bits of the cameras that do not see some light that another camera sees.
    pub(crate) hidden_from: u32,
    pub(super) table: LightTable,
    pub(super) last: LastTable,
    pub(super) records: LightRecords,
    pub gpu: GrowableBuffer<GpuLight>,
    /// The GPU has the records of this frame.
    pub fits: bool,
    /// Scene radius that the powers of directional lights were computed with, a power of two.
    radius: f32,
    /// Lights that a warning has named.
    warned: Warned<MainEntity>,
    /// Number of emissive triangles and of other lights that do not fit into the table.
    left_out: [u64; 2],
    overflow: OverflowWarning,
    pub features: SceneFeatures,
    /// Counts changes of the table.
    pub revision: u64,
    shapes: ShapeTree,
    /// Emitters that were looked at in this frame.
    pub visited: u64,
    /// Emissive triangles whose areas were computed in this frame.
    pub visited_triangles: u64,
}

/// The table of the last frame.
#[derive(Default)]
pub(super) enum LastTable {
    /// It is that of this frame.
    #[default]
    Same,
    Other(LightTable),
    /// Its records were overwritten, so that this frame finds none of its lights.
    Lost,
}

impl Default for LightPool {
    fn default() -> Self {
        Self {
            emitters: Vec::new(),
            meshes_changed: false,
            hidden: HashMap::default(),
            hidden_from: 0,
            table: LightTable::default(),
            last: LastTable::default(),
            records: LightRecords::default(),
            gpu: GrowableBuffer::new("lights"),
            fits: true,
            radius: 0.0,
            warned: Warned::default(),
            left_out: [0; 2],
            overflow: OverflowWarning::default(),
            features: SceneFeatures::empty(),
            revision: 0,
            shapes: ShapeTree::default(),
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
            ("lights", self.records.end() as usize),
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
        if self.overflow.should_warn(triangles + others, meshes.shown_are_built(&scene.instances) && !instances.waiting)
        {
            warn!(
                "restir: this device can bind {limit} lights at most: {triangles} emissive triangles are found by BSDF sampling only \
                 (noisier, not darker), {others} other lights are left out (darker)"
            );
        }
    }

    /// The meshes that emit light.
    pub(crate) fn emissive_meshes(&self) -> HashSet<AssetId<Mesh>> {
        meshes_of(&self.emitters).map(|(mesh, _)| mesh).collect()
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
        self.records.begin_frame();
        self.last = LastTable::Same;
        (self.visited, self.visited_triangles, self.meshes_changed) = (0, 0, false);
        let changed = instances.take_changed_emitters();
        let may_all_change = core::mem::take(&mut scene.lights_changed) | meshes.copies_arrived();
        let radius = (instances.top.radius.max(1e-3).log2().ceil()).exp2();
        let has_directional = self.features.intersects(SceneFeatures::LIGHT_DIRECTIONAL | SceneFeatures::SUN_DISK);
        let keeps_radius = radius == self.radius || !has_directional;
        let is_same = |entity: &MainEntity| is_unchanged_mesh(*entity, &self.emitters, instances, meshes, materials);
        if keeps_radius && !may_all_change && changed.iter().all(is_same) {
            self.visited = changed.len() as u64;
            return;
        }
        let emitters = gather(scene, instances, meshes, materials);
        self.visited = emitters.len() as u64;
        let mut pairs = emitters.iter().zip(&self.emitters);
        let is_unchanged = keeps_radius
            && self.hidden == scene.hidden_lights
            && emitters.len() == self.emitters.len()
            && pairs.all(|((entity, new), (old_entity, old))| entity == old_entity && new.is_unchanged_from(old));
        if is_unchanged {
            return;
        }
        self.radius = radius;
        self.hidden.clone_from(&scene.hidden_lights);
        self.hidden_from = self.hidden.values().fold(0, |all, bits| all | bits);
        self.replace_table(&emitters, instances, meshes, limit);
        self.meshes_changed = !meshes_of(&emitters).eq(meshes_of(&self.emitters));
        self.emitters = emitters;
    }

    /// Replaces the table, unless the lights that it holds have not changed: it holds no black lights, for example.
    fn replace_table(
        &mut self,
        emitters: &[(MainEntity, Emitter)],
        instances: &mut InstancePool,
        meshes: &MeshPool,
        limit: u32,
    ) {
        let next = self.next_table(emitters, meshes, limit).weighed(&self.table, instances);
        self.visited_triangles = next.computed;
        if next.equals(&self.table) {
            return;
        }
        self.revision += 1;
        let table = LightTable::after(&self.table, next, &mut self.records, instances);
        if self.records.end() <= 2 * limit {
            self.last = LastTable::Other(core::mem::replace(&mut self.table, table));
            return;
        }
        // No free range of the buffer is long enough: all records get other places.
        self.records.clear();
        let nothing = LightTable::default();
        let next = self.next_table(emitters, meshes, limit).weighed(&nothing, instances);
        self.visited_triangles += next.computed;
        self.table = LightTable::after(&nothing, next, &mut self.records, instances);
        self.last = LastTable::Lost;
    }

    /// The lights for which the table has room.
    fn next_table<'a>(
        &mut self,
        emitters: &'a [(MainEntity, Emitter)],
        meshes: &'a MeshPool,
        limit: u32,
    ) -> NextTable<'a> {
        self.features = SceneFeatures::empty();
        self.left_out = [0; 2];
        let mut next = NextTable::default();
        for (entity, emitter) in emitters {
            match emitter {
                Emitter::Analytic(light) => {
                    if let Some((record, power)) = self.analytic_record(*entity, light, next.record_count, limit) {
                        next.add_analytic(*entity, record, power);
                    }
                }
                Emitter::Mesh(mesh) => {
                    // Rays find its light even if the table has no room for it.
                    self.features |= SceneFeatures::LIGHT_TRIANGLES;
                    if next.record_count + mesh.record_count() > u64::from(limit) {
                        self.left_out[0] += u64::from(mesh.source.count);
                        continue;
                    }
                    if let Some(corners) = meshes.get(mesh.mesh).and_then(|mesh| mesh.corners.as_ref()) {
                        next.add_mesh(*entity, mesh, corners);
                    }
                }
            }
        }
        next
    }

    /// Record and power of an analytic light; `None` if it cannot be in the table.
    fn analytic_record(
        &mut self,
        entity: MainEntity,
        light: &AnalyticLight,
        record_count: u64,
        limit: u32,
    ) -> Option<(GpuLight, f64)> {
        let mut record = AnalyticRecord::new(light, self.radius);
        warn_about(entity, light, &record, &mut self.warned);
        if !record.can_be_sampled() {
            return None;
        }
        if record_count >= u64::from(limit) {
            self.left_out[1] += 1;
            return None;
        }
        record.light.kind |= self.hidden.get(&entity).map_or(0, |hidden| hidden << LIGHT_HIDDEN_SHIFT);
        self.features |= record.features;
        Some((record.light, record.power))
    }

    /// Uploads changes.  Returns the number of bytes.
    pub(crate) fn upload(&mut self, uploads: &mut Uploads) -> u64 {
        let sent = self.records.upload(&mut self.gpu, uploads);
        // The next frame tries again: memory may have become free.
        self.fits = sent.is_some();
        sent.unwrap_or_else(|| {
            warn_once!(
                "restir: the table of {} lights does not fit this device or its memory; Bevy lights all cameras until it fits",
                self.table.light_count()
            );
            0
        })
    }

    /// Updates the tree over spheres and rectangles.  Returns the uploaded bytes.
    pub(crate) fn build_shapes(&mut self, meshes: &mut MeshPool, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        if self.is_same() && !self.shapes.is_missing {
            return 0;
        }
        self.shapes.update(&self.table.analytic, meshes, device, queue)
    }

    /// Root node of the tree over spheres and rectangles, and the start of its list of bins; no root if nothing emits.
    pub(crate) fn shapes(&self) -> [u32; 2] {
        if self.end() > 0 { self.shapes.root_and_indices() } else { [NONE, 0] }
    }

    /// Number of directional lights with a disk, which come first among the analytic lights, if lights can be selected from the table.
    pub(crate) fn sun_count(&self) -> u32 {
        let suns = self.table.analytic.iter().take_while(|light| light.kind & LIGHT_KIND_BITS == LIGHT_SUN);
        if self.table.power > 0.0 { suns.count() as u32 } else { 0 }
    }

    /// Whether the last frame had the same table.
    pub(crate) fn is_same(&self) -> bool {
        matches!(self.last, LastTable::Same)
    }

    /// Sum of the powers of the table.
    pub(crate) fn power(&self) -> f64 {
        self.table.power
    }

    /// Largest probability of choosing the environment instead of a light of the table.
    pub(crate) fn environment_limit(&self) -> f32 {
        self.table.environment_limit
    }

    /// One past the last record in use, if lights can be selected from the table.
    pub(crate) fn end(&self) -> u32 {
        if self.table.power > 0.0 { self.records.end() } else { 0 }
    }

    /// Range of the bins, if lights can be selected from the table.
    pub(crate) fn bins(&self) -> Range<u32> {
        self.table.bins().unwrap_or(0..0)
    }

    /// First bin of an emissive instance.
    pub(crate) fn first_mesh_bin(&self) -> u32 {
        self.bins().start + self.table.analytic.len() as u32
    }

    /// Range of the bins of the last frame; that of this frame if the table is the same.  `None` if none of its lights can be found.
    pub(crate) fn previous_bins(&self) -> Option<Range<u32>> {
        match &self.last {
            LastTable::Same => Some(self.bins()),
            LastTable::Other(table) => table.bins(),
            LastTable::Lost => None,
        }
    }

    /// Number of lights that can be selected from the table.
    pub(crate) fn selectable(&self) -> u64 {
        if self.table.power > 0.0 { self.table.light_count() } else { 0 }
    }
}
