//! Adds a sky to files with little or no light.

use bevy::{camera::Exposure, prelude::*};
use bevy_restir::prelude::*;
use bevy_restir_support::sky::{self, Emitters};

use super::load::{Arrived, Stage};
use crate::look::TooDark;

/// Marks a camera whose environment comes from the viewer, because the scene has none.
#[derive(Component)]
pub struct AddedSky;

pub fn plugin(app: &mut App) {
    app.add_message::<TooDark>()
        .add_observer(forget_added_sky)
        .add_systems(Update, add_sky.after(super::load::measure));
}

/// The user removed the environment.
fn forget_added_sky(removed: On<Remove, RestirEnvironment>, mut commands: Commands) {
    commands.entity(removed.entity).try_remove::<AddedSky>();
}

fn add_sky(
    mut commands: Commands,
    mut arrived: MessageReader<Arrived>,
    mut too_dark: MessageReader<TooDark>,
    stage: Res<Stage>,
    children: Query<&Children>,
    emitters: Emitters,
    mut images: ResMut<Assets<Image>>,
    cameras: Query<(Entity, Has<RestirEnvironment>, Has<AddedSky>), With<Restir>>,
) {
    let (arrives, is_dark) = (arrived.read().count() > 0, too_dark.read().count() > 0);
    if !arrives && !is_dark {
        return;
    }
    let Some(shown) = &stage.shown else { return };
    let is_lit = arrives && children.iter_descendants(shown.root).any(|entity| emitters.contains(entity));
    for (camera, has_environment, is_added) in &cameras {
        if is_lit && is_added {
            commands.entity(camera).remove::<RestirEnvironment>();
        } else if !is_lit && !has_environment {
            let sky = sky::studio(&mut images, 1.0 / Exposure::default().exposure());
            commands.entity(camera).insert((sky, AddedSky));
        }
    }
}
