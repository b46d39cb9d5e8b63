//! A diffuse plane under Bevy's lights has the brightness that Bevy's own renderer gives it: units, cones and colors of
//! lights are read as Bevy means them.

use crate::support::app::*;
use bevy::{
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    prelude::*,
};
use bevy_restir::Restir;

const SIZE: u32 = 24;
/// Each light is as bright as this on the plane, so that 8 bits suffice.
const BRIGHT: f64 = 0.9;

fn linear(byte: u8) -> f64 {
    crate::support::oracle::texture::srgb_to_linear(f64::from(byte) / 255.0)
}

type Light = fn(&mut Rig) -> Entity;

/// Lights near the axis of the plane: there the diffuse term of Bevy, Burley's, equals Lambert's.  Rectangles are missing, because Bevy
/// draws them only with its feature `area_light_luts`.
const LIGHTS: [(&str, Light); 6] = [
    ("point", |rig| {
        let light = PointLight { intensity: 240.0, range: 1e4, color: Color::linear_rgb(1.0, 0.7, 0.4), ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.4, 0.2, 4.0)))
    }),
    ("sphere", |rig| {
        let light = PointLight { intensity: 500.0, range: 1e4, radius: 0.3, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(-0.3, 0.4, 6.0)))
    }),
    ("spot", |rig| {
        let light = SpotLight { intensity: 240.0, range: 1e4, inner_angle: 0.05, outer_angle: 0.3, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.3, 0.0, 4.0).looking_at(Vec3::new(0.1, 0.1, 0.0), Vec3::Y)))
    }),
    ("wide spot", |rig| {
        let light = SpotLight { intensity: 240.0, range: 1e4, inner_angle: 1.2, outer_angle: 1.5, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.3, 0.0, 4.0).looking_at(Vec3::new(0.1, 0.1, 0.0), Vec3::Y)))
    }),
    // Bevy limits it to a hemisphere, whose edge crosses the picture.
    ("spot beyond a hemisphere", |rig| {
        let light = SpotLight { intensity: 15.0, range: 1e4, inner_angle: 2.0, outer_angle: 2.5, ..default() };
        rig.spawn_bundle((light, Transform::from_xyz(0.0, 0.0, 1.0).looking_to(Vec3::X, Vec3::Y)))
    }),
    ("directional", |rig| {
        let light = DirectionalLight { illuminance: 3.0, color: Color::linear_rgb(0.4, 1.0, 0.7), ..default() };
        rig.spawn_bundle((light, Transform::default().looking_to(Vec3::new(0.3, -0.2, -1.0), Vec3::Y)))
    }),
];

#[test]
fn a_diffuse_plane_is_as_bright_as_bevy_draws_it_under_its_lights() {
    let Some(mut rig) = Rig::new(SIZE, SIZE) else { return };
    rig.app.insert_resource(GlobalAmbientLight { brightness: 0.0, ..default() });
    rig.insert(rig.camera, (orthographic(2.0, 2.0), Tonemapping::None, DebandDither::Disabled, Msaa::Off));
    rig.spawn(square(20.0), lambert(1.0), Transform::default());
    let target = rig.target.clone();
    for (name, make) in LIGHTS {
        let light = make(&mut rig);
        let ours = rig.picture(64);
        let settings = rig.app.world_mut().entity_mut(rig.camera).take::<Restir>().expect("the camera has settings");
        rig.frames(3);
        let bevys = rig.drawn(&target);
        rig.insert(rig.camera, settings);
        let (mut worst, mut brightest) = (0.0f64, 0.0f64);
        let mut sums = [0.0; 2];
        for ((_, c), drawn) in ours.iter().zip(&bevys) {
            for (i, &byte) in drawn[..3].iter().enumerate() {
                let (ours, bevys) = (f64::from(c[i]), linear(byte));
                // Half a step of 8 bits, which is finer in dark pixels.
                let step = 0.5 * (linear(byte.saturating_add(1)) - linear(byte.saturating_sub(1)));
                worst = worst.max(((ours - bevys).abs() - 0.6 * step) / BRIGHT);
                brightest = brightest.max(bevys);
                sums = [sums[0] + ours, sums[1] + bevys];
            }
        }
        let difference = sums[0] / sums[1] - 1.0;
        eprintln!(
            "{name}: mean off by {:+.2} %, a pixel by {:.2} %, brightest {brightest:.2}",
            100.0 * difference,
            100.0 * worst
        );
        assert!((0.3..1.0).contains(&brightest), "{name}: {brightest} does not suit 8 bits");
        assert!(difference.abs() < 0.01 && worst < 0.05, "{name}: {difference}, {worst}");
        rig.app.world_mut().despawn(light);
    }
    rig.assert_sound();
}
