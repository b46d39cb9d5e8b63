//! The parts of the viewer: files, light for dark ones, the camera, animations, and their sections of the panel.

pub mod animation;
pub mod camera;
pub mod light;
pub mod load;
mod sections;

use bevy::prelude::*;

use crate::panel::AddSection;

/// The keys of the viewer itself.
pub const KEYS: &str = "drag: turn   right drag: move   wheel: zoom\nF: fly (WASD, E, Q; right drag looks)   Home: all   Space: play\n\
                        drop a .glb, .gltf, .hdr or .exr";

pub fn plugin(app: &mut App) {
    app.add_plugins((load::plugin, light::plugin, camera::plugin, animation::plugin))
        .add_section(sections::file)
        .add_section(sections::view)
        .add_section(sections::animation)
        .add_systems(Update, sections::act_on_keys);
}
