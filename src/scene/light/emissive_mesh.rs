//! Emissive meshes: every triangle of an instance whose material emits is a light.

use super::{equal_or_nan, luminance};
use crate::gpu_layout::*;
use crate::scene::geometry::meshes::{MeshEntry, corner_copies::CornerCopy};
use bevy::{asset::AssetId, math::Vec3, mesh::Mesh};

/// Everything that the lights of an emissive instance depend on.  The light table is rebuilt when it changes.
#[derive(Clone, Debug)]
pub(super) struct EmissiveMesh {
    /// Slot of the instance.
    pub slot: u32,
    /// Version of the mesh.
    pub version: u64,
    /// The mesh.
    pub mesh: AssetId<Mesh>,
    /// The CPU has a copy of the corners of its triangles.
    pub has_corners: bool,
    /// First triangle of the instance in the triangle buffer.
    pub first_triangle: u32,
    pub triangle_count: u32,
    /// Mean radiance of the material.
    pub emission: [f32; 3],
    pub double_sided: bool,
    metric: [f32; 6],
}

impl EmissiveMesh {
    pub(super) fn new(
        slot: u32,
        mesh: (AssetId<Mesh>, &MeshEntry),
        instance: &GpuInstance,
        emission: [f32; 3],
        double_sided: bool,
    ) -> Self {
        let (mesh, MeshEntry { version, corners, .. }) = mesh;
        let m = &instance.world_from_object;
        let column = |i: usize| Vec3::new(m[0][i], m[1][i], m[2][i]);
        Self {
            slot,
            version: *version,
            mesh,
            has_corners: corners.is_some(),
            first_triangle: instance.first_triangle,
            triangle_count: instance.triangle_count,
            emission,
            double_sided,
            metric: metric([column(0), column(1), column(2)]),
        }
    }

    /// Whether both have equal triangles with equal powers.  A rigid motion of the instance changes neither.
    pub(super) fn is_unchanged_from(&self, other: &Self) -> bool {
        // A version belongs to one mesh.
        let Self {
            slot,
            version,
            mesh: _,
            has_corners,
            first_triangle,
            triangle_count,
            emission,
            double_sided,
            metric,
        } = self;
        (*slot, *version, *has_corners, *first_triangle, *triangle_count, *double_sided)
            == (
                other.slot,
                other.version,
                other.has_corners,
                other.first_triangle,
                other.triangle_count,
                other.double_sided,
            )
            && equal_or_nan(*emission, other.emission)
            && has_same_metric(metric, &other.metric)
    }

    /// Lights of these triangles with their powers.  Deforming meshes use the areas of the rest pose, so that their lights are chosen by
    /// slightly wrong powers: noise, no bias.
    pub(super) fn lights<'a>(
        &'a self,
        corners: &'a CornerCopy,
        transform: &'a Rows,
    ) -> impl Iterator<Item = (GpuLight, f64)> + 'a {
        let sides = if self.double_sided { 2.0 } else { 1.0 };
        let exitance = core::f64::consts::PI * luminance(self.emission) * sides;
        corners.corners().enumerate().map(move |(i, corners)| {
            let light = GpuLight {
                kind: LIGHT_TRIANGLE,
                emission: self.emission,
                data: [self.slot, self.first_triangle + i as u32],
                ..Default::default()
            };
            (light, exitance * world_area(transform, &corners))
        })
    }
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
