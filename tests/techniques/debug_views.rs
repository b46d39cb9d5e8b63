//! Debug views show correct counts: rays as in the frame's own counters, and bounces in scenes where their number is known.

use crate::support::{app::*, reuse_settings::paths, small_scenes::room};
use bevy::{core_pipeline::tonemapping::Tonemapping, prelude::*};
use bevy_restir::{DebugView, Paths, Restir, Technique};

const TECHNIQUES: [Technique; 4] = [Technique::Reference, Technique::Di, Technique::Gi, Technique::Pt];

/// A debug view of the first frame after a reset, which always has the same random numbers.
fn first_frame(rig: &mut Rig, view: DebugView) -> Picture {
    rig.set(|r| r.debug_view = view);
    rig.until_ready();
    // Counters come back some frames late; the frames before are equal.
    for _ in 0..4 {
        rig.set(|r| r.reset = true);
        rig.frame();
    }
    rig.set(|r| r.reset = true);
    rig.next()
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn rays_of_all_pixels_sum_to_the_rays_of_the_frame() {
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
        // The view itself traces no rays.
        first_frame(&mut rig, DebugView::Off);
        assert_eq!(rig.report().rays, report.rays, "{technique:?}");
        // Accumulated frames show their mean number of rays.
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
fn bounce_counts_equal_the_known_numbers() {
    let Some(mut rig) = Rig::new(32, 16) else { return };
    rig.insert(rig.camera, sky(1.0));
    // Left: a wall whose reflected rays all escape after one event.  Right: a wall that absorbs everything.  Between them: a gap.
    let walls = [(1.0, -1.2), (0.0, 1.2)]
        .map(|(albedo, x)| rig.spawn(square(1.8), lambert(albedo), Transform::from_xyz(x, 0.0, 0.0)));
    rig.insert(rig.camera, orthographic(4.0, 2.0));
    for technique in TECHNIQUES {
        rig.set(|r| *r = Restir { technique, debug_view: DebugView::Bounces, bounces: 5, ..plain() });
        let picture = rig.picture(1);
        let [white, black, sky] = [(6, 8), (26, 8), (16, 8)].map(|(x, y)| picture.at(x, y));
        assert_eq!([white, black, sky], [Vec3::ONE, Vec3::ZERO, Vec3::ZERO], "{technique:?}");
    }
    // In a white box a path ends only at the bounce limit; for the first two events there is no Russian roulette.
    for wall in walls {
        rig.app.world_mut().despawn(wall);
    }
    let room = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(1.0) };
    rig.spawn(Cuboid::from_length(30.0), room, Transform::default());
    for bounces in [0, 1, 2] {
        rig.set(|r| *r = Restir { debug_view: DebugView::Bounces, bounces, ..plain() });
        let picture = rig.picture(4);
        assert!(picture.iter().all(|(_, c)| c == Vec3::splat(bounces as f32)), "{bounces}");
    }
    rig.set(|r| r.bounces = 20);
    let mean = rig.picture(64).mean();
    // From the third event on, Russian roulette continues 0.95 of the paths: 2 + 0.95 + 0.95² + ...  The number of events has a standard
    // deviation of 6.6, its mean over 32,768 paths one of 0.037.
    let expected: f64 = 2.0 + (1..=18).map(|k| 0.95f64.powi(k)).sum::<f64>();
    assert!((mean - expected).abs() < 5.0 * 0.037, "{mean}, expected {expected}");
    rig.assert_sound();
}

#[test]
fn the_scale_of_debug_views_changes_the_display_and_no_value() {
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, 1.0));
    rig.insert(rig.camera, (orthographic(1.0, 1.0), Tonemapping::None));
    let target = rig.target.clone();
    for (scale, expected) in [(1.0, 188), (0.5, 137), (2.0, 255), (0.0, 0), (f32::NAN, 188)] {
        rig.set(|r| (r.debug_scale, r.debug_view) = (scale, DebugView::Albedo));
        rig.until_ready();
        let drawn = rig.drawn(&target)[0][0];
        assert!(drawn.abs_diff(expected) <= 1, "{drawn} at scale {scale}");
        assert!((rig.next().center().x - 0.5).abs() < 1e-5, "the value at scale {scale}");
    }
    // The scale does not apply to light, which is exposed.
    rig.insert(rig.camera, sky(0.5));
    rig.set(|r| (r.debug_scale, r.debug_view, r.bounces) = (0.01, DebugView::Off, 0));
    rig.spawn(square(20.0), lamp(0.5, 0.5, 0.5), Transform::from_xyz(0.0, 0.0, 2.0));
    rig.until_ready();
    let drawn = rig.drawn(&target)[0][0];
    assert!(drawn.abs_diff(188) <= 1, "{drawn}");
}

/// A path that next-event estimation ends at a point light weighs 1 over the probability of choosing that light.
#[test]
#[ignore = "second tier: ./run test --more"]
fn weights_of_paths_to_point_lights_are_one_over_their_probability() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    for (x, intensity) in [(-2.0, 200.0), (2.0, 100.0)] {
        rig.spawn_bundle((PointLight { intensity, ..default() }, Transform::from_xyz(x, 0.0, 4.0)));
    }
    let paths = Paths { candidates: 1, ..paths::candidates_only() };
    rig.set(|r| *r = Restir { technique: Technique::Pt, paths, ..plain() });
    let weights = rig.debug(DebugView::PathWeights);
    let near = |value: f32| weights.iter().filter(|(_, w)| (w.x / value - 1.0).abs() < 1e-3).count();
    // Lights are chosen by their power.
    let (bright, dim) = (near(1.5), near(3.0));
    assert_eq!(bright + dim, 1024, "{bright} for the bright light, {dim} for the dim one");
    assert!(dim > 200 && 2 * bright > 3 * dim, "{bright} for the bright light, {dim} for the dim one");
    rig.assert_sound();
}
