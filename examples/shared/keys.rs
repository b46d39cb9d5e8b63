//! Keys that change what a camera shows: T the technique, V the debug view, up and down the bounces.

use bevy::prelude::*;
use bevy_restir::prelude::*;

#[path = "fields.rs"]
#[expect(dead_code, reason = "panels list and edit what keys only step through")]
mod fields;

/// Acts on the keys that were pressed, and says what changed.
pub fn act(keys: Res<ButtonInput<KeyCode>>, mut cameras: Query<&mut Restir>) {
    for mut restir in &mut cameras {
        if keys.just_pressed(KeyCode::KeyT) {
            fields::change(&mut restir, "technique", true);
        }
        if keys.just_pressed(KeyCode::KeyV) {
            fields::next_view(&mut restir, true);
        }
        if keys.just_pressed(KeyCode::ArrowUp) {
            restir.bounces = (restir.bounces + 1).min(Restir::MAX_BOUNCES);
        }
        if keys.just_pressed(KeyCode::ArrowDown) {
            restir.bounces = restir.bounces.saturating_sub(1);
        }
        if keys.any_just_pressed([KeyCode::KeyT, KeyCode::KeyV, KeyCode::ArrowUp, KeyCode::ArrowDown]) {
            println!("{:?}, {} bounces, showing {:?}", restir.technique, restir.bounces, restir.debug_view);
        }
    }
}
