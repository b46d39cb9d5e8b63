//! What emits: the sources that the light table is made from, their records and their powers.

use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::Bounds,
    extract::{AnalyticLight, is_size},
    features::SceneFeatures,
};
use bevy::math::{DMat3, DQuat, Quat, Vec3};

/// What the table was made from; while it is the same the table is.
#[derive(Clone, Debug)]
pub(crate) enum Source {
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
    pub(crate) fn same_as(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => same_place(a, b) && same_light(a, b),
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
                (slot, version, first_triangle, count, double_sided) == (slot_b, version_b, first_b, count_b, sides_b)
                    && same(*emission, *emission_b)
                    && same_metric(metric, metric_b)
            }
            _ => false,
        }
    }

    /// Equal but for where it is: an analytic light that moves keeps its power.
    pub(crate) fn same_elsewhere(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Analytic(a), Self::Analytic(b)) => same_light(a, b),
            _ => self.same_as(other),
        }
    }
}

/// Whether two analytic lights of one kind are in one place.
fn same_place(a: &AnalyticLight, b: &AnalyticLight) -> bool {
    use AnalyticLight::*;
    match (*a, *b) {
        (Point { position: a, .. }, Point { position: b, .. }) => same(a.to_array(), b.to_array()),
        (Spot { position: a, direction: to_a, .. }, Spot { position: b, direction: to_b, .. }) => {
            same(a.to_array(), b.to_array()) && same(to_a.to_array(), to_b.to_array())
        }
        (Directional { direction: a, .. }, Directional { direction: b, .. }) => same(a.to_array(), b.to_array()),
        (Rect { position: a, rotation: turn_a, .. }, Rect { position: b, rotation: turn_b, .. }) => {
            same(a.to_array(), b.to_array()) && same(turn_a.to_array(), turn_b.to_array())
        }
        _ => false,
    }
}

/// Whether two analytic lights are the same wherever they are.
fn same_light(a: &AnalyticLight, b: &AnalyticLight) -> bool {
    use AnalyticLight::*;
    match (*a, *b) {
        (Point { intensity: a, radius: radius_a, .. }, Point { intensity: b, radius: radius_b, .. }) => {
            same(a.to_array(), b.to_array()) && same([radius_a], [radius_b])
        }
        (
            Spot { intensity: a, cos_inner: inner_a, cos_outer: outer_a, .. },
            Spot { intensity: b, cos_inner: inner_b, cos_outer: outer_b, .. },
        ) => same(a.to_array(), b.to_array()) && same([inner_a, outer_a], [inner_b, outer_b]),
        (
            Directional { illuminance: a, angular_size: size_a, .. },
            Directional { illuminance: b, angular_size: size_b, .. },
        ) => same(a.to_array(), b.to_array()) && same([size_a], [size_b]),
        (Rect { power: a, size: size_a, .. }, Rect { power: b, size: size_b, .. }) => {
            same(a.to_array(), b.to_array()) && same(size_a.to_array(), size_b.to_array())
        }
        _ => false,
    }
}

/// Numbers that are the same, NaN or not: what is left out for its NaN changes no more than others do.
fn same<const N: usize>(a: [f32; N], b: [f32; N]) -> bool {
    a.iter().zip(&b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

pub(crate) fn luminance(c: [f32; 3]) -> f64 {
    0.2126 * c[0] as f64 + 0.7152 * c[1] as f64 + 0.0722 * c[2] as f64
}

/// Products that differ by what rotating in f32 makes of them.
fn same_metric(a: &[f32; 6], b: &[f32; 6]) -> bool {
    let tolerance = 1e-5 * a[0].max(a[1]).max(a[2]).max(f32::MIN_POSITIVE);
    a.iter().zip(b).all(|(a, b)| a == b || (a - b).abs() <= tolerance)
}

pub(crate) fn world_area(m: &Rows, corners: &[[f32; 3]; 3]) -> f64 {
    let edge = |i: usize| -> [f64; 3] {
        let e: [f64; 3] = core::array::from_fn(|k| corners[i][k] as f64 - corners[0][k] as f64);
        core::array::from_fn(|r| (0..3).map(|k| m[r][k] as f64 * e[k]).sum())
    };
    let (a, b) = (edge(1), edge(2));
    let c = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    0.5 * c.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The record, its power, and what it asks of the shaders.
pub(crate) fn analytic_light(light: &AnalyticLight, radius: f32) -> (GpuLight, f64, SceneFeatures) {
    use core::f64::consts::PI;
    match *light {
        AnalyticLight::Point { position, intensity, radius } if is_ball(intensity, radius) => (
            GpuLight {
                kind: LIGHT_SPHERE,
                position: position.to_array(),
                emission: ball_radiance(intensity, radius).to_array(),
                data: [radius.to_bits(), 0],
                ..Default::default()
            },
            4.0 * PI * luminance(intensity.to_array()),
            SceneFeatures::LIGHT_SPHERES | SceneFeatures::LIGHT_SHAPES,
        ),
        AnalyticLight::Point { position, intensity, .. } => (
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
        AnalyticLight::Rect { position, rotation, power, size } => {
            let area = size.x as f64 * size.y as f64;
            let m = rotation_parameters(rotation);
            let radiance = power.to_array().map(|p| (p as f64 / (PI * area)) as f32);
            let is_rect = is_size(size.x) && is_size(size.y) && radiance.iter().all(|r| r.is_finite());
            (
                GpuLight {
                    kind: LIGHT_RECT,
                    position: position.to_array(),
                    emission: radiance,
                    direction: m.to_array(),
                    data: [(0.5 * size.x).to_bits(), (0.5 * size.y).to_bits()],
                    ..Default::default()
                },
                if is_rect { luminance(power.to_array()) } else { 0.0 },
                SceneFeatures::LIGHT_RECTS | SceneFeatures::LIGHT_SHAPES,
            )
        }
        AnalyticLight::Directional { direction, illuminance, angular_size } if light.is_sun() => {
            // 1 - cosine of the rim; the irradiance of the disc is π sin² of its half angle times its radiance.
            let half_angle = 0.5 * (angular_size as f64).min(PI);
            let rim = 2.0 * (0.5 * half_angle).sin().powi(2);
            let radiance = illuminance.to_array().map(|e| (e as f64 / (PI * half_angle.sin().powi(2))) as f32);
            (
                GpuLight {
                    kind: LIGHT_SUN,
                    direction: direction.to_array(),
                    emission: radiance,
                    data: [(rim as f32).to_bits(), 0],
                    ..Default::default()
                },
                PI * (radius as f64).powi(2) * luminance(illuminance.to_array()),
                SceneFeatures::SUN_DISK | SceneFeatures::LIGHT_SHAPES,
            )
        }
        AnalyticLight::Directional { direction, illuminance, .. } => (
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

/// What is wrong with a light, and what becomes of it.
pub(crate) fn flaw(light: &AnalyticLight) -> Option<String> {
    match *light {
        AnalyticLight::Point { radius, .. } if radius != 0.0 && !is_size(radius) => {
            Some(format!("the radius {radius}; it is taken for a point"))
        }
        AnalyticLight::Directional { angular_size, .. } if angular_size != 0.0 && !is_size(angular_size) => {
            Some(format!("a disc of the angular size {angular_size}; it has none"))
        }
        AnalyticLight::Directional { angular_size, .. } if angular_size > core::f32::consts::PI * 1.000_001 => {
            Some(format!("a disc of the angular size {angular_size}; it has one of half the sky"))
        }
        AnalyticLight::Rect { size, .. } if !is_size(size.x) || !is_size(size.y) => {
            Some(format!("the size {} x {}; it is left out", size.x, size.y))
        }
        _ => None,
    }
}

/// Whether a point light has an extent that f32 can tell from a point.
fn is_ball(intensity: Vec3, radius: f32) -> bool {
    is_size(radius) && radius > 1e-9 && radius < 1e9 && ball_radiance(intensity, radius).max_element() < 1e30
}

/// A sphere of radiance I/(πr²) has the intensity I to every side.
fn ball_radiance(intensity: Vec3, radius: f32) -> Vec3 {
    let area = core::f64::consts::PI * (radius as f64).powi(2);
    intensity.to_array().map(|i| (i as f64 / area) as f32).into()
}

/// Modified Rodrigues parameters of a rotation: within the unit ball, and without a place where digits are lost.
fn rotation_parameters(q: Quat) -> Vec3 {
    let q = if q.w < 0.0 { -q } else { q };
    Vec3::new(q.x, q.y, q.z) / (1.0 + q.w)
}

/// The box of a light that rays may meet on their way.
pub(crate) fn shape_bounds(light: &GpuLight) -> Option<Bounds> {
    let reach = match light.kind & LIGHT_KIND_BITS {
        LIGHT_SPHERE => [f64::from(f32::from_bits(light.data[0])); 3],
        LIGHT_RECT => {
            let half = light.data.map(|bits| f64::from(f32::from_bits(bits)));
            let turned = DMat3::from_quat(rotation_of(light.direction.map(f64::from)));
            core::array::from_fn(|k| (0..2).map(|i| turned.col(i)[k].abs() * half[i]).sum())
        }
        _ => return None,
    };
    // The center's digits, and those of the rotation in the shader.
    let slack = |k: usize| 1e-6 * (reach.iter().sum::<f64>() + f64::from(light.position[k]).abs());
    let low = core::array::from_fn(|k| (f64::from(light.position[k]) - reach[k] - slack(k)) as f32);
    let high = core::array::from_fn(|k| (f64::from(light.position[k]) + reach[k] + slack(k)) as f32);
    Some((low, high))
}

fn rotation_of(m: [f64; 3]) -> DQuat {
    let square: f64 = m.iter().map(|x| x * x).sum();
    DQuat::from_xyzw(2.0 * m[0], 2.0 * m[1], 2.0 * m[2], 1.0 - square).normalize()
}

/// Whether a light of this record and power can be drawn.
pub(crate) fn is_sound(light: &GpuLight, power: f64) -> bool {
    power.is_finite() && power > 0.0 && is_placed(light)
}

pub(crate) fn is_placed(light: &GpuLight) -> bool {
    light.position.iter().chain(&light.direction).all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn rotations_survive_their_three_parameters() {
        for i in 0..1000 {
            let x = i as f32;
            // Half turns and the identity among them.
            let quarter = core::f32::consts::FRAC_PI_2;
            let q = match i % 3 {
                0 => Quat::from_euler(bevy::math::EulerRot::XYZ, x, 1.7 * x, 0.3 * x),
                1 => Quat::from_rotation_y((i % 8) as f32 * quarter) * Quat::from_rotation_x((i % 5) as f32 * quarter),
                _ => -Quat::from_rotation_z(x),
            };
            let m = rotation_parameters(q);
            assert!(m.length() <= 1.0 + 1e-6);
            let back = rotation_of(m.to_array().map(f64::from));
            let off = back.angle_between(DQuat::from_array(q.to_array().map(f64::from)).normalize());
            assert!(off < 1e-6, "{q} came back by {off} otherwise");
        }
    }
}
