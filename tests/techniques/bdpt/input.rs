//! Bidirectional path tracing with unusual input: a finite picture, the right one, and a warning where something is left out.

use super::small_scenes::in_glass;
use crate::support::{app::*, log, small_scenes::*};
use bevy::{
    camera::{ImageRenderTarget, RenderTarget},
    light::NotShadowCaster,
    prelude::*,
};
use bevy_restir::{Bdpt, Jitter, LightTechniques, RadianceCapture, Restir, Technique};

fn bidirectional(bounces: u32) -> Restir {
    Restir { technique: Technique::Bdpt, bounces, jitter: Jitter::Always, ..plain() }
}

fn rig(make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(32, make)?;
    rig.set(|r| *r = bidirectional(3));
    Some(rig)
}

/// Resources and passes of light paths exist only while the technique is used: 60 bytes a path for its splats, 4 bytes a pixel, and with
/// connections 48 bytes a path for its vertex, in rows of 2,048.
#[test]
#[ignore = "second tier: ./run test --more"]
fn buffers_of_light_paths_exist_only_for_this_technique() {
    let Some(mut rig) = rig(|rig| {
        room(rig);
    }) else {
        return;
    };
    let bytes =
        |rig: &Rig, name: &str| rig.report().memory.iter().filter(|(item, _)| *item == name).map(|m| m.1).sum::<u64>();
    let cases = [
        (Technique::Pt, LightTechniques::Full, 0u64, 0u64),
        (Technique::Bdpt, LightTechniques::Full, 32 * 32, 2048 * 48),
        (Technique::Bdpt, LightTechniques::Lightweight, 32 * 32, 16),
        (Technique::Reference, LightTechniques::Full, 0, 0),
    ];
    for (technique, techniques, paths, vertices) in cases {
        rig.set(|r| (r.technique, r.bdpt.techniques) = (technique, techniques));
        rig.picture(2);
        rig.frames(2);
        let heads = if paths > 0 { 4 * 32 * 32 } else { 0 };
        assert_eq!(bytes(&rig, "light vertices"), vertices, "{technique:?}");
        assert_eq!(bytes(&rig, "light map"), 60 * paths + heads, "{technique:?}");
        assert_eq!(bytes(&rig, "bdpt reservoirs"), if paths > 0 { 2 * 64 * 32 * 32 } else { 0 });
        assert_eq!(bytes(&rig, "splats reservoirs"), if paths > 0 { 3 * 44 * 32 * 32 } else { 0 });
    }
    let passes = bevy_restir::pass_names(&bidirectional(3), default());
    assert!(passes.contains(&"light_paths") && passes.contains(&"splats"), "{passes:?}");
    assert!(!bevy_restir::pass_names(&plain(), default()).contains(&"light_paths"));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn scenes_without_light_are_black() {
    let Some(mut rig) = rig(|rig| {
        rig.spawn(square(2.0), lambert(0.5), Transform::default());
    }) else {
        return;
    };
    assert_eq!(rig.picture(2).mean(), 0.0);
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn every_number_of_bounces_and_light_paths_gives_a_finite_picture() {
    let Some(mut rig) = rig(|rig| surrounded(rig, true)) else { return };
    for bounces in [0, 1, 2, 64] {
        for light_paths in [0.0, 0.001, 8.0] {
            rig.set(|r| *r = Restir { bdpt: Bdpt { light_paths, ..Bdpt::default() }, ..bidirectional(bounces) });
            assert!(rig.picture(2).is_finite(), "{bounces} bounces, {light_paths} light paths");
        }
    }
    rig.assert_sound();
}

/// A plane that sees the whole sky has its radiance, times the albedo.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_plane_under_nothing_but_a_sky_has_its_closed_form() {
    let Some(mut rig) = rig(|rig| {
        rig.spawn(square(20.0), lambert(0.5), Transform::default());
        rig.insert(rig.camera, sky(2.0));
    }) else {
        return;
    };
    for techniques in [LightTechniques::Full, LightTechniques::NoLightTracing] {
        rig.set(|r| r.bdpt.techniques = techniques);
        let (mean, error) = rig.mean_over(1..13, 8);
        eprintln!("{techniques:?}: {mean} +- {error}");
        assert!(error < 0.01 && (mean - 1.0).abs() < 4.0 * error + 1e-3, "{techniques:?}: {mean} +- {error}");
    }
    rig.assert_sound();
}

/// Absorbing glass around the camera is a documented limit; whatever its picture is, it must be one.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_camera_in_glass_sees_a_finite_picture() {
    for side in [0.6, 14.0] {
        let mut glass = Entity::PLACEHOLDER;
        let Some(mut rig) = rig(|rig| glass = in_glass(rig, side)) else { return };
        let glass = rig.material_of(glass);
        for distance in [f32::INFINITY, 0.5] {
            rig.edit(&glass, |m| {
                (m.attenuation_color, m.attenuation_distance) = (Color::linear_rgb(0.8, 0.5, 0.3), distance);
            });
            let picture = rig.picture(4);
            assert!(picture.is_finite() && picture.mean() > 0.0, "{side} m of glass, {distance} m: {}", picture.mean());
            rig.assert_sound();
        }
    }
}

/// The poses and settings of two cameras.
fn eyes() -> [(Transform, Projection, Restir); 2] {
    let with = |techniques| Restir { bdpt: Bdpt { techniques, ..Bdpt::default() }, ..bidirectional(3) };
    let front = Transform::from_xyz(0.3, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    let aside = Transform::from_xyz(1.5, 1.0, 4.0).looking_at(Vec3::ZERO, Vec3::Y);
    [
        (front, Projection::default(), with(LightTechniques::Full)),
        (aside, orthographic(4.0, 4.0), with(LightTechniques::Lightweight)),
    ]
}

/// Each camera has light sub-paths and a light map of its own.
#[test]
#[ignore = "second tier: ./run test --more"]
fn two_cameras_with_light_paths_equal_two_single_ones() {
    let mut singles = Vec::new();
    for eye in eyes() {
        let Some(mut rig) = rig(mirrors) else { return };
        rig.insert(rig.camera, eye);
        singles.push(rig.picture(4));
    }
    let mut rig = rig(mirrors).expect("there is an adapter");
    let [first, second] = eyes();
    rig.insert(rig.camera, first);
    let target = rig.add::<Image>(target_image(UVec2::splat(32)));
    let target = RenderTarget::Image(ImageRenderTarget::from(target));
    let capture = RadianceCapture::default();
    let other = rig.spawn_bundle((Camera3d::default(), target, unit_exposure(), capture.clone(), second));
    rig.get_mut::<Camera>(other).order = 1;
    let captures = [rig.capture.clone(), capture];
    rig.until_ready();
    for camera in [rig.camera, other] {
        rig.get_mut::<Restir>(camera).reset = true;
    }
    rig.frames(3);
    captures.iter().for_each(RadianceCapture::request);
    rig.frame();
    for (i, (capture, single)) in captures.iter().zip(&singles).enumerate() {
        let both: Vec<[f32; 3]> = capture.take().expect("every camera renders").mean().collect();
        let differing = both.iter().zip(&single.pixels).filter(|(a, b)| a != b).count();
        assert!(differing == 0 && single.mean() > 0.01, "camera {i}: {differing} pixels differ");
    }
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_behind_the_camera_arrives_and_seeds_repeat() {
    let Some(mut rig) = rig(|rig| {
        rig.spawn(square(2.0), lambert(0.5), Transform::default());
        rig.spawn(square(2.0), lamp(5.0, 5.0, 5.0), Transform::from_xyz(0.0, 0.0, 8.0).looking_to(Vec3::Z, Vec3::Y));
    }) else {
        return;
    };
    assert!(rig.picture(8).mean() > 0.01);
    // The same seed gives the same picture, and without the lamp it is black.
    mirrors(&mut rig);
    rig.set(|r| r.accumulate = true);
    let first = rig.picture(4);
    assert!(first.mean() > 0.02);
    assert_eq!(first, rig.picture(4));
    let world = rig.app.world_mut();
    let objects: Vec<Entity> = world.query_filtered::<Entity, With<Mesh3d>>().iter(world).collect();
    objects.into_iter().for_each(|object| assert!(world.despawn(object)));
    rig.spawn(square(2.0), lambert(0.5), Transform::default());
    assert_eq!(rig.picture(2).mean(), 0.0);
    rig.assert_sound();
}

/// Objects without shadows are not in the tree of objects: the camera's view of light vertices would be wrong, and is left out.
#[test]
#[ignore = "second tier: ./run test --more"]
fn objects_without_shadows_turn_the_cameras_view_of_light_paths_off() {
    log::listen();
    let Some(mut rig) = rig(|rig| {
        room(rig);
        let pane = rig.spawn(square(0.8), lambert(0.9), Transform::from_xyz(0.2, 0.0, 1.5));
        rig.insert(pane, NotShadowCaster);
    }) else {
        return;
    };
    // Frames of one run are correlated; runs are not.
    rig.set(|r| r.accumulate = true);
    let (ours, error) = rig.mean_over(1..25, 12);
    assert!(!log::warnings("caustics from the camera only").is_empty());
    rig.set(|r| r.technique = Technique::Reference);
    let (truth, error_of_truth) = rig.mean_over(1..9, 100);
    let sigma = error.hypot(error_of_truth);
    eprintln!("{ours} and {truth} ± {sigma}");
    assert!((ours - truth).abs() < 4.0 * sigma && sigma < 0.015 * truth, "{ours} and not {truth} ± {sigma}");
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn small_devices_trace_fewer_light_paths() {
    log::listen();
    // A binding holds 21,845 light vertices of 48 bytes.
    let Some(mut rig) = Rig::binding_at_most(1 << 20, 64, 64) else { return };
    room(&mut rig);
    rig.set(|r| {
        *r = Restir {
            bdpt: Bdpt { light_paths: 8.0, techniques: LightTechniques::Full, ..Bdpt::default() },
            ..bidirectional(2)
        }
    });
    assert!(rig.picture(4).mean() > 0.01);
    assert!(!log::warnings("light paths instead of bdpt.light_paths").is_empty());
    rig.assert_sound();
}
