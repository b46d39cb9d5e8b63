//! A glTF file in an ordinary Bevy app: its camera gets `Restir`, so that the file needs a camera and lights. Keys 1 to 4 choose a preset.
//!
//! `cargo run -p bevy_restir_apps --bin gltf -- FILE.glb`; without a file it shows a cornell box.

use bevy::{asset::UnapprovedPathMode, prelude::*};
use bevy_restir::prelude::*;
use std::path::Path;

fn main() {
    // Files outside of Bevy's folder of assets need permission.
    let assets = AssetPlugin { unapproved_path_mode: UnapprovedPathMode::Allow, ..default() };
    App::new()
        .add_plugins((DefaultPlugins.set(assets), RestirPlugin::default()))
        .add_systems(Startup, load)
        .add_systems(Update, (light, choose_preset))
        .run();
}

fn load(mut commands: Commands, assets: Res<AssetServer>) {
    let cornell = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/scenes/cornell.glb");
    let file = std::env::args().nth(1).unwrap_or(cornell.into());
    // Relative paths are those of the folder that the program is called in.
    let path = Path::new(&file).canonicalize().unwrap_or(file.into());
    commands.spawn(WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset(path))));
}

/// Gives `Restir` to the camera of the file.
fn light(mut commands: Commands, cameras: Query<Entity, Added<Camera3d>>) {
    for camera in &cameras {
        commands.entity(camera).insert(Restir::default());
    }
}

fn choose_preset(keys: Res<ButtonInput<KeyCode>>, mut cameras: Query<&mut Restir>) {
    let choices = [KeyCode::Digit1, KeyCode::Digit2, KeyCode::Digit3, KeyCode::Digit4].into_iter().zip(Preset::ALL);
    for (_, preset) in choices.filter(|(key, _)| keys.just_pressed(*key)) {
        for mut restir in &mut cameras {
            *restir = restir.clone().with_preset(preset);
        }
    }
}
