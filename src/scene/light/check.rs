//! Compares the records of lights with the tables of both frames, for tests.

use bevy::{
    platform::collections::{HashMap, HashSet},
    render::sync_world::MainEntity,
};

use super::{
    emitter::{Emitter, gather},
    id_remap::Group,
    lights::{LastTable, LightPool},
    records::LightRecords,
    table::LightTable,
};
use crate::gpu_layout::*;
use crate::scene::{
    extract::ExtractedScene, geometry::instances::InstancePool, geometry::meshes::MeshPool,
    material::materials::MaterialPool,
};

impl LightPool {
    /// Panics if an emitter differs from the scene.  After a change, also panics if a record differs from its table, or if a light of one frame
    /// is not linked to that of the same owner in the other frame.
    pub(crate) fn check(
        &self,
        scene: &ExtractedScene,
        instances: &InstancePool,
        meshes: &MeshPool,
        materials: &MaterialPool,
    ) {
        self.check_emitters(&gather(scene, instances, meshes, materials));
        if self.is_same() {
            return;
        }
        let (table, records) = (&self.table, &self.records);
        let sum = |records: &[GpuLight]| records.iter().map(|light| f64::from(light.pmf)).sum::<f64>();
        let bins = records.get(table.place.start..table.place.start + table.groups.len() as u32);
        assert!(table.power == 0.0 || (sum(bins) - 1.0).abs() < 1e-3, "the choice of a bin has the sum {}", sum(bins));
        for ((mesh, bin), index) in table.meshes.iter().zip(&bins[table.analytic.len()..]).zip(0..) {
            let (header, triangles) = (records.get(mesh.place.clone())[0], records.get(mesh.triangles()));
            assert_eq!((header.data[0], bin.data), (index, [mesh.triangles().start, triangles.len() as u32]));
            assert_eq!(instances.get(mesh.source.slot).first_light, mesh.triangles().start);
            let is_right = |(triangle, light): (u32, &GpuLight)| {
                (light.kind, light.link, light.data) == (LIGHT_TRIANGLE, mesh.place.start, [mesh.source.slot, triangle])
            };
            assert!((mesh.source.first_triangle..).zip(triangles).all(is_right), "instance {}", mesh.source.slot);
            let sum = sum(triangles);
            assert!((sum - 1.0).abs() < 1e-3 || sum == 0.0, "the choice of a triangle has the sum {sum}");
        }
        let LastTable::Other(last) = &self.last else { return };
        check_links(table, last, records);
        check_links(last, table, records);
        check_ranges(table, last);
    }

    /// Panics if the emitters differ from these, which were gathered from scratch.
    fn check_emitters(&self, expected: &[(MainEntity, Emitter)]) {
        assert_eq!(self.emitters.len(), expected.len(), "the number of emitters");
        for ((entity, known), (expected_entity, expected)) in self.emitters.iter().zip(expected) {
            assert_eq!(entity, expected_entity);
            // NaN differs from itself.
            let is_right = expected.is_unchanged_from(known) || !expected.is_unchanged_from(expected);
            assert!(is_right, "entity {} emits as {expected:?}, not as {known:?}", **entity);
        }
    }
}

/// Panics if a light of one table is not linked to that of the same owner in the other table.
fn check_links(one: &LightTable, other: &LightTable, records: &LightRecords) {
    let other_ids: HashMap<Group, u32> =
        other.groups.iter().copied().zip((0..).map(|bin| other.first_light(bin))).collect();
    for (bin, group) in one.groups.iter().enumerate() {
        let first = one.first_light(bin);
        let record = match bin < one.analytic.len() {
            true => records.get(first..first + 1)[0],
            false => records.get(first - 1..first)[0],
        };
        let expected = other_ids.get(group).copied().unwrap_or(NONE);
        assert_eq!(record.link, expected, "light {first} of {:?}", group.owner);
    }
}

/// Panics if two ranges of the tables overlap.  Both may use the same range for an instance.
fn check_ranges(table: &LightTable, last: &LightTable) {
    let own = table.meshes.iter().map(|mesh| mesh.place.clone());
    let mut ranges: Vec<_> = own.chain([table.place.clone(), last.place.clone()]).collect();
    let starts: HashSet<u32> = ranges.iter().map(|range| range.start).collect();
    ranges.extend(last.meshes.iter().map(|mesh| mesh.place.clone()).filter(|range| !starts.contains(&range.start)));
    ranges.retain(|range| !range.is_empty());
    ranges.sort_unstable_by_key(|range| range.start);
    assert!(ranges.is_sorted_by(|a, b| a.end <= b.start), "ranges of lights overlap: {ranges:?}");
}
