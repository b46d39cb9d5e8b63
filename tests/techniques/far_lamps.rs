//! Light of small lamps falls off with the square of the distance, as far as single precision can tell lamp and receiver apart.

use crate::support::{app::*, small_scenes::*};
use bevy::prelude::*;
use bevy_restir::{Restir, Technique};

/// The brightness of a wall that a small lamp lights from this distance, times the square of the distance.
fn brightness(technique: Technique, frames: u32, distance: f32) -> Option<(f64, f64)> {
    let mut rig = Rig::new(16, 16)?;
    let turned = Quat::from_euler(EulerRot::XYZ, 0.3, 0.5, 0.7);
    let toward = Vec3::new(0.6, 0.0, 0.8);
    rig.spawn(Cuboid::from_length(0.1), lamp(1e4, 1e4, 1e4), Transform::from_xyz(1.3, 0.7, -0.9).with_rotation(turned));
    let place = Vec3::new(1.3, 0.7, -0.9) + distance * toward;
    rig.spawn(square(2.0), lambert(0.5), facing(place, place - toward));
    // The camera looks past the lamp.
    let eye = place - toward * (0.5 * distance).min(2.0) + Vec3::new(0.0, 0.3, 0.0);
    *rig.get_mut::<Transform>(rig.camera) = Transform::from_translation(eye).looking_at(place, Vec3::Y);
    let narrow = PerspectiveProjection { fov: 0.02, ..default() };
    rig.insert(rig.camera, Projection::Perspective(narrow));
    rig.set(|r| *r = Restir { technique, bounces: 1, ..plain() });
    let (mean, error) = rig.mean_over(0..6, frames);
    rig.assert_sound();
    let scale = f64::from(distance).powi(2);
    Some((scale * mean, scale * error))
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_of_a_small_lamp_falls_off_with_the_square_of_the_distance() {
    for (technique, frames) in [(Technique::Reference, 64), (Technique::Di, 16)] {
        let Some((near, near_error)) = brightness(technique, frames, 4.0) else { return };
        for distance in [40.0, 4000.0] {
            let (far, error) = brightness(technique, frames, distance).expect("there is an adapter");
            let error = error.hypot(near_error);
            eprintln!("{technique:?}, {distance} m: {far}, from 4 m {near} ± {error}");
            assert!(error < 0.02 * near, "{technique:?}, {distance} m: ± {error}");
            assert!(
                (far - near).abs() < 4.0 * error + 0.01 * near,
                "{technique:?}, {distance} m: {far}, from 4 m {near}"
            );
        }
    }
}
