//! The table of lights.  Its first level has a bin for each analytic light, and then one for each emissive instance.  An alias table over the
//! bins selects in proportion to power, except that distant lights and the others each keep a least share (`balance_distant_lights`).  Each
//! instance has an alias table over its triangles.
//!
//! The records of a table lie in ranges that are allocated one by one.  All bins are in one range.  Whenever something changes, they get
//! another range, so that those of the last frame stay for temporal reuse.  Each instance has a range with a header, followed by its
//! triangles.  The range stays where it is as long as the instance keeps its slot and its triangles.  A triangle names its header, and the
//! header names the bin.  So a light that appears, disappears or changes leaves the triangles of all other instances as they are.

use bevy::render::sync_world::MainEntity;
use std::ops::Range;

use super::{
    alias_table::{AliasEntry, ENVIRONMENT_LIMIT, alias_table, balance_distant_lights},
    emissive_mesh::{EmissiveMesh, MeshTable, TriangleSource},
    id_remap::{Group, Owner, groups_after, groups_before},
    records::LightRecords,
};
use crate::gpu_layout::*;
use crate::planted::{Fault, is_planted};
use crate::scene::geometry::{instances::InstancePool, meshes::corner_copies::CornerCopy};

/// The range of the bins has a multiple of this length, so that it can be used again when there are a few lights more or less.
const BINS_STEP: u32 = 64;

/// The table of one frame.
pub(super) struct LightTable {
    /// Range of the bins, at whose end some records may be unused.
    pub place: Range<u32>,
    /// Lights of the bins.
    pub groups: Vec<Group>,
    /// Powers of the bins.
    powers: Vec<f64>,
    /// Analytic lights, which have the first bins.
    pub analytic: Vec<GpuLight>,
    /// Emissive instances, which have the other bins.
    pub meshes: Vec<MeshLights>,
    /// The choice of a bin.
    choice: Vec<AliasEntry>,
    /// Sum of the powers.
    pub power: f64,
    /// Largest probability of choosing the environment instead of a light of the table.
    pub environment_limit: f32,
}

/// The lights of an emissive instance.
#[derive(Debug)]
pub(super) struct MeshLights {
    pub source: TriangleSource,
    /// Range of the header and the triangles.
    pub place: Range<u32>,
    table: MeshTable,
}

/// The content of the next table, which has no place among the records yet.
#[derive(Default)]
pub(super) struct NextTable<'a> {
    groups: Vec<Group>,
    powers: Vec<f64>,
    analytic: Vec<GpuLight>,
    emissive: Vec<(&'a EmissiveMesh, &'a CornerCopy)>,
    /// The emissive instances, once they are weighed.
    meshes: Vec<NextMesh>,
    /// For each bin, the bin of the last table with the same lights.
    before: Vec<Option<usize>>,
    /// Number of records.
    pub record_count: u64,
    /// Triangles whose areas were computed.
    pub computed: u64,
}

/// An emissive instance of the next table.
struct NextMesh {
    source: TriangleSource,
    table: MeshTable,
    /// The choice among the triangles, if the last one does not hold.
    entries: Option<Vec<AliasEntry>>,
}

impl<'a> NextTable<'a> {
    /// Adds an analytic light.  Emissive instances follow afterwards.
    pub(super) fn add_analytic(&mut self, entity: MainEntity, light: GpuLight, power: f64) {
        let owner = Owner { entity, kind: light.kind & LIGHT_KIND_BITS };
        self.groups.push(Group { owner, count: 1 });
        self.analytic.push(light);
        self.powers.push(power);
        self.record_count += 1;
    }

    /// Adds an emissive instance.
    pub(super) fn add_mesh(&mut self, entity: MainEntity, mesh: &'a EmissiveMesh, corners: &'a CornerCopy) {
        let owner = Owner { entity, kind: LIGHT_TRIANGLE };
        self.groups.push(Group { owner, count: mesh.source.count });
        self.emissive.push((mesh, corners));
        self.record_count += mesh.record_count();
    }

    /// Finds the lights in the last table, and computes the powers of the instances.  Instances of the last table keep their choice among the
    /// triangles, if it still holds.
    pub(super) fn weighed(mut self, last: &LightTable, instances: &InstancePool) -> Self {
        self.before = groups_before(&last.groups, &self.groups);
        for ((mesh, corners), before) in self.emissive.drain(..).zip(&self.before[self.analytic.len()..]) {
            let source = mesh.source;
            let kept = before.map(|bin| last.mesh_of(bin).table);
            let (next, area) = match kept.and_then(|table| Some((table, mesh.area_by(&table)?))) {
                Some((table, area)) => (NextMesh { source, table, entries: None }, area),
                None => {
                    let transform = &instances.get(source.slot).world_from_object;
                    let (table, entries) = mesh.build(corners.corners(), transform);
                    self.computed += entries.len() as u64;
                    (NextMesh { source, table, entries: Some(entries) }, table.area)
                }
            };
            self.powers.push(mesh.power(area));
            self.meshes.push(next);
        }
        self
    }

    /// Whether the last table has this content.
    pub(super) fn equals(&self, last: &LightTable) -> bool {
        let mut meshes = self.meshes.iter().zip(&last.meshes);
        self.groups == last.groups
            && self.powers == last.powers
            && self.analytic == last.analytic
            && meshes.all(|(next, last)| next.source == last.source && next.entries.is_none())
    }
}

impl Default for LightTable {
    fn default() -> Self {
        Self {
            place: 0..0,
            groups: Vec::new(),
            powers: Vec::new(),
            analytic: Vec::new(),
            meshes: Vec::new(),
            choice: Vec::new(),
            power: 0.0,
            environment_limit: ENVIRONMENT_LIMIT,
        }
    }
}

impl LightTable {
    /// Makes the table of a frame, while the last one stays valid, and retires the ranges that only the last one uses.  Sets the first lights
    /// of the instances.
    pub(super) fn after(
        last: &Self,
        next: NextTable,
        records: &mut LightRecords,
        instances: &mut InstancePool,
    ) -> Self {
        let NextTable { groups, powers, analytic, meshes, before, .. } = next;
        let (choice, power, environment_limit) = if groups == last.groups && powers == last.powers {
            (last.choice.clone(), last.power, last.environment_limit)
        } else {
            choice_by_power(&powers, &analytic)
        };
        let place = records.allocate((groups.len() as u32).next_multiple_of(BINS_STEP));
        let last_meshes = before[analytic.len()..].iter().map(|bin| bin.map(|bin| last.mesh_of(bin)));
        let pairs = meshes.into_iter().zip(last_meshes);
        let meshes = pairs.map(|(next, last)| MeshLights::after(last, next, records)).collect();
        let table = Self { place, groups, powers, analytic, meshes, choice, power, environment_limit };
        table.link(last, &before, records, instances);
        table
    }

    /// Links both tables, so that each light is found in the other one.  `before`: for each bin, that of the last table with the same lights.
    fn link(&self, last: &Self, before: &[Option<usize>], records: &mut LightRecords, instances: &mut InstancePool) {
        let after = groups_after(before, last.groups.len());
        let id_before = |bin: usize| match is_planted(Fault::LightNotRemapped) {
            true => Some(self.first_light(bin)),
            false => before[bin].map(|bin| last.first_light(bin)),
        };
        self.write_bins(id_before, records);
        last.write_bins(|bin| after[bin].map(|bin| self.first_light(bin)), records);
        records.retire(last.place.clone());
        // A slot that has another owner now has no light before that owner sets it.
        for (mesh, bin) in last.meshes.iter().zip(&after[last.analytic.len()..]) {
            let next = bin.map(|bin| self.mesh_of(bin));
            if next.is_none_or(|next| next.place != mesh.place) {
                records.write(mesh.place.start, &[header(NONE, next)]);
                records.retire(mesh.place.clone());
                instances.set_first_light(mesh.source.slot, NONE);
            }
        }
        for ((mesh, bin), index) in self.meshes.iter().zip(&before[self.analytic.len()..]).zip(0..) {
            let last = bin.map(|bin| last.mesh_of(bin));
            records.write(mesh.place.start, &[header(index, last)]);
            if last.is_none_or(|last| last.place != mesh.place) {
                instances.set_first_light(mesh.source.slot, mesh.triangles().start);
            }
        }
    }

    /// Writes the bins.  `other_id`: the id that the light of a bin has in the other frame.
    fn write_bins(&self, other_id: impl Fn(usize) -> Option<u32>, records: &mut LightRecords) {
        let analytic = self.analytic.iter().enumerate();
        let analytic = analytic.map(|(bin, light)| GpuLight { link: other_id(bin).unwrap_or(NONE), ..*light });
        // The headers of instances have their ids in the other frame.
        let meshes = self.meshes.iter().map(|mesh| {
            let data = [mesh.triangles().start, mesh.source.count];
            GpuLight { kind: LIGHT_MESH, link: NONE, data, ..Default::default() }
        });
        let with_choice = |(light, entry): (GpuLight, &AliasEntry)| GpuLight {
            pmf: entry.pmf,
            alias_probability: entry.probability,
            alias_index: entry.alias,
            ..light
        };
        let bins: Vec<GpuLight> = analytic.chain(meshes).zip(&self.choice).map(with_choice).collect();
        records.write(self.place.start, &bins);
    }

    /// Places of the bins; `None` if nothing can be selected from them.
    pub(super) fn bins(&self) -> Option<Range<u32>> {
        (self.power > 0.0).then(|| self.place.start..self.place.start + self.groups.len() as u32)
    }

    /// Id of the first light of a bin.
    pub(super) fn first_light(&self, bin: usize) -> u32 {
        match bin.checked_sub(self.analytic.len()) {
            Some(mesh) => self.meshes[mesh].triangles().start,
            None => self.place.start + bin as u32,
        }
    }

    /// The instance of a bin, which is not that of an analytic light.
    fn mesh_of(&self, bin: usize) -> &MeshLights {
        &self.meshes[bin - self.analytic.len()]
    }

    /// Number of lights.
    pub(super) fn light_count(&self) -> u64 {
        self.groups.iter().map(|group| u64::from(group.count)).sum()
    }
}

impl MeshLights {
    /// Gives an instance its range, that of the last frame if its triangles are the same, and writes the triangles that have changed.
    fn after(last: Option<&Self>, next: NextMesh, records: &mut LightRecords) -> Self {
        let NextMesh { source, table, entries } = next;
        let kept = last.filter(|last| last.source == source).map(|last| last.place.clone());
        let entries = match last {
            Some(last) if kept.is_none() && entries.is_none() => {
                Some(records.get(last.triangles()).iter().map(AliasEntry::from).collect())
            }
            _ => entries,
        };
        let place = kept.unwrap_or_else(|| records.allocate(1 + source.count));
        if let Some(entries) = entries {
            let lights: Vec<GpuLight> = source.lights(place.start, entries).collect();
            records.write(place.start + 1, &lights);
        }
        Self { source, place, table }
    }

    /// Ids of the triangles.
    pub(super) fn triangles(&self) -> Range<u32> {
        self.place.start + 1..self.place.end
    }
}

/// Header of the triangles of an instance.  `bin`: that of the instance, counted from the first bin of an instance.  `other`: the instance in
/// the other frame.
fn header(bin: u32, other: Option<&MeshLights>) -> GpuLight {
    GpuLight { link: other.map_or(NONE, |other| other.triangles().start), data: [bin, 0], ..Default::default() }
}

/// The choice of a bin, the sum of the powers, and the largest probability of choosing the environment instead.
fn choice_by_power(powers: &[f64], analytic: &[GpuLight]) -> (Vec<AliasEntry>, f64, f32) {
    let power = powers.iter().filter(|p| p.is_finite() && **p > 0.0).sum();
    let mut balanced = powers.to_vec();
    let is_distant = |light: &GpuLight| matches!(light.kind & LIGHT_KIND_BITS, LIGHT_SUN | LIGHT_DIRECTIONAL);
    let environment_limit = balance_distant_lights(&mut balanced, |bin| analytic.get(bin).is_some_and(is_distant));
    match alias_table(&balanced) {
        Some(entries) => (entries, power, environment_limit),
        // Nothing emits: without power, shaders select nothing from the table.
        None => (vec![AliasEntry::default(); powers.len()], 0.0, environment_limit),
    }
}
