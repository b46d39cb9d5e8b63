//! Emissive meshes: every triangle of an instance whose material emits is a light.

use super::{
    alias_table::{AliasEntry, alias_table},
    equal_or_nan, luminance,
};
use crate::gpu_layout::*;
use bevy::{asset::AssetId, math::Vec3, mesh::Mesh};

/// Everything that the lights of an emissive instance depend on.
#[derive(Clone, Debug)]
pub(super) struct EmissiveMesh {
    pub source: TriangleSource,
    pub mesh: AssetId<Mesh>,
    /// Version of the mesh.
    pub version: u64,
    /// The CPU has a copy of the corners of its triangles.
    pub has_corners: bool,
    /// Mean radiance of the material.
    pub emission: [f32; 3],
    pub double_sided: bool,
    metric: [f32; 6],
}

/// The triangles of an instance, as the records of lights name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct TriangleSource {
    /// Slot of the instance.
    pub slot: u32,
    /// First triangle of the instance in the triangle buffer.
    pub first_triangle: u32,
    pub count: u32,
}

impl TriangleSource {
    /// Records of the triangles behind this header, with the table of the choice among them.
    pub(super) fn lights(self, header: u32, entries: Vec<AliasEntry>) -> impl Iterator<Item = GpuLight> {
        entries.into_iter().zip(self.first_triangle..).map(move |(entry, triangle)| GpuLight {
            kind: LIGHT_TRIANGLE,
            pmf: entry.pmf,
            alias_probability: entry.probability,
            alias_index: entry.alias,
            link: header,
            data: [self.slot, triangle],
            ..Default::default()
        })
    }
}

impl EmissiveMesh {
    /// `mesh`: the mesh, its version, and whether the CPU has a copy of its corners.
    pub(super) fn new(
        slot: u32,
        (mesh, version, has_corners): (AssetId<Mesh>, u64, bool),
        instance: &GpuInstance,
        emission: [f32; 3],
        double_sided: bool,
    ) -> Self {
        let m = &instance.world_from_object;
        let column = |i: usize| Vec3::new(m[0][i], m[1][i], m[2][i]);
        let source = TriangleSource { slot, first_triangle: instance.first_triangle, count: instance.triangle_count };
        Self {
            source,
            mesh,
            version,
            has_corners,
            emission,
            double_sided,
            metric: metric([column(0), column(1), column(2)]),
        }
    }

    /// Whether both have equal triangles with equal powers.  A rigid motion of the instance changes neither.
    pub(super) fn is_unchanged_from(&self, other: &Self) -> bool {
        // A version belongs to one mesh.
        let triangles = |m: &Self| (m.source, m.version, m.has_corners, m.double_sided);
        triangles(self) == triangles(other)
            && equal_or_nan(self.emission, other.emission)
            && has_same_metric(&self.metric, &other.metric)
    }

    /// The table of the choice among the triangles, in proportion to their areas.  Deforming meshes use the areas of the rest pose, so that
    /// their lights are chosen by slightly wrong powers: noise, no bias.
    pub(super) fn build(
        &self,
        corners: impl Iterator<Item = [[f32; 3]; 3]>,
        transform: &Rows,
    ) -> (MeshTable, Vec<AliasEntry>) {
        let areas: Vec<f64> = corners.map(|corners| world_area(transform, &corners)).collect();
        let area = areas.iter().filter(|area| area.is_finite()).sum();
        let entries = alias_table(&areas).unwrap_or_else(|| vec![AliasEntry::default(); areas.len()]);
        (MeshTable { version: self.version, metric: self.metric, area }, entries)
    }

    /// Area of the instance, m²; `None` if the table does not hold for it.  Motions and uniform scales keep the shares of the triangles.
    pub(super) fn area_by(&self, table: &MeshTable) -> Option<f64> {
        let size = |m: &[f32; 6]| m[0] + m[1] + m[2];
        let scale = if self.metric == table.metric { 1.0 } else { size(&self.metric) / size(&table.metric) };
        let is_scaled =
            self.version == table.version && has_same_metric(&self.metric, &table.metric.map(|m| m * scale));
        is_scaled.then_some(table.area * f64::from(scale))
    }

    /// Power of an instance of this area.
    pub(super) fn power(&self, area: f64) -> f64 {
        let sides = if self.double_sided { 2.0 } else { 1.0 };
        core::f64::consts::PI * luminance(self.emission) * sides * area
    }

    /// Number of records in the light table: the bin, the header and the triangles.
    pub(super) fn record_count(&self) -> u64 {
        2 + u64::from(self.source.count)
    }
}

/// Everything that the table of the choice among the triangles of a mesh was built from.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshTable {
    version: u64,
    metric: [f32; 6],
    /// Area of all triangles, m².
    pub area: f64,
}

/// Inner products of a transform's columns.  The areas of transformed triangles depend on nothing else, so a rigid motion changes nothing.
fn metric([x, y, z]: [Vec3; 3]) -> [f32; 6] {
    [x.dot(x), y.dot(y), z.dot(z), x.dot(y), y.dot(z), z.dot(x)]
}

/// Whether two metrics are equal within the rounding errors of a rotation in f32.
fn has_same_metric(a: &[f32; 6], b: &[f32; 6]) -> bool {
    let tolerance = 1e-5 * a[0].max(a[1]).max(a[2]).max(f32::MIN_POSITIVE);
    a.iter().zip(b).all(|(a, b)| a == b || (a - b).abs() <= tolerance)
}

/// Area of a triangle after the transform `m`.
fn world_area(m: &Rows, corners: &[[f32; 3]; 3]) -> f64 {
    let edge = |i: usize| -> [f64; 3] {
        let e: [f64; 3] = core::array::from_fn(|k| corners[i][k] as f64 - corners[0][k] as f64);
        core::array::from_fn(|r| (0..3).map(|k| m[r][k] as f64 * e[k]).sum())
    };
    let (a, b) = (edge(1), edge(2));
    let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    0.5 * c.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Mat3;

    /// An instance with these columns of its transform.
    fn instance(m: Mat3, emission: f32) -> EmissiveMesh {
        let row = |i: usize| [m.x_axis[i], m.y_axis[i], m.z_axis[i], 0.0];
        let instance =
            GpuInstance { world_from_object: [row(0), row(1), row(2)], triangle_count: 2, ..Default::default() };
        EmissiveMesh::new(3, (AssetId::default(), 7, true), &instance, [emission; 3], false)
    }

    #[test]
    fn a_motion_and_a_uniform_scale_keep_the_table_of_a_mesh() {
        let corners = [[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0.0; 3], [0.0, 3.0, 0.0], [0.0, 0.0, 1.0]]];
        let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let mesh = instance(Mat3::IDENTITY, 1.0);
        let (table, entries) = mesh.build(corners.into_iter(), &rows);
        assert!((table.area - 2.0).abs() < 1e-6 && (entries[1].pmf - 0.75).abs() < 1e-6);
        let turned = instance(Mat3::from_rotation_y(1.0) * 0.5, 3.0);
        let area = turned.area_by(&table).expect("the shares are those of the table");
        assert!((area - 0.5).abs() < 1e-5, "{area}");
        assert!((turned.power(area) / mesh.power(2.0) - 0.75).abs() < 1e-5);
        assert!(instance(Mat3::from_diagonal(Vec3::new(1.0, 2.0, 1.0)), 1.0).area_by(&table).is_none());
        assert!(EmissiveMesh { version: 8, ..mesh }.area_by(&table).is_none());
    }

    #[test]
    fn a_rotation_keeps_the_metric_and_a_scale_changes_it() {
        let metric = |m: Mat3| metric([m.x_axis, m.y_axis, m.z_axis]);
        let still = metric(Mat3::from_diagonal(Vec3::splat(0.3)));
        for i in 0..100 {
            assert!(has_same_metric(&metric(Mat3::from_rotation_y(i as f32) * 0.3), &still));
        }
        assert!(!has_same_metric(&metric(Mat3::from_diagonal(Vec3::new(0.3, 0.301, 0.3))), &still));
    }
}
