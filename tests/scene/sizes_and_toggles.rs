//! Pictures of one pixel, targets and viewports that change, and cameras that are switched off and on, for every technique: the picture is
//! always that of a new camera.

use crate::support::{
    app::*,
    bad_numbers::{assert_no_errors, fresh},
    small_scenes::room,
};
use bevy::{
    camera::{ImageRenderTarget, RenderTarget, Viewport},
    prelude::*,
};
use bevy_restir::{Direct, Restir, Technique};

/// The techniques of the first tier: the compilation of a technique's pipelines takes most of the time of these tests.
const TWO: &[Technique] = &[Technique::Di, Technique::Pt];
const ALL: &[Technique] = &Technique::ALL;

fn settings(technique: Technique) -> Restir {
    // Few light subsets, because a CPU fills them slowly.
    let direct = Direct { subset_count: 4, subset_size: 32, ..default() };
    // Without compensation these are the pipelines of other tests in rooms.
    Restir { technique, bounces: 2, seed: 3, direct, energy_compensation: false, ..default() }
}

/// A room, seen at a size.
fn scene(size: UVec2) -> Option<Rig> {
    let mut rig = Rig::new(size.x, size.y)?;
    room(&mut rig);
    rig.set(|restir| *restir = settings(Technique::Pt));
    Some(rig)
}

/// The picture of a technique, when everything is ready.
fn picture(rig: &mut Rig, technique: Technique) -> Picture {
    rig.set(|restir| *restir = settings(technique));
    rig.until_ready();
    let picture = fresh(rig);
    assert!(picture.is_finite() && picture.mean() > 0.0, "{technique:?}, {}", picture.size);
    picture
}

/// Replaces the camera by a new one with a new target.
fn replace_camera(rig: &mut Rig, size: UVec2) {
    rig.app.world_mut().despawn(rig.camera);
    rig.target = rig.add::<Image>(target_image(size));
    let target = RenderTarget::Image(ImageRenderTarget::from(rig.target.clone()));
    let capture = rig.capture.clone();
    let place = Transform::from_xyz(0.0, 0.0, 5.0);
    rig.camera = rig.spawn_bundle((Camera3d::default(), target, place, unit_exposure(), plain(), capture));
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn sizes_viewports_and_toggles_leave_no_trace() {
    check(TWO);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_sizes_viewports_and_toggles_of_all_techniques_leave_no_trace() {
    check(ALL);
}

/// One test, so that the pipelines are compiled once.
fn check(techniques: &[Technique]) {
    let Some(mut rig) = check_sizes(techniques) else { return };
    let size = UVec2::new(24, 16);
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = target_image(size));
    rig.frames(2);
    check_toggles(&mut rig, size, techniques);
}

/// Returns the app whose target was resized.
fn check_sizes(techniques: &[Technique]) -> Option<Rig> {
    let sizes = [UVec2::new(12, 8), UVec2::ONE, UVec2::new(5, 9), UVec2::new(12, 8)];
    // The other app gets a new camera for each size, and keeps its pipelines.
    let (mut resized, mut other) = (scene(sizes[0])?, scene(sizes[0])?);
    for size in sizes {
        let target = resized.target.clone();
        resized.edit(&target, |image| *image = target_image(size));
        // Bevy reports the new size of a target to its camera in the next frame.
        resized.frames(2);
        replace_camera(&mut other, size);
        for &technique in techniques {
            let expected = picture(&mut other, technique);
            assert_eq!(expected.size, size);
            assert_eq!(picture(&mut resized, technique), expected, "{technique:?}, {size}");
            assert_no_errors(&resized, "resized");
        }
    }
    Some(resized)
}

fn check_toggles(rig: &mut Rig, size: UVec2, techniques: &[Technique]) {
    let camera = rig.camera;
    let good: Vec<_> = techniques.iter().map(|&technique| picture(rig, technique)).collect();
    for (i, &technique) in techniques.iter().enumerate() {
        assert_eq!(picture(rig, technique), good[i], "{technique:?} after other techniques");
        for part in [UVec2::ONE, UVec2::new(12, 16), UVec2::new(5, 3)] {
            let viewport =
                Viewport { physical_position: UVec2::new(2, 1).min(size - part), physical_size: part, ..default() };
            rig.get_mut::<Camera>(camera).viewport = Some(viewport);
            rig.frame();
            assert_eq!(picture(rig, technique).size, part);
            assert_no_errors(rig, "viewport");
        }
        rig.get_mut::<Camera>(camera).viewport = None;
        rig.frame();
        assert_eq!(picture(rig, technique), good[i], "{technique:?} without a viewport again");

        rig.app.world_mut().entity_mut(camera).remove::<Restir>();
        rig.frames(2);
        assert!(rig.next_if_any().is_none(), "without `Restir` there is no radiance");
        rig.insert(camera, settings(technique));
        rig.frame();
        assert_eq!(picture(rig, technique), good[i], "{technique:?} with `Restir` again");

        rig.get_mut::<Camera>(camera).is_active = false;
        rig.frames(2);
        assert!(rig.next_if_any().is_none(), "an inactive camera");
        rig.get_mut::<Camera>(camera).is_active = true;
        rig.frame();
        assert_eq!(picture(rig, technique), good[i], "{technique:?}, active again");

        // In every frame another technique, without waiting.
        for &other in techniques {
            rig.set(|restir| restir.technique = other);
            assert!(rig.next_if_any().is_none_or(|picture| picture.is_finite()), "{technique:?}, then {other:?}");
        }
        assert_eq!(picture(rig, technique), good[i], "{technique:?} after a switch in every frame");
        assert_no_errors(rig, "switched");
    }
}
