//! Extracts lights: all of them, in frames in which one of them has changed.

use bevy::{
    camera::visibility::{InheritedVisibility, RenderLayers},
    ecs::{entity_disabling::Disabled, prelude::*, query::QueryFilter, system::SystemParam},
    light::{DirectionalLight, PointLight, RectLight, SpotLight, SunDisk},
    math::{Mat3, Quat, Vec2, Vec3},
    platform::collections::HashMap,
    render::{Extract, sync_world::MainEntity},
    transform::components::GlobalTransform,
};
use core::f32::consts::{FRAC_PI_2, PI};

use super::ExtractedScene;
use crate::cpu_times::{CpuTimes, Stage};
use crate::scene::geometry::render_layers::{ALL_CAMERAS, LayerSets};

/// A light component of Bevy.  A light whose transform has no direction has NaN in it, and the light table leaves it out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum AnalyticLight {
    /// Intensity in candela (lm/4π for white in Rec. 709).  A radius above 0 makes it a sphere.
    Point { position: Vec3, intensity: Vec3, radius: f32 },
    /// A point light with a cone, given by the cosines of its inner and outer half angle.
    Spot { position: Vec3, intensity: Vec3, direction: Vec3, cos_inner: f32, cos_outer: f32 },
    /// Illuminance in lux at normal incidence.  An angular size (diameter in radians) above 0 makes it a disk.
    Directional { direction: Vec3, illuminance: Vec3, angular_size: f32 },
    /// Luminous power in lumens, emitted along -Z of the rotation by a rectangle of this size.
    Rect { position: Vec3, rotation: Quat, power: Vec3, size: Vec2 },
}

impl AnalyticLight {
    fn point(light: &PointLight, transform: &GlobalTransform) -> Self {
        let intensity = bounded(rgb(light.color) * (light.intensity / (4.0 * PI)));
        Self::Point { position: transform.translation(), intensity, radius: light.radius }
    }

    fn spot(light: &SpotLight, transform: &GlobalTransform) -> Self {
        // Bevy limits cones in the same way.  NaN stays, so that the light table leaves the light out.
        let outer = if light.outer_angle >= FRAC_PI_2 { FRAC_PI_2 - 1e-4 } else { light.outer_angle };
        let inner = if light.inner_angle > outer { outer } else { light.inner_angle };
        Self::Spot {
            position: transform.translation(),
            intensity: bounded(rgb(light.color) * (light.intensity / (4.0 * PI))),
            direction: forward(transform),
            cos_inner: inner.cos(),
            cos_outer: outer.cos(),
        }
    }

    fn directional(light: &DirectionalLight, disk: Option<&SunDisk>, transform: &GlobalTransform) -> Self {
        let illuminance = bounded(rgb(light.color) * light.illuminance);
        // Bevy draws no disk where `SunDisk::intensity` is 0.  Other values only change how bright Bevy draws it, not the illuminance.
        let angular_size = disk.map_or(0.0, |disk| if disk.intensity == 0.0 { 0.0 } else { disk.angular_size });
        Self::Directional { direction: forward(transform), illuminance, angular_size }
    }

    fn rect(light: &RectLight, transform: &GlobalTransform) -> Self {
        let (x, y, rotation) = rect_axes(transform);
        Self::Rect {
            position: transform.translation(),
            rotation,
            power: bounded(rgb(light.color) * light.intensity),
            size: Vec2::new(light.width * x, light.height * y),
        }
    }

    /// Whether it is a sun with a disk.  These come first in the light table, so that shaders can test a ray against all of them.
    pub(crate) fn is_sun(&self) -> bool {
        matches!(self, Self::Directional { illuminance, angular_size, .. }
            if is_size(*angular_size) && is_radiance(disk_radiance(*illuminance, *angular_size)))
    }
}

/// Greatest intensity, illuminance, power or radiance of lights, emissive surfaces and environments.  Products of one of them and a few other
/// numbers must not overflow.
pub(crate) const MAX_LIGHT: f32 = 1e30;

/// A light's brightness, at most [`MAX_LIGHT`].  Brightness that is not finite stays as it is, so that the light table leaves the light out.
fn bounded(brightness: Vec3) -> Vec3 {
    brightness.to_array().map(|c| if c.is_finite() { c.min(MAX_LIGHT) } else { c }).into()
}

/// Whether shaders can use a radiance.
pub(crate) fn is_radiance(radiance: Vec3) -> bool {
    radiance.to_array().iter().all(|c| *c <= MAX_LIGHT)
}

/// Radiance of a disk of this angular size (diameter in radians) with this illuminance at normal incidence: E/(π sin²).
pub(crate) fn disk_radiance(illuminance: Vec3, angular_size: f32) -> Vec3 {
    let sine = (0.5 * f64::from(angular_size).min(core::f64::consts::PI)).sin();
    illuminance.to_array().map(|e| (f64::from(e) / (core::f64::consts::PI * sine * sine)) as f32).into()
}

/// Whether a radius or length describes an extent: positive and finite.
pub(crate) fn is_size(size: f32) -> bool {
    size > 0.0 && size.is_finite()
}

type LightData<'a, L> = (Entity, &'a L, &'a GlobalTransform, &'a InheritedVisibility);
type SunData<'a> = (Entity, &'a DirectionalLight, Option<&'a SunDisk>, &'a GlobalTransform, &'a InheritedVisibility);

/// The lights of the main world.
#[derive(SystemParam)]
pub(crate) struct Lights<'w, 's> {
    points: Query<'w, 's, LightData<'static, PointLight>>,
    spots: Query<'w, 's, LightData<'static, SpotLight>>,
    suns: Query<'w, 's, SunData<'static>>,
    rects: Query<'w, 's, LightData<'static, RectLight>>,
    layers: Query<'w, 's, &'static RenderLayers>,
}

impl Lights<'_, '_> {
    /// Numbers of lights, which change where one was removed.
    fn counts(&self) -> [usize; 4] {
        [self.points.iter().len(), self.spots.iter().len(), self.suns.iter().len(), self.rects.iter().len()]
    }

    /// The lights that some camera sees, in the order of the list, and the cameras that do not see them.
    fn seen(&self, sets: &LayerSets) -> (Vec<(MainEntity, AnalyticLight)>, HashMap<MainEntity, u32>) {
        let mut lights: Vec<_> = self.visible().map(|(entity, light)| (entity.into(), light)).collect();
        lights.sort_unstable_by_key(|(entity, light): &(MainEntity, _)| (!light.is_sun(), *entity));
        // As in Bevy, a light illuminates what a camera sees only if it shares a render layer with the camera.
        let mut hidden = HashMap::default();
        lights.retain(|(entity, _)| {
            let camera_mask = sets.camera_mask(self.layers.get(**entity).ok());
            if camera_mask != 0 && camera_mask != ALL_CAMERAS {
                hidden.insert(*entity, ALL_CAMERAS & !camera_mask);
            }
            camera_mask != 0
        });
        (lights, hidden)
    }

    /// The visible lights, in no particular order.
    fn visible(&self) -> impl Iterator<Item = (Entity, AnalyticLight)> {
        let points =
            self.points.iter().filter(|row| row.3.get()).map(|row| (row.0, AnalyticLight::point(row.1, row.2)));
        let spots = self.spots.iter().filter(|row| row.3.get()).map(|row| (row.0, AnalyticLight::spot(row.1, row.2)));
        let suns = self.suns.iter().filter(|row| row.4.get());
        let suns = suns.map(|row| (row.0, AnalyticLight::directional(row.1, row.2, row.3)));
        let rects = self.rects.iter().filter(|row| row.3.get()).map(|row| (row.0, AnalyticLight::rect(row.1, row.2)));
        points.chain(spots).chain(suns).chain(rects)
    }
}

type AnyLight = Or<(With<PointLight>, With<SpotLight>, With<DirectionalLight>, With<RectLight>)>;

type Touched<L> = Or<(Changed<L>, Changed<GlobalTransform>, Changed<InheritedVisibility>, Changed<RenderLayers>)>;

/// The changes of components that lights depend on.
#[derive(SystemParam)]
pub(crate) struct LightChanges<'w, 's> {
    points: Query<'w, 's, (), (With<PointLight>, Touched<PointLight>)>,
    spots: Query<'w, 's, (), (With<SpotLight>, Touched<SpotLight>)>,
    suns: Query<'w, 's, (), (With<DirectionalLight>, Or<(Changed<SunDisk>, Touched<DirectionalLight>)>)>,
    rects: Query<'w, 's, (), (With<RectLight>, Touched<RectLight>)>,
    /// Queries that do not name `Disabled` leave these lights out.
    disabled: Query<'w, 's, (), (AnyLight, Added<Disabled>)>,
    enabled: RemovedComponents<'w, 's, Disabled>,
    removed_disks: RemovedComponents<'w, 's, SunDisk>,
    removed_layers: RemovedComponents<'w, 's, RenderLayers>,
}

impl LightChanges<'_, '_> {
    /// Whether some light has changed since the last call.
    fn any(&mut self) -> bool {
        // All must be read in each frame, or a later frame would see old removals.
        let removed =
            self.removed_disks.read().count() + self.removed_layers.read().count() + self.enabled.read().count() > 0;
        removed
            || has_any(&self.disabled)
            || has_any(&self.points)
            || has_any(&self.spots)
            || has_any(&self.suns)
            || has_any(&self.rects)
    }
}

fn has_any<F: QueryFilter>(changed: &Query<(), F>) -> bool {
    changed.iter().next().is_some()
}

/// The inputs of the list of lights, apart from the components.
#[derive(Default, PartialEq)]
pub(crate) struct LightSources {
    counts: [usize; 4],
    layers: u64,
}

/// Extracts the lights that at least one camera sees, if any has changed: suns with a disk first, then in the order of their entities.
pub(crate) fn extract_lights(
    mut scene: ResMut<ExtractedScene>,
    all: Extract<Lights>,
    mut changes: Extract<LightChanges>,
    sets: Res<LayerSets>,
    mut last: Local<LightSources>,
    times: Res<CpuTimes>,
) {
    let _running = times.measure(Stage::ExtractLights);
    let sources = LightSources { counts: all.counts(), layers: sets.revision };
    let any_changed = changes.any();
    if !scene.is_new && !any_changed && *last == sources {
        return;
    }
    *last = sources;
    scene.lights_changed = true;
    (scene.lights, scene.hidden_lights) = all.seen(&sets);
}

/// Panics if a light differs from what the main world has.
#[cfg(feature = "testing")]
pub(crate) fn check_lights(
    scene: Res<ExtractedScene>,
    all: Extract<Lights>,
    sets: Res<LayerSets>,
    wanted: Option<Res<super::instances::CheckMirror>>,
) {
    if wanted.is_some() {
        let (lights, hidden) = all.seen(&sets);
        // NaN differs from itself, but not from its text.
        assert_eq!(format!("{:?}", scene.lights), format!("{lights:?}"));
        assert_eq!(scene.hidden_lights, hidden);
    }
}

/// The direction in which a light points; NaN if the transform is degenerate.
fn forward(transform: &GlobalTransform) -> Vec3 {
    transform.affine().transform_vector3(Vec3::NEG_Z).try_normalize().unwrap_or(Vec3::NAN)
}

/// Scale along x and y, and the rotation, which has NaN if the transform is degenerate.
fn rect_axes(transform: &GlobalTransform) -> (f32, f32, Quat) {
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| transform.affine().transform_vector3(axis));
    // The rectangle stays in the plane of its sides, and keeps the direction of the x axis.  A mirrored rectangle equals the rectangle.
    let normal = x.cross(y).try_normalize().unwrap_or(Vec3::NAN);
    let z_axis = if z.dot(normal) < 0.0 { -normal } else { normal };
    let x_axis = x.try_normalize().unwrap_or(Vec3::NAN);
    let axes = Mat3::from_cols(x_axis, z_axis.cross(x_axis), z_axis);
    let rotation =
        if axes.is_finite() { Quat::from_mat3(&axes).normalize() } else { Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0) };
    (x.length(), y.length(), rotation)
}

/// The linear color without negative components, which would subtract light.  NaN is kept, so that the light table leaves the light out.
fn rgb(color: bevy::color::Color) -> Vec3 {
    let c = color.to_linear();
    [c.red, c.green, c.blue].map(|c| if c < 0.0 { 0.0 } else { c }).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::transform::components::Transform;
    use core::f32::consts::FRAC_PI_4;

    #[test]
    fn a_rectangle_stays_in_the_plane_of_its_sides() {
        for scale in [Vec3::new(1.0, 1.0, 3.0), Vec3::new(2.0, 0.5, 1.0)] {
            let parent = GlobalTransform::from(Transform::from_scale(scale));
            let transform = parent * Transform::from_rotation(Quat::from_rotation_x(FRAC_PI_4));
            let (width, height, rotation) = rect_axes(&transform);
            let [x, y] = [Vec3::X, Vec3::Y].map(|axis| transform.affine().transform_vector3(axis));
            assert!((rotation * Vec3::X * width - x).length() < 1e-5, "{scale}");
            assert!((rotation * Vec3::Y * height - y).length() < 1e-5, "{scale}");
        }
    }
}
