//! A sky for scenes that bring no light.

use bevy::{
    ecs::system::{RunSystemOnce, SystemParam},
    prelude::*,
};
use bevy_restir::RestirEnvironment;

use crate::environment::equirectangular;

/// The lights of a scene, and the surfaces that are visible without light: emissive and unlit ones.
#[derive(SystemParam)]
pub struct Emitters<'w, 's> {
    lights: Query<'w, 's, Entity, Or<(With<PointLight>, With<SpotLight>, With<DirectionalLight>, With<RectLight>)>>,
    surfaces: Query<'w, 's, (Entity, &'static MeshMaterial3d<StandardMaterial>)>,
    materials: Res<'w, Assets<StandardMaterial>>,
}

impl Emitters<'_, '_> {
    /// Whether an entity is one of them.
    pub fn contains(&self, entity: Entity) -> bool {
        self.lights.contains(entity) || self.surfaces.get(entity).is_ok_and(|(_, material)| self.shines(material))
    }

    fn is_empty(&self) -> bool {
        self.lights.is_empty() && !self.surfaces.iter().any(|(_, material)| self.shines(material))
    }

    fn shines(&self, material: &MeshMaterial3d<StandardMaterial>) -> bool {
        let material = self.materials.get(&material.0);
        material.is_some_and(|m| m.unlit || m.emissive.red.max(m.emissive.green).max(m.emissive.blue) > 0.0)
    }
}

/// Whether a world has a light, or a surface that is visible without light.
pub fn has_light(world: &mut World) -> bool {
    // The system fails where there are no materials, and then nothing shines.
    world.run_system_once(|emitters: Emitters| !emitters.is_empty()).unwrap_or(false)
}

/// A gray room with a large bright window above and to the left: walls of 0.02 to 0.3 times `luminance` (cd/m²), a window of 4 times
/// `luminance`.
pub fn studio(images: &mut Assets<Image>, luminance: f32) -> RestirEnvironment {
    let (width, height) = (64u32, 32u32);
    let window = Vec3::new(-0.6, 0.7, 0.4).normalize();
    let mut pixels = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (sin_v, cos_v) = (std::f32::consts::PI * (y as f32 + 0.5) / height as f32).sin_cos();
            let (sin_u, cos_u) = (std::f32::consts::TAU * ((x as f32 + 0.5) / width as f32 - 0.5)).sin_cos();
            let direction = Vec3::new(sin_v * sin_u, cos_v, -sin_v * cos_u);
            let walls = 0.16 + 0.14 * direction.y;
            let glow = 4.0 * ((direction.dot(window) - 0.85) / 0.15).clamp(0.0, 1.0);
            pixels.push([walls + glow, walls + glow, 1.05 * walls + glow, 1.0].map(|c| c * luminance));
        }
    }
    let image = images.add(equirectangular(width, height, &pixels));
    RestirEnvironment { image: Some(image), ..default() }
}
