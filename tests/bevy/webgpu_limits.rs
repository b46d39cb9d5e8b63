//! Devices that have no more than WebGPU's default limits.

use crate::support::{app::*, small_scenes::room};
use bevy::{prelude::*, render::settings::WgpuLimits};
use bevy_restir::{RayBackend, Restir, Technique};

/// All passes of the default settings, those of the denoiser, too.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_technique_gives_the_same_picture_within_the_limits_of_webgpu() {
    let software = Start { backend: RayBackend::Software, ..default() };
    let Some(mut usual) = Rig::starting(software, 24, 16) else { return };
    let mut limited = Rig::limited(WgpuLimits::default(), 24, 16).expect("there is an adapter");
    for rig in [&mut usual, &mut limited] {
        room(rig);
    }
    for technique in Technique::ALL {
        let [expected, picture] = [&mut usual, &mut limited].map(|rig| {
            // Without compensation these are the pipelines of other tests in rooms.
            let settings = Restir { technique, bounces: 2, seed: 3, energy_compensation: false, ..default() };
            rig.set(|restir| *restir = settings);
            rig.picture(4)
        });
        let other = picture.iter().zip(expected.iter()).filter(|(a, b)| a != b).count();
        assert_eq!(other, 0, "{technique:?}: {other} of {} pixels differ", picture.pixels.len());
        assert!(picture.mean() > 0.01 && picture.is_finite(), "{technique:?}: {}", picture.mean());
    }
    for rig in [&mut usual, &mut limited] {
        rig.assert_sound();
    }
}
