//! Light of last resort: a file that has none, or shows next to nothing of it, is put under a sky, so that something is seen.

use bevy::prelude::*;
use bevy_restir::prelude::*;

use super::{
    environment,
    load::{Arrived, Stage},
};

/// The environment was not asked for by anyone.
#[derive(Component)]
pub struct LastResort;

/// What is shown is black but for a few places.
#[derive(Message, Default)]
pub struct TooDark;

pub fn plugin(app: &mut App) {
    app.add_message::<TooDark>().add_systems(Update, lend_light.after(super::load::measure));
}

fn lend_light(
    mut commands: Commands,
    mut arrived: MessageReader<Arrived>,
    mut too_dark: MessageReader<TooDark>,
    stage: Res<Stage>,
    children: Query<&Children>,
    lamps: Query<(), Or<(With<PointLight>, With<SpotLight>, With<DirectionalLight>, With<RectLight>)>>,
    surfaces: Query<&MeshMaterial3d<StandardMaterial>>,
    materials: Res<Assets<StandardMaterial>>,
    mut images: ResMut<Assets<Image>>,
    cameras: Query<(Entity, Has<RestirEnvironment>, Has<LastResort>), With<Restir>>,
) {
    let (arrives, is_dark) = (arrived.read().count() > 0, too_dark.read().count() > 0);
    if !arrives && !is_dark {
        return;
    }
    let Some(shown) = &stage.shown else { return };
    let emits = |entity| {
        let material = surfaces.get(entity).ok().and_then(|handle| materials.get(&handle.0));
        material.is_some_and(|m| m.emissive.red.max(m.emissive.green).max(m.emissive.blue) > 0.0)
    };
    let is_lit = arrives && children.iter_descendants(shown.root).any(|entity| lamps.contains(entity) || emits(entity));
    for (camera, has_environment, is_lent) in &cameras {
        if is_lit && is_lent {
            commands.entity(camera).remove::<(RestirEnvironment, LastResort)>();
        } else if !is_lit && !has_environment {
            let image = Some(images.add(studio()));
            commands.entity(camera).insert((RestirEnvironment { image, ..default() }, LastResort));
        }
    }
}

/// A grey room with a large bright window above and to the left, cd/m².
fn studio() -> Image {
    let (width, height) = (64u32, 32u32);
    let window = Vec3::new(-0.6, 0.7, 0.4).normalize();
    let mut pixels = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (sin_v, cos_v) = (std::f32::consts::PI * (y as f32 + 0.5) / height as f32).sin_cos();
            let (sin_u, cos_u) = (std::f32::consts::TAU * ((x as f32 + 0.5) / width as f32 - 0.5)).sin_cos();
            let towards = Vec3::new(sin_v * sin_u, cos_v, -sin_v * cos_u);
            let walls = 160.0 + 140.0 * towards.y;
            let glow = 4000.0 * ((towards.dot(window) - 0.85) / 0.15).clamp(0.0, 1.0);
            pixels.push([walls + glow, walls + glow, 1.05 * walls + glow, 1.0]);
        }
    }
    environment::equirectangular(width, height, &pixels)
}
