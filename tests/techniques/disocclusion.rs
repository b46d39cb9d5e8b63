//! Surfaces that come into view from behind a moving object: with dual motion vectors they take the history of the surface beside it.

use crate::support::{app::*, proof::Subject, reuse_settings::*};
use bevy::prelude::*;
use bevy_restir::{DebugView, Direct, Jitter, Reuse, VisibilityReuse, testing::shader_library::ShaderEdit};

const SIZE: u32 = 48;

/// Pixels of a wall without a history, over six frames in which a bar passes in front of it or the camera moves past the bar.
fn pixels_without_history(rig: &mut Rig, bar: Entity, dual_motion: bool, camera_moves: bool) -> usize {
    let reuse = Reuse {
        dual_motion,
        spatial_samples: 0,
        disocclusion_samples: 0,
        confidence_cap: 20.0,
        ..Reuse::SPATIOTEMPORAL
    };
    rig.set(|r| {
        Direct { reuse, ..di::all_reuse() }.apply_to(r);
        (r.debug_view, r.jitter) = (DebugView::ReservoirConfidence, Jitter::Never);
    });
    let camera = rig.camera;
    let place = |rig: &mut Rig, x: f32| {
        let (eye, at) = if camera_moves { (-x, 0.0) } else { (0.0, x) };
        *rig.get_mut::<Transform>(camera) = Transform::from_xyz(eye, 0.0, 4.0);
        rig.get_mut::<Transform>(bar).translation.x = at;
    };
    place(rig, -0.6);
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frames(4);
    let mut found = 0;
    for i in 0..6 {
        place(rig, -0.6 + 0.2 * (i + 1) as f32);
        // Surfaces at the border of the image were outside of it in the last frame.
        let inside = |at: &UVec2| (8..SIZE - 8).contains(&at.x);
        found += rig.next().iter().filter(|(at, c)| inside(at) && c.x == 1.0).count();
    }
    found
}

/// A place beside the bar showed the same wall in the last frame.
#[test]
fn surfaces_behind_moving_objects_have_the_history_of_the_surface_beside_them() {
    let Some(mut rig) = Rig::new(SIZE, SIZE) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -2.0));
    let bar = Transform::from_xyz(0.0, 0.0, 0.0).with_scale(Vec3::new(1.0, 20.0, 1.0));
    let bar = rig.spawn(square(0.5), lambert(0.5), bar);
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    for camera_moves in [false, true] {
        let without = pixels_without_history(&mut rig, bar, false, camera_moves);
        let with = pixels_without_history(&mut rig, bar, true, camera_moves);
        eprintln!("camera moves: {camera_moves}: {without} pixels without history, {with} with dual motion vectors");
        assert!(without > 50 && 10 * with < without, "camera moves: {camera_moves}: {without} to {with}");
    }
    rig.assert_sound();
}

/// Lit pixels in the shadow of a screen beside the picture, at least two pixels from its edge, while a bar passes in front of that edge.
fn lit_pixels_in_shadow(rig: &mut Rig, bar: Entity) -> usize {
    rig.get_mut::<Transform>(bar).translation.x = -0.8;
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frames(4);
    let mut lit = 0;
    for i in 1..=5 {
        rig.get_mut::<Transform>(bar).translation.x = -0.8 + 0.4 * i as f32;
        lit += rig.next().iter().filter(|(at, c)| at.x >= SIZE / 2 + 2 && c.x > 0.0).count();
    }
    lit
}

/// A place beside an object is not the same surface: its shadow is not that of the pixel.
#[test]
fn shadows_behind_moving_objects_are_not_those_of_the_place_beside_them() {
    let Some(mut rig) = Rig::new(SIZE, SIZE) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -2.0));
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(4.0, 0.0, 0.0)));
    // The wall is in shadow to the right of the center of the picture.  The light shines along the bar.
    let screen =
        Transform::from_xyz(3.0, 0.0, -1.25).with_rotation(Quat::from_rotation_y(core::f32::consts::FRAC_PI_2));
    rig.spawn(
        Rectangle::new(1.5, 20.0),
        StandardMaterial { double_sided: true, cull_mode: None, ..lambert(0.0) },
        screen,
    );
    let bar = rig.spawn(square(0.5), lambert(0.5), Transform::from_scale(Vec3::new(1.0, 20.0, 1.0)));
    let reuse = Reuse { spatial_samples: 0, disocclusion_samples: 0, ..Reuse::SPATIOTEMPORAL };
    let visibility = VisibilityReuse::Decoupled;
    rig.set(|r| {
        Direct { reuse, visibility, visibility_radius: 0.0, ..di::all_reuse() }.apply_to(r);
        r.jitter = Jitter::Never;
    });
    assert_eq!(lit_pixels_in_shadow(&mut rig, bar), 0);
    let anywhere = ShaderEdit {
        module: "pass/reuse.wgsl",
        from: "select(0.0, SAME_SURFACE_RADIUS, is_temporal)",
        to: "select(0.0, 1.0e9, is_temporal)",
    };
    plant_edits(&mut rig.app, &[anywhere]);
    let lit = lit_pixels_in_shadow(&mut rig, bar);
    assert!(lit > 30, "{lit}");
}
