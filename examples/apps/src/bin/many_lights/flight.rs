//! The camera: it circles around the plaza until the user moves it.

use bevy::{prelude::*, window::CursorMoved};
use bevy_egui::input::EguiWantsInput;

/// Radians per second.
const CIRCLING: f32 = 0.04;
/// Meters per second.
const FLYING: f32 = 4.0;
/// Radians per pixel.
const TURNING: f32 = 0.004;

/// State of a camera: its angle on the circle, or whether the user has moved it away.
#[derive(Component, Default)]
pub struct Flight {
    angle: f32,
    is_controlled: bool,
}

pub fn fly(
    time: Res<Time>,
    real: Res<Time<Real>>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    panel: Option<Res<EguiWantsInput>>,
    mut cursor: MessageReader<CursorMoved>,
    mut cameras: Query<(&mut Transform, &mut Flight)>,
) {
    if panel.is_some_and(|panel| panel.wants_any_input()) {
        cursor.clear();
        return;
    }
    let axis = |more: KeyCode, less: KeyCode| keys.pressed(more) as i32 as f32 - keys.pressed(less) as i32 as f32;
    let step = Vec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyS, KeyCode::KeyW),
    );
    let moved: Vec2 = cursor.read().filter_map(|event| event.delta).sum();
    let turn = if buttons.pressed(MouseButton::Left) { moved * TURNING } else { Vec2::ZERO };
    for (mut transform, mut flight) in &mut cameras {
        flight.is_controlled |= step != Vec3::ZERO || turn != Vec2::ZERO;
        flight.is_controlled &= !keys.just_pressed(KeyCode::KeyC);
        if !flight.is_controlled {
            flight.angle += CIRCLING * time.delta_secs();
            let (sin, cos) = flight.angle.sin_cos();
            *transform = Transform::from_xyz(9.4 * sin, 4.6, 9.4 * cos).looking_at(Vec3::new(0.0, 0.9, 0.0), Vec3::Y);
            continue;
        }
        let (yaw, pitch, _) = transform.rotation.to_euler(EulerRot::YXZ);
        let pitch = (pitch - turn.y).clamp(-1.5, 1.5);
        transform.rotation = Quat::from_euler(EulerRot::YXZ, yaw - turn.x, pitch, 0.0);
        // Real time, so that the camera moves while the lamps are paused.
        let hurry = if keys.pressed(KeyCode::ShiftLeft) { 4.0 } else { 1.0 };
        let moved = transform.rotation * step.normalize_or_zero();
        transform.translation += moved * (hurry * FLYING * real.delta_secs().min(0.2));
    }
}
