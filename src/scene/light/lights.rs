//! The light table: analytic lights first, then the triangles of every emissive instance.  An alias table over all of them selects in
//! proportion to power, except that distant lights and the others each keep a least share (`balance_distant_lights`).  Temporal reuse reads
//! the last frame's table too, so ids are remapped in both directions whenever the table changes.
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
    alias_table::{ENVIRONMENT_LIMIT, alias_table, balance_distant_lights},
    analytic::{AnalyticRecord, has_same_emission, has_same_placement, invalid_extent},
    emissive_mesh::EmissiveMesh,
    id_remap::{Group, LightRemap, Owner},
    luminance,
    shape_tree::ShapeTree,
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

/// Input of the light table: everything that the lights of one entity depend on.
#[derive(Clone, Debug)]
enum Emitter {
    Analytic(AnalyticLight),
    Mesh(EmissiveMesh),
}

impl Emitter {
    /// Whether the table stays valid as it is.
    fn is_unchanged_from(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => has_same_placement(a, b) && has_same_emission(a, b),
            (Self::Mesh(a), Self::Mesh(b)) => a.is_unchanged_from(b),
            _ => false,
        }
    }

    /// Whether the powers stay valid: an analytic light that moves keeps its power.
    fn has_only_moved_from(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => has_same_emission(a, b),
            _ => self.is_unchanged_from(other),
        }
    }
}

/// The lights of the scene.
#[derive(Resource)]
pub(crate) struct LightPool {
    emitters: Vec<(MainEntity, Emitter)>,
    /// Lights that some cameras do not see, as in [`ExtractedScene`].
    hidden: HashMap<MainEntity, u32>,
    /// Bits of the cameras that do not see some light that another camera sees.
    pub(crate) hidden_from: u32,
    groups: Vec<Group>,
    table: Vec<GpuLight>,
    uploaded: Vec<GpuLight>,
    pub gpu: GrowableBuffer<GpuLight>,
    /// The GPU has the table of this frame.
    pub fits: bool,
    /// Sum of the powers of the table.
    pub power: f64,
    /// Largest probability of the environment beside the table.
    pub environment_limit: f32,
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
    previous: Vec<GpuLight>,
    pending: Upload,
    /// The uploaded table of the last frame has the same lights in the same order as this frame's, and the same records of emissive
    /// triangles.
    previous_matches: bool,
    pub revision: u64,
    shapes: ShapeTree,
    /// Slots of the instances whose triangles are in the table.
    slots: Vec<u32>,
    /// Emitters that were looked at in this frame.
    pub visited: u64,
}

/// Parts of the table that the GPU does not have yet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Upload {
    #[default]
    Nothing,
    /// The first `previous.len()` lights, which have moved.
    MovedLights,
    Everything,
}

impl Default for LightPool {
    fn default() -> Self {
        Self {
            emitters: Vec::new(),
            hidden: HashMap::default(),
            hidden_from: 0,
            groups: Vec::new(),
            table: Vec::new(),
            uploaded: Vec::new(),
            gpu: GrowableBuffer::new("lights"),
            fits: true,
            power: 0.0,
            environment_limit: ENVIRONMENT_LIMIT,
            radius: 0.0,
            warned: Warned::default(),
            left_out: [0; 2],
            overflow: OverflowWarning::default(),
            features: SceneFeatures::empty(),
            previous_at: 0,
            previous: Vec::new(),
            pending: Upload::default(),
            previous_matches: false,
            revision: 0,
            shapes: ShapeTree::default(),
            slots: Vec::new(),
            visited: 0,
        }
    }
}

impl LightPool {
    /// Lengths of the pool's tables.
    #[cfg(feature = "testing")]
    pub(crate) fn lengths(&self) -> Vec<(&'static str, usize)> {
        vec![
            ("emitters", self.emitters.len()),
            ("lights", self.table.len()),
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

    /// Panics if the two tables of this frame disagree about the lights that they have in common.
    #[cfg(feature = "testing")]
    pub(crate) fn check(&self) {
        if self.previous_at == 0 || self.pending != Upload::Everything {
            return;
        }
        for (id, light) in self.table.iter().enumerate().filter(|(_, light)| light.counterpart != NONE) {
            let kind = light.kind & LIGHT_KIND_BITS;
            let before = self.previous.get(light.counterpart as usize);
            let before = before.map(|before| (before.counterpart, before.kind & LIGHT_KIND_BITS));
            assert_eq!(before, Some((id as u32, kind)), "light {id} was light {}", light.counterpart);
        }
    }

    /// The meshes that emit light.
    pub(crate) fn emissive_meshes(&self) -> HashSet<AssetId<Mesh>> {
        let mesh = |(_, emitter): &(_, Emitter)| match emitter {
            Emitter::Mesh(emissive) => Some(emissive.mesh),
            Emitter::Analytic(_) => None,
        };
        self.emitters.iter().filter_map(mesh).collect()
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
        (self.previous_at, self.visited) = (0, 0);
        let has_new_emitters =
            core::mem::take(&mut scene.lights_changed) | instances.take_emitters_changed() | meshes.copies_arrived();
        let radius = (instances.top.radius.max(1e-3).log2().ceil()).exp2();
        let has_directional = self.features.intersects(SceneFeatures::LIGHT_DIRECTIONAL | SceneFeatures::SUN_DISK);
        if !has_new_emitters && (radius == self.radius || !has_directional) {
            return;
        }
        let emitters = gather(scene, instances, meshes, materials);
        self.visited = emitters.len() as u64;
        let is_comparable = emitters.len() == self.emitters.len()
            && (radius == self.radius || !has_directional)
            && self.hidden == scene.hidden_lights;
        let all = |same: fn(&Emitter, &Emitter) -> bool| {
            is_comparable && emitters.iter().zip(&self.emitters).all(|(a, b)| a.0 == b.0 && same(&a.1, &b.1))
        };
        if all(Emitter::is_unchanged_from) {
            return;
        }
        if all(Emitter::has_only_moved_from) && self.move_lights(&emitters) {
            self.emitters = emitters;
            return;
        }
        let old = core::mem::take(&mut self.groups);
        self.previous = core::mem::take(&mut self.table);
        self.emitters = emitters;
        self.hidden.clone_from(&scene.hidden_lights);
        self.hidden_from = self.hidden.values().fold(0, |all, bits| all | bits);
        self.radius = radius;
        self.rebuild(instances, meshes, limit);
        // Temporal reuse looks lights up in both frames.
        let map = LightRemap::new(&old, self.previous.len() as u32, &self.groups, self.table.len() as u32);
        for (light, counterpart) in self.table.iter_mut().zip(map.previous_from_current) {
            light.counterpart = counterpart;
        }
        for (light, counterpart) in self.previous.iter_mut().zip(map.current_from_previous) {
            light.counterpart = counterpart;
        }
        self.previous_at = self.table.len().max(1) as u32;
        // An emissive instance that is edited has another slot, which the records of its triangles name.
        let analytic = self.analytic_count();
        self.previous_matches = old == self.groups && self.previous[analytic..] == self.table[analytic..];
        self.pending = Upload::Everything;
    }

    /// Updates the records of analytic lights that have only moved, without visiting the emissive triangles.  Returns false and does
    /// nothing if the set of lights in the table changes, or if no matching table of the last frame is uploaded.
    fn move_lights(&mut self, emitters: &[(MainEntity, Emitter)]) -> bool {
        let analytic = self.analytic_count();
        let mut moved = Vec::with_capacity(analytic);
        for (entity, emitter) in emitters {
            let Emitter::Analytic(light) = emitter else { break };
            let record = AnalyticRecord::new(light, self.radius);
            if !record.can_be_sampled() {
                continue;
            }
            let id = moved.len();
            let owner = Owner { entity: *entity, kind: record.light.kind & LIGHT_KIND_BITS };
            if id == analytic || self.groups[id].owner != owner {
                return false;
            }
            let GpuLight { kind, pmf, alias_probability, alias_index, .. } = self.table[id];
            moved.push(GpuLight { kind, pmf, alias_probability, alias_index, counterpart: id as u32, ..record.light });
        }
        if moved.len() != analytic {
            return false;
        }
        // If only lights outside the table have moved, black ones for example, nothing changes.
        let is_unmoved = |(new, old): (&GpuLight, &GpuLight)| GpuLight { counterpart: old.counterpart, ..*new } == *old;
        if moved.iter().zip(&self.table).all(is_unmoved) {
            return true;
        }
        if !self.previous_matches {
            return false;
        }
        self.previous.clear();
        self.previous.extend_from_slice(&self.table[..analytic]);
        self.table[..analytic].copy_from_slice(&moved);
        self.previous_at = self.table.len().max(1) as u32;
        self.pending = Upload::MovedLights;
        true
    }

    fn rebuild(&mut self, instances: &mut InstancePool, meshes: &MeshPool, limit: u32) {
        self.table.clear();
        self.features = SceneFeatures::empty();
        // A slot that has changed its owner since then has no light yet.
        self.slots.drain(..).for_each(|slot| instances.set_first_light(slot, NONE));
        let mut powers = Vec::new();
        self.left_out = [0; 2];
        let emitters = core::mem::take(&mut self.emitters);
        for (entity, emitter) in &emitters {
            let first = self.table.len() as u32;
            let kind = match emitter {
                Emitter::Analytic(light) => {
                    let Some((light, power)) = self.add_analytic(*entity, light, limit) else { continue };
                    self.table.push(light);
                    powers.push(power);
                    light.kind & LIGHT_KIND_BITS
                }
                Emitter::Mesh(emissive) => {
                    // Rays find its light even if the table has no room for it.
                    self.features |= SceneFeatures::LIGHT_TRIANGLES;
                    if first as u64 + emissive.triangle_count as u64 > limit as u64 {
                        self.left_out[0] += emissive.triangle_count as u64;
                        continue;
                    }
                    let Some(corners) = meshes.get(emissive.mesh).and_then(|mesh| mesh.corners.as_ref()) else {
                        continue;
                    };
                    let transform = instances.get(emissive.slot).world_from_object;
                    for (light, power) in emissive.lights(corners, &transform) {
                        self.table.push(light);
                        powers.push(power);
                    }
                    instances.set_first_light(emissive.slot, first);
                    self.slots.push(emissive.slot);
                    LIGHT_TRIANGLE
                }
            };
            let owner = Owner { entity: *entity, kind };
            self.groups.push(Group { owner, first, count: self.table.len() as u32 - first });
        }
        self.emitters = emitters;
        self.write_selection_probabilities(powers);
    }

    /// Record and power of an analytic light; `None` if it cannot be in the table.  Warns once about a light with invalid values.
    fn add_analytic(&mut self, entity: MainEntity, light: &AnalyticLight, limit: u32) -> Option<(GpuLight, f64)> {
        let mut record = AnalyticRecord::new(light, self.radius);
        if let Some(problem) = invalid_extent(light)
            && self.warned.is_due(entity)
        {
            warn!("restir: light {} has {problem}", *entity);
        }
        if !record.can_be_sampled() {
            // A black light is ordinary; infinite and negative powers are errors of the app.
            let is_placed = record.has_finite_transform();
            if (record.power != 0.0 || !is_placed) && self.warned.is_due(entity) {
                if is_placed {
                    warn!("restir: light {} has the invalid power {}; it is not rendered", *entity, record.power);
                } else {
                    warn!(
                        "restir: light {} has a transform that is not finite or too far away; it is not rendered",
                        *entity
                    );
                }
            }
            return None;
        }
        if self.table.len() as u32 >= limit {
            self.left_out[1] += 1;
            return None;
        }
        record.light.kind |= self.hidden.get(&entity).map_or(0, |hidden| hidden << LIGHT_HIDDEN_SHIFT);
        self.features |= record.features;
        Some((record.light, record.power))
    }

    fn write_selection_probabilities(&mut self, mut powers: Vec<f64>) {
        self.power = powers.iter().filter(|p| p.is_finite() && **p > 0.0).sum();
        let kind = |i: usize| self.table[i].kind & LIGHT_KIND_BITS;
        self.environment_limit =
            balance_distant_lights(&mut powers, |i| matches!(kind(i), LIGHT_SUN | LIGHT_DIRECTIONAL));
        match alias_table(&powers) {
            Some(entries) => {
                for (light, entry) in self.table.iter_mut().zip(entries) {
                    light.pmf = entry.pmf;
                    light.alias_probability = entry.probability;
                    light.alias_index = entry.alias;
                }
            }
            // Nothing emits: `count` reports an empty table, so shaders select nothing from it.
            None => self.power = 0.0,
        }
    }

    /// Uploads changes.  Returns the number of bytes.
    pub(crate) fn upload(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        self.fits = true;
        match core::mem::take(&mut self.pending) {
            Upload::Nothing => 0,
            Upload::MovedLights => {
                self.revision += 1;
                self.upload_moved(queue)
            }
            Upload::Everything => {
                self.revision += 1;
                self.upload_everything(device, queue)
            }
        }
    }

    fn upload_moved(&mut self, queue: &RenderQueue) -> u64 {
        let count = self.previous.len();
        let last = self.previous_at as usize..self.previous_at as usize + self.table.len();
        debug_assert!(
            self.uploaded[last][count..] == self.table[count..],
            "the last table has other emissive triangles"
        );
        let parts = [(0, &self.table[..count]), (self.previous_at as usize, &self.previous[..])];
        parts
            .into_iter()
            .map(|(first, lights)| {
                let uploaded = &mut self.uploaded[first..first + count];
                let runs = dirty_runs(uploaded, lights);
                uploaded.copy_from_slice(lights);
                let write = |run: Range<usize>| self.gpu.write((first + run.start) as u32, &lights[run], queue);
                runs.into_iter().map(write).sum::<u64>()
            })
            .sum()
    }

    fn upload_everything(&mut self, device: &RenderDevice, queue: &RenderQueue) -> u64 {
        let mut both = self.table.clone();
        both.resize(both.len().max(self.previous_at as usize), GpuLight::default());
        both.append(&mut self.previous);
        if !self.gpu.reserve(both.len() as u32, device, queue) {
            warn_once!(
                "restir: the table of {} lights does not fit this device or its memory; Bevy lights all cameras until it fits",
                self.table.len()
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
        let analytic = self.analytic_count();
        self.shapes.update(&self.table[..analytic], meshes, device, queue)
    }

    /// Root node of the tree over spheres and rectangles, and the start of its list of light ids; no root if nothing emits.
    pub(crate) fn shapes(&self) -> [u32; 2] {
        if self.count() > 0 { self.shapes.root_and_indices() } else { [NONE, 0] }
    }

    /// Number of analytic lights, which come first in the table.
    fn analytic_count(&self) -> usize {
        self.groups.iter().take_while(|group| group.owner.kind != LIGHT_TRIANGLE).count()
    }

    /// Number of directional lights with a disk, which come first among the analytic lights.
    pub(crate) fn sun_count(&self) -> u32 {
        let suns = self.table.iter().take_while(|light| light.kind & LIGHT_KIND_BITS == LIGHT_SUN).count();
        (suns as u32).min(self.count())
    }

    /// Number of lights that can be selected from the table.
    pub(crate) fn count(&self) -> u32 {
        if self.power > 0.0 { self.table.len() as u32 } else { 0 }
    }
}

/// Everything in the scene that emits, analytic lights first.
fn gather(
    scene: &ExtractedScene,
    instances: &InstancePool,
    meshes: &MeshPool,
    materials: &MaterialPool,
) -> Vec<(MainEntity, Emitter)> {
    let analytic = scene.lights.iter().map(|(entity, light)| (*entity, Emitter::Analytic(*light)));
    let emissive = instances.emitters().into_iter().filter_map(|(slot, live)| {
        let emission = materials.mean_emission(live.material);
        let mesh = meshes.get(live.mesh)?;
        if luminance(emission) <= 0.0 {
            return None;
        }
        let double_sided = materials.get(live.material)?.flags & MATERIAL_DOUBLE_SIDED != 0;
        let mesh = EmissiveMesh::new(slot, (live.mesh, mesh), instances.get(slot), emission, double_sided);
        Some((live.entity, Emitter::Mesh(mesh)))
    });
    analytic.chain(emissive).collect()
}
