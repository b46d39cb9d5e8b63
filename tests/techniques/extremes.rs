//! Pictures do not depend on the scale, position or brightness of the scene, except for rounding.  For ReSTIR, the last of several
//! frames is compared, so that its history takes part.

use crate::support::{
    agreement::assert_techniques_agree,
    app::{Picture, Rig, lambert, lamp, plain, square},
};
use bevy::prelude::*;
use bevy_restir::{Jitter, Paths, Restir, Technique};

/// A room with walls, a lamp, a rough metal ball and a glass ball, in front of a camera at (0, 0, 5); everything is scaled by `scale` and
/// moved.
fn room(rig: &mut Rig, scale: f32, offset: Vec3, radiance: f32) {
    let mut spawn = |mesh: Mesh, material: StandardMaterial, transform: Transform| {
        let transform = Transform {
            translation: transform.translation * scale + offset,
            scale: transform.scale * scale,
            ..transform
        };
        rig.spawn(mesh, material, transform)
    };
    spawn(square(4.0), lambert(0.7), Transform::from_xyz(0.0, 0.0, -2.0));
    let floor = Transform::from_xyz(0.0, -2.0, 0.0).looking_to(Vec3::NEG_Y, Vec3::X);
    spawn(square(4.0), lambert(0.5), floor);
    let side = Transform::from_xyz(-2.0, 0.0, 0.0).looking_to(Vec3::NEG_X, Vec3::Y);
    spawn(square(4.0), lambert(0.3), side);
    let metal =
        StandardMaterial { metallic: 1.0, perceptual_roughness: 0.3, ..Color::linear_rgb(0.9, 0.6, 0.3).into() };
    spawn(Sphere::new(0.8).into(), metal, Transform::from_xyz(-0.8, -1.2, -0.5));
    let glass = StandardMaterial {
        specular_transmission: 1.0,
        thickness: 1.0,
        perceptual_roughness: 0.0,
        ..Color::WHITE.into()
    };
    spawn(Sphere::new(0.6).into(), glass, Transform::from_xyz(0.9, -1.4, 0.4));
    let above = Transform::from_xyz(0.5, 1.9, 0.0).looking_to(Vec3::Y, Vec3::X);
    spawn(square(1.0), lamp(radiance, radiance, radiance), above);

    let camera = rig.camera;
    rig.insert(
        camera,
        (
            Transform::from_translation(Vec3::new(0.0, 0.0, 5.0) * scale + offset),
            Projection::Perspective(PerspectiveProjection { near: 0.1 * scale, ..Default::default() }),
            Restir {
                bounces: 6,
                jitter: Jitter::Always,
                // Lengths scale with the scene.
                paths: Paths { distance: 0.01 * scale, ..Default::default() },
                ..plain()
            },
        ),
    );
}

/// Removes the objects of the last picture, so that one app, with its pipelines, renders all pictures of a technique.
fn clear(rig: &mut Rig) {
    let world = rig.app.world_mut();
    let objects: Vec<Entity> = world.query_filtered::<Entity, With<Mesh3d>>().iter(world).collect();
    objects.into_iter().for_each(|object| assert!(world.despawn(object)));
}

fn picture(rig: &mut Rig, technique: Technique, scale: f32, offset: Vec3, radiance: f32, frames: u32) -> Picture {
    clear(rig);
    room(rig, scale, offset, radiance);
    rig.set(|restir| restir.technique = technique);
    let picture = rig.picture(frames);
    rig.assert_sound();
    assert!(picture.is_finite());
    picture
}

/// The share of pixels that differ by more than a thousandth.
fn share_of_different_pixels(a: &Picture, b: &Picture, gain: f32) -> f64 {
    let differ =
        |(a, b): &((UVec2, Vec3), (UVec2, Vec3))| (a.1 * gain - b.1).length() > 1e-3 * (b.1.length() + 1e-3 * gain);
    a.iter().zip(b.iter()).filter(differ).count() as f64 / a.pixels.len() as f64
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_scene_looks_the_same_at_every_scale() {
    for technique in Technique::ALL {
        let Some(mut rig) = Rig::new(48, 48) else { return };
        let one = picture(&mut rig, technique, 1.0, Vec3::ZERO, 10.0, 8);
        // Powers of two scale every float exactly, so that equal random numbers give the same paths: 1.2e-4 and 1.3e5.
        for exponent in [-13, 17] {
            let scaled = picture(&mut rig, technique, 2f32.powi(exponent), Vec3::ZERO, 10.0, 8);
            let share = share_of_different_pixels(&one, &scaled, 1.0);
            eprintln!("{technique:?}, scale 2^{exponent}: {share} of the pixels differ");
            assert!(share < 0.01, "{technique:?}, scale 2^{exponent}: {share} of the pixels differ");
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn pictures_scale_with_radiances_from_1e_minus_6_to_1e10() {
    for technique in Technique::ALL {
        let Some(mut rig) = Rig::new(48, 48) else { return };
        let one = picture(&mut rig, technique, 1.0, Vec3::ZERO, 1.0, 4);
        // 1e-6 and 1e10.
        for exponent in [-20, 33] {
            let gain = 2f32.powi(exponent);
            let bright = picture(&mut rig, technique, 1.0, Vec3::ZERO, gain, 4);
            let share = share_of_different_pixels(&one, &bright, gain);
            eprintln!("{technique:?}, radiance 2^{exponent}: {share} of the pixels differ");
            assert!(share < 0.001, "{technique:?}, radiance 2^{exponent}: {share} of the pixels differ");
        }
    }
}

#[test]
fn far_from_the_origin_no_light_leaks() {
    // At 1e5 m, floats are 8 mm apart: a room of 64 m looks the same except for noise.
    let frames = 48;
    let reference = Technique::Reference;
    let Some(mut rig) = Rig::new(48, 48) else { return };
    let here = picture(&mut rig, reference, 16.0, Vec3::ZERO, 10.0, frames);
    let there = picture(&mut rig, reference, 16.0, Vec3::new(1e5, -1e5, 1e5), 10.0, frames);
    let difference = (there.mean() - here.mean()) / here.mean();
    assert!(difference.abs() < 0.03, "the mean is off by {difference}");
    // No wall pixel is black, as it would be if shadow rays hit their own surface.
    let black = |p: &Picture| p.iter().filter(|(_, c)| c.max_element() <= 0.0).count();
    assert!(black(&there) <= black(&here) + 5, "{} pixels are black, {} at the origin", black(&there), black(&here));
}

/// A room with a bright lamp, and a dim and black one on the wall that covers the pixel (16, 13).
fn room_of_two_lamps(rig: &mut Rig, technique: Technique, bright: f32, dim: f32) -> Picture {
    clear(rig);
    room(rig, 1.0, Vec3::ZERO, bright);
    rig.spawn(square(0.5), lamp(dim, dim, dim), Transform::from_xyz(0.0, 0.5, -1.9));
    rig.set(|restir| restir.technique = technique);
    let picture = rig.picture(8);
    rig.assert_sound();
    picture
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn dim_and_bright_lamps_work_in_one_picture() {
    // 8.6e9 and 9.5e-7, and the same scene 2^33 times darker.
    let (bright, dim) = (2f32.powi(33), 2f32.powi(-20));
    for technique in Technique::ALL {
        let Some(mut rig) = Rig::new(32, 32) else { return };
        let picture = room_of_two_lamps(&mut rig, technique, bright, dim);
        let darker = room_of_two_lamps(&mut rig, technique, 1.0, dim / bright);
        // The dim lamp reflects nothing, so its pixels show its emission only.
        assert_eq!(picture.at(16, 13), Vec3::splat(dim), "{technique:?}");
        let share = share_of_different_pixels(&darker, &picture, bright);
        eprintln!("{technique:?}: {share} of the pixels differ, mean {}", picture.mean());
        assert!(share < 0.001 && picture.mean() > 0.01 * f64::from(bright), "{technique:?}: {share}");
    }
}

#[test]
fn glass_of_index_one_is_invisible() {
    let with = |ball: bool| {
        let mut rig = Rig::new(33, 17)?;
        rig.set(|restir| restir.bounces = 4);
        rig.spawn(square(8.0), lamp(3.0, 2.0, 1.0), Transform::from_xyz(0.0, 0.0, -2.0));
        if ball {
            let nothing = StandardMaterial {
                specular_transmission: 1.0,
                thickness: 1.0,
                ior: 1.0,
                perceptual_roughness: 0.0,
                reflectance: 0.0,
                ..Color::WHITE.into()
            };
            rig.spawn(Sphere::new(1.0), nothing, Transform::default());
        }
        Some(rig.picture(2))
    };
    let (Some(without), Some(with)) = (with(false), with(true)) else { return };
    let share = share_of_different_pixels(&without, &with, 1.0);
    assert!(share < 0.02, "{share} of the pixels differ");
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_techniques_agree_at_every_roughness() {
    let Some(mut rig) = Rig::new(17, 31) else { return };
    room(&mut rig, 1.0, Vec3::ZERO, 5.0);
    let ball = rig.spawn(Sphere::new(0.9), StandardMaterial::default(), Transform::from_xyz(0.0, 0.2, 0.0));
    let material = rig.material_of(ball);
    for roughness in [0.0, 0.01, 0.032, 0.5, 1.0] {
        for metallic in [0.0, 1.0] {
            rig.edit(&material, |m| {
                *m = StandardMaterial { perceptual_roughness: roughness, metallic, ..Color::WHITE.into() }
            });
            assert_techniques_agree(&mut rig, &format!("roughness {roughness}, metallic {metallic}"), 0.05);
            rig.assert_sound();
        }
    }
}
