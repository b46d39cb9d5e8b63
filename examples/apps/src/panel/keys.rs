//! Keys that all programs share.

use bevy::{
    ecs::system::SystemParam,
    input::keyboard::{Key, KeyboardInput},
    prelude::*,
};
use bevy_egui::input::EguiWantsInput;
use bevy_restir::{Preset, Restir};
use bevy_restir_support::fields;

use super::Panel;

/// Describes the keys of [`act`].
pub const HELP: &str = "T, shift T: technique   V, shift V: view   1-4: preset\n\
                        up, down: bounces   R: reset   H: hide this";

/// The keys that were pressed while no text is typed into the panel.
#[derive(SystemParam)]
pub struct PressedKeys<'w, 's> {
    typing: Option<Res<'w, EguiWantsInput>>,
    events: MessageReader<'w, 's, KeyboardInput>,
}

impl PressedKeys<'_, '_> {
    /// Every press since the last call, also where one long frame holds several, and whether shift was held.
    pub fn read(&mut self) -> Vec<(KeyCode, bool)> {
        if self.typing.as_ref().is_some_and(|typing| typing.wants_any_keyboard_input()) {
            self.events.clear();
        }
        let pressed = self.events.read().filter(|event| event.state.is_pressed() && !event.repeat);
        let is_upper = |key: &Key| matches!(key, Key::Character(c) if c.chars().all(char::is_uppercase));
        pressed.map(|event| (event.key_code, is_upper(&event.logical_key))).collect()
    }
}

pub fn act(mut keys: PressedKeys, mut panel: ResMut<Panel>, mut cameras: Query<&mut Restir>) {
    for (key, shift) in keys.read() {
        if key == KeyCode::KeyH {
            panel.visible = !panel.visible;
        }
        for mut restir in &mut cameras {
            match key {
                KeyCode::KeyT => fields::next_technique(&mut restir, !shift),
                KeyCode::KeyV => fields::next_view(&mut restir, !shift),
                KeyCode::KeyR => restir.reset = true,
                KeyCode::ArrowUp => fields::change(&mut restir, "bounces", true),
                KeyCode::ArrowDown => fields::change(&mut restir, "bounces", false),
                KeyCode::Digit1 => fields::apply_preset(&mut restir, Preset::Performance),
                KeyCode::Digit2 => fields::apply_preset(&mut restir, Preset::Balanced),
                KeyCode::Digit3 => fields::apply_preset(&mut restir, Preset::Quality),
                KeyCode::Digit4 => fields::apply_preset(&mut restir, Preset::Unbiased),
                _ => {}
            }
        }
    }
}
