//! What debug views count is what happened: rays by the frame's own counters, bounces where their number is known.

use crate::support::{app::*, small_scenes::room};
use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_restir::{DebugView, Restir, Technique};

const TECHNIQUES: [Technique; 4] = [Technique::Reference, Technique::Di, Technique::Gi, Technique::Pt];

/// A view of the first frame of a history, whose random numbers are always the same.
fn first_frame(rig: &mut Rig, view: DebugView) -> Picture {
    rig.set(|r| r.debug_view = view);
    rig.until_ready();
    // Counters come back some frames late: those before are the same frame.
    for _ in 0..4 {
        rig.set(|r| r.reset = true);
        rig.frame();
    }
    rig.set(|r| r.reset = true);
    rig.next()
}

#[test]
fn rays_of_the_pixels_add_up_to_the_rays_of_the_frame() {
    let Some(mut rig) = Rig::new(40, 24) else { return };
    room(&mut rig);
    for technique in TECHNIQUES {
        rig.set(|r| *r = Restir { technique, ..plain() });
        rig.set(|r| r.bounces = 3);
        let picture = first_frame(&mut rig, DebugView::Rays);
        let counted: f64 = picture.pixels.iter().map(|p| f64::from(p[0])).sum();
        let report = rig.report();
        assert!(report.rays > 960, "{technique:?}: {} rays", report.rays);
        assert_eq!(counted, report.rays as f64, "{technique:?}");
        // As many as without the view.
        first_frame(&mut rig, DebugView::Off);
        assert_eq!(rig.report().rays, report.rays, "{technique:?}");
    }
}

#[test]
fn sums_of_frames_show_their_mean_number_of_rays() {
    let Some(mut rig) = Rig::new(24, 16) else { return };
    room(&mut rig);
    for technique in TECHNIQUES {
        rig.set(|r| *r = Restir { technique, accumulate: true, debug_view: DebugView::Rays, ..plain() });
        rig.until_ready();
        rig.set(|r| r.reset = true);
        let one = rig.next();
        rig.frames(14);
        let mean = rig.next();
        assert_eq!((one.samples, mean.samples), (1, 16), "{technique:?}");
        // The first frame of a history has nothing to reuse.
        let [one, mean] = [one.mean(), mean.mean()];
        assert!(one <= 1.2 * mean && mean < 8.0 * one, "{technique:?}: {one}, then {mean}");
    }
}

#[test]
fn bounces_are_counted_where_their_number_is_known() {
    let Some(mut rig) = Rig::new(32, 16) else { return };
    rig.insert(rig.camera, sky(1.0));
    // Left a wall that lets everything go after one event, right one that takes everything, a gap between them.
    rig.spawn(square(1.8), lambert(1.0), Transform::from_xyz(-1.2, 0.0, 0.0));
    rig.spawn(square(1.8), lambert(0.0), Transform::from_xyz(1.2, 0.0, 0.0));
    rig.insert(rig.camera, orthographic(4.0, 2.0));
    for technique in TECHNIQUES {
        rig.set(|r| *r = Restir { technique, debug_view: DebugView::Bounces, bounces: 5, ..plain() });
        let picture = rig.picture(1);
        let [white, black, sky] = [(6, 8), (26, 8), (16, 8)].map(|(x, y)| picture.at(x, y));
        assert_eq!([white, black, sky], [Vec3::ONE, Vec3::ZERO, Vec3::ZERO], "{technique:?}");
    }
    // Within a white box a path goes on until it is told to stop; two times without roulette.
    let room = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(1.0) };
    rig.spawn(Cuboid::from_length(30.0), room, Transform::default());
    for bounces in [0, 1, 2] {
        rig.set(|r| *r = Restir { debug_view: DebugView::Bounces, bounces, ..plain() });
        let sky = rig.picture(4).at(16, 8);
        assert_eq!(sky, Vec3::splat(bounces as f32));
    }
    rig.set(|r| r.bounces = 20);
    let mean = rig.picture(64).at(16, 8).x;
    // Roulette lets 0.95 of them go on from the third time: 2 + 0.95 + 0.95² + ...
    let expected: f32 = 2.0 + (1..=18).map(|k| 0.95f32.powi(k)).sum::<f32>();
    assert!((mean - expected).abs() < 4.0, "{mean}, expected {expected}");
    rig.assert_sound();
}

#[test]
fn the_scale_of_debug_views_changes_the_picture_and_no_value() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, 1.0));
    rig.insert(rig.camera, (orthographic(1.0, 1.0), Tonemapping::None));
    let target = rig.target.clone();
    for (scale, expected) in [(1.0, 188), (0.5, 137), (2.0, 255), (0.0, 0), (f32::NAN, 188)] {
        rig.set(|r| (r.debug_scale, r.debug_view) = (scale, DebugView::Albedo));
        rig.until_ready();
        let drawn = rig.drawn(&target)[0][0];
        assert!(drawn.abs_diff(expected) <= 1, "{drawn} at scale {scale}");
        assert!((rig.next().centre().x - 0.5).abs() < 1e-5, "the value at scale {scale}");
    }
    // Light is exposed, not scaled.
    rig.insert(rig.camera, sky(0.5));
    rig.set(|r| (r.debug_scale, r.debug_view, r.bounces) = (0.01, DebugView::Off, 0));
    rig.spawn(square(20.0), lamp(0.5, 0.5, 0.5), Transform::from_xyz(0.0, 0.0, 2.0));
    rig.until_ready();
    let drawn = rig.drawn(&target)[0][0];
    assert!(drawn.abs_diff(188) <= 1, "{drawn}");
}
