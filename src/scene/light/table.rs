//! The records of a light table: the bins of the choice first, which are the analytic lights and the emissive instances, and then the
//! triangles of every instance.  An alias table over the bins selects in proportion to power, except that distant lights and the others each
//! keep a least share (`balance_distant_lights`).  Each instance has an alias table over its triangles.

use bevy::render::sync_world::MainEntity;
use std::ops::Range;

use super::{
    alias_table::{AliasEntry, ENVIRONMENT_LIMIT, alias_table, balance_distant_lights},
    analytic::AnalyticRecord,
    emissive_mesh::{EmissiveMesh, MeshTable},
    emitter::{Emitter, mesh_table},
    id_remap::{Group, Owner},
};
use crate::gpu_layout::*;
use crate::scene::geometry::{instances::InstancePool, meshes::MeshPool};

pub(super) struct LightTable {
    /// Lights of the bins.
    pub groups: Vec<Group>,
    /// Powers of the bins.
    pub powers: Vec<f64>,
    /// Sources of the tables of the emissive instances, which have the last bins.
    pub meshes: Vec<MeshTable>,
    pub records: Vec<GpuLight>,
    /// Sum of the powers.
    pub power: f64,
    /// Largest probability of the environment beside the table.
    pub environment_limit: f32,
}

/// The next content of the bins, if each keeps its lights.
pub(super) struct NextBins<'a> {
    records: Vec<GpuLight>,
    powers: Vec<f64>,
    pub changed: Vec<ChangedMesh<'a>>,
}

/// An instance whose triangles have other records.
pub(super) struct ChangedMesh<'a> {
    pub bin: usize,
    pub mesh: &'a EmissiveMesh,
    /// A new table of the choice among the triangles, if the old one does not hold.
    table: Option<(MeshTable, Vec<AliasEntry>)>,
}

impl Default for LightTable {
    fn default() -> Self {
        Self {
            groups: Vec::new(),
            powers: Vec::new(),
            meshes: Vec::new(),
            records: Vec::new(),
            power: 0.0,
            environment_limit: ENVIRONMENT_LIMIT,
        }
    }
}

impl LightTable {
    /// The next content of the bins; `None` if some bin does not keep its lights.  `before`: the emitters of the table, in the same order.
    pub(super) fn next_bins<'a>(
        &self,
        emitters: &'a [(MainEntity, Emitter)],
        before: &[(MainEntity, Emitter)],
        radius: f32,
        instances: &InstancePool,
        meshes: &MeshPool,
    ) -> Option<NextBins<'a>> {
        let analytic = self.analytic_count();
        let count = self.groups.len();
        let (mut records, mut powers) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut changed = Vec::new();
        for ((entity, emitter), (_, old)) in emitters.iter().zip(before) {
            let bin = records.len();
            let is_of = |kind| self.groups.get(bin).is_some_and(|group| group.owner == Owner { entity: *entity, kind });
            let (record, power) = match (emitter, old) {
                (Emitter::Analytic(light), Emitter::Analytic(_)) => {
                    let record = AnalyticRecord::new(light, radius);
                    if !record.can_be_sampled() {
                        continue;
                    }
                    if !is_of(record.light.kind & LIGHT_KIND_BITS) {
                        return None;
                    }
                    (GpuLight { kind: self.records[bin].kind, ..record.light }, record.power)
                }
                (Emitter::Mesh(mesh), Emitter::Mesh(old)) => {
                    if (mesh.triangle_count, mesh.has_corners) != (old.triangle_count, old.has_corners) {
                        return None;
                    }
                    // The table may have no room for it.
                    if !is_of(LIGHT_TRIANGLE) {
                        continue;
                    }
                    let kept = mesh.area_by(&self.meshes[bin - analytic]);
                    let table = match kept {
                        Some(_) => None,
                        None => Some(mesh_table(mesh, instances, meshes)?),
                    };
                    let area = kept.or_else(|| Some(table.as_ref()?.0.area))?;
                    if table.is_some() || !mesh.has_records_of(old) {
                        changed.push(ChangedMesh { bin, mesh, table });
                    }
                    (mesh.bin(self.groups[bin].first), mesh.power(area))
                }
                _ => return None,
            };
            let GpuLight { pmf, alias_probability, alias_index, .. } = self.records[bin];
            let counterpart_or_mesh = self.groups[bin].first;
            records.push(GpuLight { pmf, alias_probability, alias_index, counterpart_or_mesh, ..record });
            powers.push(power);
        }
        (records.len() == count).then_some(NextBins { records, powers, changed })
    }

    /// Whether the table has this content.
    pub(super) fn has(&self, bins: &NextBins) -> bool {
        let is_same = |(new, old): (&GpuLight, &GpuLight)| {
            GpuLight { counterpart_or_mesh: old.counterpart_or_mesh, ..*new } == *old
        };
        let mut pairs = bins.records.iter().zip(&self.records);
        bins.changed.is_empty() && bins.powers == self.powers && pairs.all(is_same)
    }

    /// Replaces the bins, and the triangles of those that have changed.  Returns the number of triangles whose areas were computed.
    pub(super) fn replace(&mut self, bins: NextBins) -> u64 {
        let analytic = self.analytic_count();
        let mut computed = 0;
        self.records[..bins.records.len()].copy_from_slice(&bins.records);
        for ChangedMesh { bin, mesh, table } in bins.changed {
            let triangles = &mut self.records[triangles_of(&self.groups[bin])];
            let entries = match table {
                Some((table, entries)) => {
                    computed += entries.len() as u64;
                    self.meshes[bin - analytic] = table;
                    entries
                }
                None => triangles.iter().map(AliasEntry::from).collect(),
            };
            for (record, light) in triangles.iter_mut().zip(mesh.lights(bin as u32, entries)) {
                *record = light;
            }
        }
        if bins.powers != self.powers {
            self.powers = bins.powers;
            self.write_selection_probabilities();
        }
        computed
    }

    /// Computes the choice of a bin from the powers.
    pub(super) fn write_selection_probabilities(&mut self) {
        let mut powers = self.powers.clone();
        self.power = powers.iter().filter(|p| p.is_finite() && **p > 0.0).sum();
        let kind = |bin: usize| self.records[bin].kind & LIGHT_KIND_BITS;
        self.environment_limit =
            balance_distant_lights(&mut powers, |bin| matches!(kind(bin), LIGHT_SUN | LIGHT_DIRECTIONAL));
        match alias_table(&powers) {
            Some(entries) => {
                for (light, entry) in self.records.iter_mut().zip(entries) {
                    light.pmf = entry.pmf;
                    light.alias_probability = entry.probability;
                    light.alias_index = entry.alias;
                }
            }
            // Nothing emits: `count` reports an empty table, so shaders select nothing from it.
            None => self.power = 0.0,
        }
    }

    /// The bins.
    pub(super) fn bins(&self) -> &[GpuLight] {
        &self.records[..self.groups.len()]
    }

    /// The triangles of a bin, which are not bins themselves.
    pub(super) fn triangles(&self, bin: usize) -> &[GpuLight] {
        &self.records[triangles_of(&self.groups[bin])]
    }

    /// Number of analytic lights, which have the first bins.
    pub(super) fn analytic_count(&self) -> usize {
        self.groups.iter().take_while(|group| group.owner.kind != LIGHT_TRIANGLE).count()
    }

    /// Number of lights.
    pub(super) fn light_count(&self) -> u64 {
        self.groups.iter().map(|group| u64::from(group.count)).sum()
    }
}

/// Places in the table of the triangles of a group that are not bins themselves.
pub(super) fn triangles_of(group: &Group) -> Range<usize> {
    match group.count {
        1 => 0..0,
        count => group.first as usize..(group.first + count) as usize,
    }
}
