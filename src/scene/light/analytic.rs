//! Analytic lights: converts Bevy's point, spot, directional and rectangular lights to records of the light table.
//!
//! A light with an extent (a sphere, a rectangle or a sun) is recorded with its radiance, which rays that hit it return.  A light without
//! an extent is recorded with its intensity or illuminance.

use bevy::{
    log::warn,
    math::{DMat3, DQuat, Quat, Vec2, Vec3},
    render::sync_world::MainEntity,
};
use core::f64::consts::PI;

use super::{equal_or_nan, luminance};
use crate::gpu_layout::*;
use crate::scene::{
    accel::blas::Bounds,
    accel::tlas::MAX_COORDINATE,
    extract::lights::{AnalyticLight, disk_radiance, is_radiance, is_size},
    features::SceneFeatures,
};
use crate::warned::Warned;

/// A light as the table and the shaders need it.
pub(super) struct AnalyticRecord {
    pub light: GpuLight,
    /// Power by luminance, which weighs the light against the others of the table.  0 if the light has no usable extent.
    pub power: f64,
    /// Features that its shaders need.
    pub features: SceneFeatures,
}

impl AnalyticRecord {
    /// Record of a light in a scene of this radius, which bounds the area that a directional light illuminates.
    pub(super) fn new(light: &AnalyticLight, scene_radius: f32) -> Self {
        match *light {
            AnalyticLight::Point { position, intensity, radius } if is_sphere(intensity, radius) => {
                sphere(position, intensity, radius)
            }
            AnalyticLight::Point { position, intensity, .. } => point(position, intensity),
            AnalyticLight::Spot { position, intensity, direction, cos_inner, cos_outer } => {
                spot(position, intensity, direction, [cos_inner, cos_outer])
            }
            AnalyticLight::Rect { position, rotation, power, size } => rect(position, rotation, power, size),
            AnalyticLight::Directional { direction, illuminance, angular_size } if light.is_sun() => {
                sun(direction, illuminance, angular_size, scene_radius)
            }
            AnalyticLight::Directional { direction, illuminance, .. } => {
                directional(direction, illuminance, scene_radius)
            }
        }
    }

    /// Whether the light table can contain this light.
    pub(super) fn can_be_sampled(&self) -> bool {
        self.power.is_finite() && self.power > 0.0 && self.has_finite_transform()
    }

    /// Whether the light is within [`MAX_COORDINATE`] of the origin and has a direction.
    pub(super) fn has_finite_transform(&self) -> bool {
        self.light.position.iter().all(|x| x.abs() < MAX_COORDINATE)
            && self.light.direction.iter().all(|x| x.is_finite())
    }
}

fn sphere(position: Vec3, intensity: Vec3, radius: f32) -> AnalyticRecord {
    AnalyticRecord {
        light: GpuLight {
            kind: LIGHT_SPHERE,
            position: position.to_array(),
            emission: sphere_radiance(intensity, radius).to_array(),
            data: [radius.to_bits(), 0],
            ..Default::default()
        },
        power: 4.0 * PI * luminance(intensity.to_array()),
        features: SceneFeatures::LIGHT_SPHERES | SceneFeatures::LIGHT_SHAPES,
    }
}

fn point(position: Vec3, intensity: Vec3) -> AnalyticRecord {
    AnalyticRecord {
        light: GpuLight {
            kind: LIGHT_POINT,
            position: position.to_array(),
            emission: intensity.to_array(),
            ..Default::default()
        },
        power: 4.0 * PI * luminance(intensity.to_array()),
        features: SceneFeatures::LIGHT_POINTS,
    }
}

fn spot(position: Vec3, intensity: Vec3, direction: Vec3, [cos_inner, cos_outer]: [f32; 2]) -> AnalyticRecord {
    AnalyticRecord {
        light: GpuLight {
            kind: LIGHT_SPOT,
            position: position.to_array(),
            emission: intensity.to_array(),
            direction: direction.to_array(),
            data: [cos_inner.to_bits(), cos_outer.to_bits()],
            ..Default::default()
        },
        power: 2.0 * PI * (1.0 - 0.5 * (cos_inner + cos_outer) as f64) * luminance(intensity.to_array()),
        features: SceneFeatures::LIGHT_POINTS,
    }
}

/// Radiance of a rectangle of this size and power; `None` if rays cannot hit such a rectangle.
fn rect_radiance(power: Vec3, size: Vec2) -> Option<Vec3> {
    let area = size.x as f64 * size.y as f64;
    let radiance = power.to_array().map(|p| (p as f64 / (PI * area)) as f32).into();
    let has_extent = |side: f32| is_size(side) && side < MAX_COORDINATE;
    (has_extent(size.x) && has_extent(size.y) && is_radiance(radiance)).then_some(radiance)
}

fn rect(position: Vec3, rotation: Quat, power: Vec3, size: Vec2) -> AnalyticRecord {
    let radiance = rect_radiance(power, size);
    AnalyticRecord {
        light: GpuLight {
            kind: LIGHT_RECT,
            position: position.to_array(),
            emission: radiance.unwrap_or_default().to_array(),
            direction: rotation_parameters(rotation).to_array(),
            data: [(0.5 * size.x).to_bits(), (0.5 * size.y).to_bits()],
            ..Default::default()
        },
        // A power that is not finite is kept, for the warning.
        power: if radiance.is_some() || !power.is_finite() { luminance(power.to_array()) } else { 0.0 },
        features: SceneFeatures::LIGHT_RECTS | SceneFeatures::LIGHT_SHAPES,
    }
}

fn sun(direction: Vec3, illuminance: Vec3, angular_size: f32, scene_radius: f32) -> AnalyticRecord {
    // The shader reads 1 - cos(half angle).
    let one_minus_cos = 2.0 * (0.25 * (angular_size as f64).min(PI)).sin().powi(2);
    AnalyticRecord {
        light: GpuLight {
            kind: LIGHT_SUN,
            direction: direction.to_array(),
            emission: disk_radiance(illuminance, angular_size).to_array(),
            data: [(one_minus_cos as f32).to_bits(), 0],
            ..Default::default()
        },
        power: PI * (scene_radius as f64).powi(2) * luminance(illuminance.to_array()),
        features: SceneFeatures::SUN_DISK | SceneFeatures::LIGHT_SHAPES,
    }
}

fn directional(direction: Vec3, illuminance: Vec3, scene_radius: f32) -> AnalyticRecord {
    AnalyticRecord {
        light: GpuLight {
            kind: LIGHT_DIRECTIONAL,
            direction: direction.to_array(),
            emission: illuminance.to_array(),
            ..Default::default()
        },
        power: PI * (scene_radius as f64).powi(2) * luminance(illuminance.to_array()),
        features: SceneFeatures::LIGHT_DIRECTIONAL,
    }
}

/// Whether two lights of one kind have the same position and orientation.
pub(super) fn has_same_placement(a: &AnalyticLight, b: &AnalyticLight) -> bool {
    use AnalyticLight::*;
    match (*a, *b) {
        (Point { position: a, .. }, Point { position: b, .. }) => equal_or_nan(a.to_array(), b.to_array()),
        (Spot { position: a, direction: to_a, .. }, Spot { position: b, direction: to_b, .. }) => {
            equal_or_nan(a.to_array(), b.to_array()) && equal_or_nan(to_a.to_array(), to_b.to_array())
        }
        (Directional { direction: a, .. }, Directional { direction: b, .. }) => {
            equal_or_nan(a.to_array(), b.to_array())
        }
        (Rect { position: a, rotation: turn_a, .. }, Rect { position: b, rotation: turn_b, .. }) => {
            equal_or_nan(a.to_array(), b.to_array()) && equal_or_nan(turn_a.to_array(), turn_b.to_array())
        }
        _ => false,
    }
}

/// Whether two lights have the same kind, emission and extent, wherever they are.
pub(super) fn has_same_emission(a: &AnalyticLight, b: &AnalyticLight) -> bool {
    use AnalyticLight::*;
    match (*a, *b) {
        (Point { intensity: a, radius: radius_a, .. }, Point { intensity: b, radius: radius_b, .. }) => {
            equal_or_nan(a.to_array(), b.to_array()) && equal_or_nan([radius_a], [radius_b])
        }
        (
            Spot { intensity: a, cos_inner: inner_a, cos_outer: outer_a, .. },
            Spot { intensity: b, cos_inner: inner_b, cos_outer: outer_b, .. },
        ) => equal_or_nan(a.to_array(), b.to_array()) && equal_or_nan([inner_a, outer_a], [inner_b, outer_b]),
        (
            Directional { illuminance: a, angular_size: size_a, .. },
            Directional { illuminance: b, angular_size: size_b, .. },
        ) => equal_or_nan(a.to_array(), b.to_array()) && equal_or_nan([size_a], [size_b]),
        (Rect { power: a, size: size_a, .. }, Rect { power: b, size: size_b, .. }) => {
            equal_or_nan(a.to_array(), b.to_array()) && equal_or_nan(size_a.to_array(), size_b.to_array())
        }
        _ => false,
    }
}

/// Warns once about a light with invalid values.
pub(super) fn warn_about(
    entity: MainEntity,
    light: &AnalyticLight,
    record: &AnalyticRecord,
    warned: &mut Warned<MainEntity>,
) {
    if let Some(problem) = invalid_extent(light)
        && warned.is_due(entity)
    {
        warn!("restir: light {} has {problem}", *entity);
    }
    // A black light is ordinary; infinite and negative powers are errors of the app.
    let is_placed = record.has_finite_transform();
    let is_wrong = !record.can_be_sampled() && (record.power != 0.0 || !is_placed);
    if !is_wrong || !warned.is_due(entity) {
        return;
    }
    if is_placed {
        warn!("restir: light {} has the invalid power {}; it is not rendered", *entity, record.power);
    } else {
        warn!("restir: light {} has a transform that is not finite or too far away; it is not rendered", *entity);
    }
}

/// Describes an invalid extent of a light and its consequence, to follow "light {entity} has " in a warning.
fn invalid_extent(light: &AnalyticLight) -> Option<String> {
    match *light {
        AnalyticLight::Point { radius, .. } if radius != 0.0 && !is_size(radius) => {
            Some(format!("the radius {radius}, which is not a positive finite number; it becomes a point light"))
        }
        AnalyticLight::Directional { angular_size, .. } if angular_size != 0.0 && !is_size(angular_size) => {
            Some(format!(
                "a disk whose angular size is {angular_size}, which is not a positive finite number; it is rendered without a disk"
            ))
        }
        AnalyticLight::Directional { angular_size, .. } if angular_size > core::f32::consts::PI * 1.000_001 => {
            Some(format!("a disk whose angular size is {angular_size}, more than half the sky; π is used"))
        }
        AnalyticLight::Rect { size, power, .. } if power.is_finite() && rect_radiance(power, size).is_none() => {
            Some(format!(
                "the size {} x {}, which is not two positive finite numbers or too small or large for its power; it is not rendered",
                size.x, size.y
            ))
        }
        _ => None,
    }
}

/// Whether a point light is rendered as a sphere: f32 can tell its extent from a point and hold its radiance.
fn is_sphere(intensity: Vec3, radius: f32) -> bool {
    is_size(radius) && radius > 1e-9 && radius < 1e9 && is_radiance(sphere_radiance(intensity, radius))
}

/// Radiance of a sphere whose intensity is I in every direction: I/(πr²).
fn sphere_radiance(intensity: Vec3, radius: f32) -> Vec3 {
    let area = PI * (radius as f64).powi(2);
    intensity.to_array().map(|i| (i as f64 / area) as f32).into()
}

/// Modified Rodrigues parameters of a rotation.  They lie in the unit ball and have no singularity there, so they keep full precision.
fn rotation_parameters(q: Quat) -> Vec3 {
    let q = if q.w < 0.0 { -q } else { q };
    Vec3::new(q.x, q.y, q.z) / (1.0 + q.w)
}

/// Bounding box of a light that rays can hit; `None` for points, spots and lights at infinity.
pub(super) fn shape_bounds(light: &GpuLight) -> Option<Bounds> {
    let reach = match light.kind & LIGHT_KIND_BITS {
        LIGHT_SPHERE => [f64::from(f32::from_bits(light.data[0])); 3],
        LIGHT_RECT => {
            let half = light.data.map(|bits| f64::from(f32::from_bits(bits)));
            let axes = DMat3::from_quat(rotation_of(light.direction.map(f64::from)));
            core::array::from_fn(|k| (0..2).map(|i| axes.col(i)[k].abs() * half[i]).sum())
        }
        _ => return None,
    };
    // Covers the rounding of the center, and of the rotation in the shader.
    let slack = |k: usize| 1e-6 * (reach.iter().sum::<f64>() + f64::from(light.position[k]).abs());
    let low = core::array::from_fn(|k| (f64::from(light.position[k]) - reach[k] - slack(k)) as f32);
    let high = core::array::from_fn(|k| (f64::from(light.position[k]) + reach[k] + slack(k)) as f32);
    Some((low, high))
}

/// Inverse of [`rotation_parameters`].
fn rotation_of(m: [f64; 3]) -> DQuat {
    let square: f64 = m.iter().map(|x| x * x).sum();
    DQuat::from_xyzw(2.0 * m[0], 2.0 * m[1], 2.0 * m[2], 1.0 - square).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_survive_their_three_parameters() {
        for i in 0..1000 {
            let x = i as f32;
            // Half turns and the identity are among them.
            let quarter = core::f32::consts::FRAC_PI_2;
            let q = match i % 3 {
                0 => Quat::from_euler(bevy::math::EulerRot::XYZ, x, 1.7 * x, 0.3 * x),
                1 => Quat::from_rotation_y((i % 8) as f32 * quarter) * Quat::from_rotation_x((i % 5) as f32 * quarter),
                _ => -Quat::from_rotation_z(x),
            };
            let m = rotation_parameters(q);
            assert!(m.length() <= 1.0 + 1e-6);
            let back = rotation_of(m.to_array().map(f64::from));
            let error = back.angle_between(DQuat::from_array(q.to_array().map(f64::from)).normalize());
            assert!(error < 1e-6, "{q} came back with an error of {error} radians");
        }
    }
}
