//! Apps whose render world has a thread of its own, as Bevy's default plugins set it up: while it works on a frame, the app changes the scene
//! for the next one.

use crate::support::{app::*, small_scenes::room};
use bevy::prelude::*;
use bevy_restir::{Restir, Technique};

/// Pictures of a room between edits of all kinds, with every technique.  The app edits right after it has sent a frame to the render world.
fn pictures(rig: &mut Rig, techniques: &[Technique]) -> Vec<Picture> {
    let block = room(rig);
    // Built before the first picture, because the time that a build in the background takes decides when a new mesh appears.
    let mesh = rig.add::<Mesh>(Sphere::new(0.4).mesh().uv(12, 8));
    let gray = rig.add::<StandardMaterial>(lambert(0.8));
    rig.spawn_bundle((Mesh3d(mesh.clone()), MeshMaterial3d(gray), Transform::from_xyz(-1.0, 0.9, -0.4)));
    let light = rig.spawn_bundle((PointLight { intensity: 30.0, ..default() }, Transform::from_xyz(-1.0, 0.8, 1.0)));
    let mut pictures = Vec::new();
    for &technique in techniques {
        rig.set(|restir| *restir = Restir { technique, bounces: 2, seed: 3, ..plain() });
        pictures.push(rig.picture(3));
        let material = rig.add::<StandardMaterial>(lambert(0.8));
        let looks = (Mesh3d(mesh.clone()), MeshMaterial3d(material.clone()));
        let ball = rig.spawn_bundle((looks, Transform::from_xyz(0.9, -0.8, 0.6)));
        rig.frames(3);
        rig.get_mut::<PointLight>(light).intensity = 60.0;
        pictures.push(rig.next());
        rig.edit(&material, |material| material.base_color = Color::linear_rgb(0.1, 0.2, 0.9));
        rig.get_mut::<Transform>(block).translation.y += 0.1;
        pictures.push(rig.next());
        rig.app.world_mut().despawn(ball);
        rig.frame();
        rig.get_mut::<Transform>(light).translation.x += 0.4;
        pictures.push(rig.next());
    }
    rig.assert_sound();
    pictures
}

/// Compares an app with one that waits for its render world in every frame.
fn check(techniques: &[Technique]) {
    let Some(mut waiting) = Rig::new(24, 16) else { return };
    let expected = pictures(&mut waiting, techniques);
    // The second app takes the device of the first one.
    drop(waiting);
    let mut rig = Rig::pipelined(24, 16).expect("there is an adapter");
    for (i, (picture, expected)) in pictures(&mut rig, techniques).iter().zip(&expected).enumerate() {
        let (technique, step) = (techniques[i / 4], i % 4);
        let other = picture.iter().zip(expected.iter()).filter(|(a, b)| a != b).count();
        assert_eq!(other, 0, "{technique:?}, picture {step}: {other} of {} pixels differ", expected.pixels.len());
        assert_eq!(picture.samples, expected.samples, "{technique:?}, picture {step}");
        assert!(picture.mean() > 0.05, "{technique:?}, picture {step}: {}", picture.mean());
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_thread_for_the_render_world_changes_no_picture_of_direct_light() {
    check(&[Technique::Reference, Technique::Di]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_thread_for_the_render_world_changes_no_picture_of_paths() {
    check(&[Technique::Pt, Technique::Gi, Technique::Di, Technique::Bdpt]);
}

/// The request comes while the render world works on the frame before.
#[test]
fn a_capture_shows_the_frame_after_its_request_beside_a_busy_render_world() {
    let Some(mut rig) = Rig::pipelined(64, 48) else { return };
    let entity = rig.spawn(square(20.0), lamp(1.0, 1.0, 1.0), Transform::default());
    let material = rig.material_of(entity);
    rig.until_ready();
    for radiance in 2..40u8 {
        rig.frame();
        let radiance = f32::from(radiance);
        rig.edit(&material, |material| material.emissive = LinearRgba::rgb(radiance, radiance, radiance));
        assert_eq!(rig.next().center(), Vec3::splat(radiance));
    }
    rig.assert_sound();
}

/// The run begins while the render world works on a frame with light that is too bright for `f32`.
#[test]
fn a_new_run_of_guards_does_not_count_the_frame_before_it() {
    let Some(mut rig) = Rig::pipelined(64, 48) else { return };
    // Ten micrometers from the light, its irradiance is above 1e38.
    rig.insert(rig.camera, orthographic(1e-5, 1e-5));
    rig.spawn(square(1.0), lambert(0.5), Transform::default());
    let light = rig.spawn_bundle((PointLight::default(), Transform::from_xyz(0.0, 0.0, 1e-5)));
    for _ in 0..5 {
        rig.get_mut::<PointLight>(light).intensity = 1e31;
        rig.until_ready();
        rig.assert_raised(&["float_overflow"]);
        rig.frame();
        rig.get_mut::<PointLight>(light).intensity = 1.0;
        rig.reset_guards();
        rig.assert_sound();
    }
}
