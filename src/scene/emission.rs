//! What emits: the sources that the light table is made from, their records and their powers.

use super::{extract::AnalyticLight, features::SceneFeatures};
use crate::gpu_types::*;

/// What the table was made from; while it is the same the table is.
#[derive(Clone, Debug)]
pub(super) enum Source {
    Analytic(AnalyticLight),
    Mesh {
        slot: u32,
        version: u64,
        first_triangle: u32,
        count: u32,
        emission: [f32; 3],
        double_sided: bool,
        /// Inner products of the transform's columns: all that a triangle's area depends on, so that a rigid motion changes nothing.
        metric: [f32; 6],
    },
}

impl Source {
    /// Equal but for rounding: a lamp that turns leaves the table alone.
    pub(super) fn same_as(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => a == b,
            (
                Self::Mesh { slot, version, first_triangle, count, emission, double_sided, metric },
                Self::Mesh {
                    slot: slot_b,
                    version: version_b,
                    first_triangle: first_b,
                    count: count_b,
                    emission: emission_b,
                    double_sided: sides_b,
                    metric: metric_b,
                },
            ) => {
                (slot, version, first_triangle, count, emission, double_sided)
                    == (slot_b, version_b, first_b, count_b, emission_b, sides_b)
                    && same_metric(metric, metric_b)
            }
            _ => false,
        }
    }

    /// Equal but for where it is: an analytic light that moves keeps its power.
    pub(super) fn same_elsewhere(&self, other: &Self) -> bool {
        use AnalyticLight::*;
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => match (*a, *b) {
                (Point { intensity: a, .. }, Point { intensity: b, .. }) => a == b,
                (
                    Spot { intensity: a, cos_inner: inner_a, cos_outer: outer_a, .. },
                    Spot { intensity: b, cos_inner: inner_b, cos_outer: outer_b, .. },
                ) => (a, inner_a, outer_a) == (b, inner_b, outer_b),
                (Directional { illuminance: a, .. }, Directional { illuminance: b, .. }) => a == b,
                _ => false,
            },
            _ => self.same_as(other),
        }
    }
}

pub(super) fn luminance(c: [f32; 3]) -> f64 {
    0.2126 * c[0] as f64 + 0.7152 * c[1] as f64 + 0.0722 * c[2] as f64
}

/// Products that differ by what rotating in f32 makes of them.
fn same_metric(a: &[f32; 6], b: &[f32; 6]) -> bool {
    let tolerance = 1e-5 * a[0].max(a[1]).max(a[2]).max(f32::MIN_POSITIVE);
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

pub(super) fn world_area(m: &Rows, corners: &[[f32; 3]; 3]) -> f64 {
    let edge = |i: usize| -> [f64; 3] {
        let e: [f64; 3] = core::array::from_fn(|k| corners[i][k] as f64 - corners[0][k] as f64);
        core::array::from_fn(|r| (0..3).map(|k| m[r][k] as f64 * e[k]).sum())
    };
    let (a, b) = (edge(1), edge(2));
    let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    0.5 * c.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The record, its power, and what it asks of the shaders.
pub(super) fn analytic_light(light: &AnalyticLight, radius: f32) -> (GpuLight, f64, SceneFeatures) {
    use core::f64::consts::PI;
    match *light {
        AnalyticLight::Point { position, intensity } => (
            GpuLight {
                kind: LIGHT_POINT,
                position: position.to_array(),
                emission: intensity.to_array(),
                ..Default::default()
            },
            4.0 * PI * luminance(intensity.to_array()),
            SceneFeatures::LIGHT_POINTS,
        ),
        AnalyticLight::Spot { position, intensity, direction, cos_inner, cos_outer } => (
            GpuLight {
                kind: LIGHT_SPOT,
                position: position.to_array(),
                emission: intensity.to_array(),
                direction: direction.to_array(),
                data: [cos_inner.to_bits(), cos_outer.to_bits()],
                ..Default::default()
            },
            2.0 * PI * (1.0 - 0.5 * (cos_inner + cos_outer) as f64) * luminance(intensity.to_array()),
            SceneFeatures::LIGHT_POINTS,
        ),
        AnalyticLight::Directional { direction, illuminance } => (
            GpuLight {
                kind: LIGHT_DIRECTIONAL,
                direction: direction.to_array(),
                emission: illuminance.to_array(),
                ..Default::default()
            },
            PI * (radius as f64).powi(2) * luminance(illuminance.to_array()),
            SceneFeatures::LIGHT_DIRECTIONAL,
        ),
    }
}

/// Whether a light of this record and power can be drawn.
pub(super) fn is_sound(light: &GpuLight, power: f64) -> bool {
    power.is_finite() && power > 0.0 && is_placed(light)
}

pub(super) fn is_placed(light: &GpuLight) -> bool {
    light.position.iter().chain(&light.direction).all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Vec3;

    #[test]
    fn a_rotation_keeps_the_metric_and_a_scale_changes_it() {
        let metric = |m: bevy::math::Mat3| {
            let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
            [x.dot(x), y.dot(y), z.dot(z), x.dot(y), y.dot(z), z.dot(x)]
        };
        let still = metric(bevy::math::Mat3::from_diagonal(Vec3::splat(0.3)));
        for i in 0..100 {
            assert!(same_metric(&metric(bevy::math::Mat3::from_rotation_y(i as f32) * 0.3), &still));
        }
        assert!(!same_metric(&metric(bevy::math::Mat3::from_diagonal(Vec3::new(0.3, 0.301, 0.3))), &still));
    }
}
