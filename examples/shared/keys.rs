//! Keys that change what a camera shows: T the technique, V the debug view, up and down the bounces.

use bevy::{
    prelude::*,
    reflect::enums::{DynamicEnum, Enum},
};
use bevy_restir::prelude::*;

/// Acts on the keys that were pressed, and says what changed.
pub fn act(keys: Res<ButtonInput<KeyCode>>, mut cameras: Query<&mut Restir>) {
    for mut restir in &mut cameras {
        if keys.just_pressed(KeyCode::KeyT) {
            next(&mut restir.technique);
        }
        if keys.just_pressed(KeyCode::KeyV) {
            next_view(&mut restir);
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

/// The next view that shows something of the technique.
fn next_view(restir: &mut Restir) {
    loop {
        next(&mut restir.debug_view);
        if restir.debug_view.shows(restir.technique) {
            return;
        }
    }
}

/// The next of an enum's values, the first after the last.
fn next<E: Enum + TypePath>(value: &mut E) {
    let bevy::reflect::TypeInfo::Enum(info) = value.get_represented_type_info().expect("an enum of this crate") else {
        return;
    };
    let index = (value.variant_index() + 1) % info.variant_len();
    if let Some(variant) = info.variant_at(index) {
        value.apply(&DynamicEnum::new(variant.name(), ()));
    }
}
