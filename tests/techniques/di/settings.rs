//! Every setting of ReSTIR DI has exactly its documented effect: on ray counts, on views of the reservoirs, on pixels bit by bit.

use crate::support::{
    app::*,
    expected_radiance::both_sides,
    reuse_settings::{di, paths, pixels},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    BiasCorrection, DebugView, Direct, Jitter, ReservoirLayout, Restir, Reuse, ReuseOrder, Technique, VisibilityReuse,
    pass_names,
};

fn direct(rig: &mut Rig, direct: Direct) {
    rig.set(|r| *r = Restir { technique: Technique::Di, direct, ..plain() });
    rig.until_ready();
}

fn lit_room(width: u32, height: u32) -> Option<Rig> {
    let mut rig = Rig::new(width, height)?;
    room(&mut rig);
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
    Some(rig)
}

/// A debug view of the reservoirs after some frames.
fn reservoirs(rig: &mut Rig, view: DebugView, frames: u32) -> Picture {
    rig.set(|r| r.debug_view = view);
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frames(frames - 1);
    rig.next()
}

#[test]
fn every_reservoir_layout_gives_the_same_picture() {
    let Some(mut rig) = lit_room(43, 29) else { return };
    let mut of = |layout, order| {
        direct(&mut rig, Direct { reuse: Reuse { order, ..di::all_reuse().reuse }, ..di::all_reuse() });
        rig.set(|r| (r.research.reservoir_layout, r.reset) = (layout, true));
        rig.frames(3);
        rig.next()
    };
    for order in [ReuseOrder::Spatiotemporal, ReuseOrder::TemporalThenSpatial] {
        let rows = of(ReservoirLayout::Rows, order);
        use ReservoirLayout::*;
        for layout in [Columns, Tiles2, Tiles4, Tiles8, Tiles40] {
            assert!(of(layout, order) == rows, "{layout:?}, {order:?}");
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reused_visibility_saves_up_to_half_of_the_rays() {
    // Wyman and Panteleev 2021, 7.3: from two rays per pixel, without reuse, down to one.  The scene is a wall, so that every neighbor is
    // accepted.
    let Some(mut rig) = Rig::new(160, 120) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    rig.spawn(square(1.0), lamp(5.0, 5.0, 5.0), Transform::from_xyz(0.0, 4.0, 4.0).looking_to(Vec3::Z, Vec3::Y));
    let mut rays = |visibility_radius| {
        let visibility_radius = pixels(visibility_radius, 120);
        let paper = Direct {
            reuse: di::one_neighbor(pixels(30.0, 120)),
            visibility: VisibilityReuse::Decoupled,
            bias_correction: BiasCorrection::HeuristicsAndMis,
            bsdf_candidate: false,
            visibility_radius,
            ..Default::default()
        };
        direct(&mut rig, paper);
        rig.frames(12);
        rig.report().rays as f64
    };
    let of = [0.0, 15.0, 20.0, 25.0, 1e6].map(&mut rays);
    assert!(of.windows(2).all(|pair| pair[1] < pair[0]), "{of:?}");
    // Candidates only.
    rig.set(|r| (r.direct.reuse.temporal, r.direct.reuse.spatial_samples) = (false, 0));
    rig.until_ready();
    rig.frames(12);
    let candidates = rig.report().rays as f64;
    assert!(
        (of[4] / candidates - 1.0).abs() < 0.02,
        "visibility always reused: {of:?}, candidates alone: {candidates}"
    );
    eprintln!("rays: {of:?}, candidates alone: {candidates}");
    assert!(
        (1.7..=2.0).contains(&(of[0] / candidates)),
        "visibility never reused: {of:?}, candidates alone: {candidates}"
    );
}

#[test]
fn without_visibility_no_ray_is_traced() {
    let Some(mut rig) = lit_room(32, 32) else { return };
    for order in [ReuseOrder::Spatiotemporal, ReuseOrder::TemporalThenSpatial] {
        direct(
            &mut rig,
            Direct {
                reuse: Reuse { order, spatial_iterations: 2, ..di::all_reuse().reuse },
                visibility: VisibilityReuse::Ignored,
                bsdf_candidate: false,
                ..di::all_reuse()
            },
        );
        rig.frames(4);
        assert_eq!(rig.report().rays, 0, "{order:?}");
    }
}

/// Where all neighbors accept each other's samples, only these rays keep light out of a shadow.
#[test]
fn shadows_are_black_where_rays_decide_what_is_shaded() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    // The shade is behind the camera.
    rig.spawn(square(1.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, 6.0));
    rig.spawn_bundle((PointLight { intensity: 1000.0, ..default() }, Transform::from_xyz(0.3, 0.2, 12.0)));
    let exact = rig.picture(1);
    let dark = |c: Vec3| c == Vec3::ZERO;
    let shadowed = exact.iter().filter(|(_, c)| dark(*c)).count();
    assert!((50..400).contains(&shadowed), "{shadowed} pixels in shadow");
    for visibility in [VisibilityReuse::Shading, VisibilityReuse::Decoupled] {
        direct(&mut rig, Direct { visibility, bsdf_candidate: false, ..di::all_reuse() });
        rig.frames(4);
        let found = rig.next();
        let leaks = found.iter().zip(exact.iter()).filter(|((_, c), (_, wanted))| dark(*wanted) && !dark(*c)).count();
        assert_eq!(leaks, 0, "{visibility:?}: lit pixels in shadow");
    }
}

/// All samples of a single light without an area are the same, so that the first one suffices.
#[test]
fn a_single_point_light_is_sampled_once() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    let light = |x| (PointLight { intensity: 1000.0, ..default() }, Transform::from_xyz(x, 0.2, 2.0));
    rig.spawn_bundle(light(0.3));
    let differs = |rig: &mut Rig| {
        let [one, many] = [1, 32].map(|candidates| {
            direct(rig, Direct { candidates, ..di::all_reuse() });
            rig.picture(2)
        });
        one != many
    };
    assert!(!differs(&mut rig), "one light");
    rig.spawn_bundle(light(-1.0));
    assert!(differs(&mut rig), "two lights");
}

#[test]
fn confidence_grows_by_a_frame_up_to_its_cap() {
    let Some(mut rig) = lit_room(24, 24) else { return };
    direct(&mut rig, Direct { reuse: Reuse { confidence_cap: 4.0, ..di::temporal().reuse }, ..di::temporal() });
    for (frames, expected) in [(1, 1.0), (2, 2.0), (4, 4.0), (5, 5.0), (9, 5.0)] {
        let view = reservoirs(&mut rig, DebugView::ReservoirConfidence, frames);
        let lit = view.iter().filter(|(_, c)| c.x > 0.0).count();
        assert!(lit > 300 && view.iter().all(|(_, c)| c.x == 0.0 || c.x == expected), "{frames} frames");
    }
}

#[test]
fn the_history_of_an_emitter_outlives_lights_that_come_and_go() {
    let Some(mut rig) = lit_room(24, 24) else { return };
    let light = PointLight { intensity: 1.0, ..default() };
    // One light of each kind stays, so that the shaders stay the same.
    rig.spawn_bundle((light, Transform::from_xyz(0.9, 0.9, 0.9)));
    direct(&mut rig, di::temporal());
    rig.set(|r| r.debug_view = DebugView::ReservoirConfidence);
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frames(3);
    let check = |rig: &mut Rig, frames: f32, lights: u64| {
        let view = rig.next();
        assert_eq!(rig.report().lights, lights);
        let lit = view.iter().filter(|(_, c)| c.x == frames).count();
        assert!(lit > 300, "{lit} pixels have a history of {frames} frames");
    };
    check(&mut rig, 4.0, 3);
    let other = rig.spawn_bundle((light, Transform::from_xyz(-0.9, 0.9, 0.9)));
    check(&mut rig, 5.0, 4);
    rig.insert(other, Visibility::Hidden);
    check(&mut rig, 6.0, 3);
    rig.insert(other, Visibility::Visible);
    check(&mut rig, 7.0, 4);
    rig.app.world_mut().despawn(other);
    check(&mut rig, 8.0, 3);
}

#[test]
fn both_orders_sum_the_confidence_of_all_reused_samples() {
    let Some(mut rig) = lit_room(24, 24) else { return };
    let mut most = |settings: Direct, frames| {
        direct(&mut rig, settings);
        let view = reservoirs(&mut rig, DebugView::ReservoirConfidence, frames);
        view.iter().map(|(_, c)| c.x).fold(0.0, f32::max)
    };
    let two = Direct {
        reuse: Reuse { spatial_iterations: 2, confidence_cap: 60.0, ..di::all_reuse().reuse },
        bias_correction: BiasCorrection::UnbiasedMis,
        ..di::all_reuse()
    };
    // 1 + (temporal + 2 samples + 2 samples) · 1; then 1 + 5 · 6.
    assert_eq!(most(two.clone(), 2), 6.0);
    assert_eq!(most(two.clone(), 3), 31.0);
    // (1 + 0) · 3 · 3; then (1 + 9) · 3 · 3.
    let classic = Direct { reuse: Reuse { order: ReuseOrder::TemporalThenSpatial, ..two.reuse.clone() }, ..two };
    assert_eq!(most(classic.clone(), 1), 9.0);
    assert_eq!(most(classic, 2), 90.0);
}

#[test]
fn each_spatial_iteration_is_a_pass() {
    let names = |order, rounds, temporal, spatial_taps| {
        let direct = Direct {
            reuse: Reuse {
                order,
                spatial_iterations: rounds,
                temporal,
                spatial_samples: spatial_taps,
                ..Reuse::SPATIOTEMPORAL
            },
            ..Default::default()
        };
        let all = pass_names(&Restir { technique: Technique::Di, direct, ..default() }, default());
        all.iter().filter(|name| name.starts_with("di_reuse")).count()
    };
    let (joint, classic) = (ReuseOrder::Spatiotemporal, ReuseOrder::TemporalThenSpatial);
    assert_eq!([1, 4].map(|rounds| names(joint, rounds, true, 1)), [1, 4]);
    assert_eq!([1, 4].map(|rounds| names(classic, rounds, true, 1)), [2, 5]);
    assert_eq!([names(classic, 2, false, 1), names(classic, 2, true, 0), names(joint, 2, true, 0)], [2, 1, 1]);
}

#[test]
fn disocclusions_use_more_neighbors() {
    let Some(mut rig) = lit_room(48, 48) else { return };
    let mut after_a_jump = |order, disocclusion_samples| {
        direct(
            &mut rig,
            Direct {
                reuse: Reuse {
                    order,
                    disocclusion_samples,
                    spatial_samples: 1,
                    spatial_iterations: 1,
                    confidence_cap: 5.0,
                    radius: pixels(12.0, 48),
                    ..di::all_reuse().reuse
                },
                ..di::all_reuse()
            },
        );
        rig.set(|r| r.debug_view = DebugView::ReservoirConfidence);
        let place = |rig: &mut Rig, x: f32| {
            let camera = rig.camera;
            *rig.get_mut::<Transform>(camera) =
                Transform::from_xyz(x, 0.2, 4.0).looking_at(Vec3::new(x - 0.3, -0.2, 0.0), Vec3::Y);
        };
        place(&mut rig, 0.3);
        rig.until_ready();
        rig.set(|r| r.reset = true);
        rig.frames(8);
        place(&mut rig, 0.8);
        rig.next()
    };
    for order in [ReuseOrder::Spatiotemporal, ReuseOrder::TemporalThenSpatial] {
        let (few, many) = (after_a_jump(order, 1), after_a_jump(order, 5));
        let pairs: Vec<(f32, f32)> = few.iter().zip(many.iter()).map(|((_, a), (_, b))| (a.x, b.x)).collect();
        let gained = pairs.iter().filter(|(few, many)| many > few).count();
        assert!(gained > 40 && pairs.iter().all(|(few, many)| many >= few), "{order:?}: {gained} gained");
        // Where both default neighbors are accepted, nothing is added.
        assert!(pairs.iter().filter(|(few, _)| *few == 11.0).all(|(few, many)| few == many), "{order:?}");
    }
}

/// A change of exposure affects no path.  Another projection shows other surfaces.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_change_of_exposure_keeps_the_history_and_one_of_projection_resets_it() {
    let Some(mut rig) = lit_room(24, 24) else { return };
    direct(&mut rig, di::all_reuse());
    rig.app.insert_resource(ClearColor(Color::linear_rgb(0.2, 0.3, 0.4)));
    let kept = reservoirs(&mut rig, DebugView::ReservoirConfidence, 8).mean();
    rig.insert(rig.camera, bevy::camera::Exposure { ev100: 3.0 });
    let exposed = rig.next().mean();
    assert!(exposed > 0.8 * kept && kept > 10.0, "{kept} to {exposed}");
    rig.insert(rig.camera, orthographic(3.0, 3.0));
    let fresh = rig.next().mean();
    assert!(fresh < 0.5 * kept, "{kept} to {fresh}");
}

/// Jitter must not move the history of a picture at rest: at a border it would leave the image.
#[test]
fn a_camera_at_rest_keeps_the_history_of_every_pixel_under_jitter() {
    let Some(mut rig) = Rig::new(24, 24) else { return };
    rig.spawn(square(40.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 100.0, ..default() }, Transform::from_xyz(0.0, 0.0, 3.0)));
    rig.insert(rig.camera, orthographic(24.0, 24.0));
    // Further attempts would find another history.
    let reuse = Reuse { temporal_attempts: 1, ..di::temporal().reuse };
    direct(&mut rig, Direct { reuse, ..di::temporal() });
    rig.set(|r| (r.debug_view, r.jitter) = (DebugView::ReservoirConfidence, Jitter::Always));
    rig.until_ready();
    rig.set(|r| r.reset = true);
    rig.frame();
    let lost: usize = (0..8).map(|_| rig.next().iter().filter(|(_, c)| c.x == 1.0).count()).sum();
    assert_eq!(lost, 0, "pixels without a history in eight frames");
}

#[test]
fn debug_views_show_the_content_of_reservoirs() {
    let Some(mut rig) = lit_room(32, 32) else { return };
    direct(&mut rig, Direct { visibility: VisibilityReuse::Decoupled, ..di::all_reuse() });
    let mut of = |view| reservoirs(&mut rig, view, 6);
    let (lights, points) = (of(DebugView::ReservoirLights), of(DebugView::ReservoirPoints));
    let (weights, seen) = (of(DebugView::ReservoirWeights), of(DebugView::ReservoirVisibility));
    let mut colors: Vec<[u32; 3]> = lights.pixels.iter().map(|p| p.map(f32::to_bits)).collect();
    colors.sort_unstable();
    colors.dedup();
    assert_eq!(colors.len(), 3, "two triangles and no sample");
    assert!(points.iter().all(|(_, p)| (0.0..=1.0).contains(&p.x) && (0.0..=1.0).contains(&p.y)));
    for ((at, weight), (_, seen)) in weights.iter().zip(seen.iter()) {
        assert_eq!(weight.x > 0.0, seen != Vec3::ZERO, "{at}");
    }
    let count = |color: Vec3| seen.iter().filter(|(_, c)| *c == color).count();
    assert!(count(Vec3::Y) > 100 && count(Vec3::X) > 10, "{} visible, {} occluded", count(Vec3::Y), count(Vec3::X));
}

#[test]
fn reservoirs_take_32_bytes_per_pixel() {
    let Some(mut rig) = lit_room(40, 40) else { return };
    direct(&mut rig, di::all_reuse());
    rig.set(|r| r.research.reservoir_layout = ReservoirLayout::Tiles4);
    rig.until_ready();
    let report = rig.report();
    assert_eq!(report.reservoir_bytes_per_pixel, 32);
    let of = |name| report.memory.iter().find(|(n, _)| *n == name).map(|(_, bytes)| bytes / 1600);
    // The history also needs the previous visibility buffer.
    assert_eq!([of("di reservoirs"), of("last visibility")], [Some(32), Some(8)]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn rays_that_can_find_no_light_are_not_traced() {
    let Some(mut rig) = Rig::new(32, 32) else { return };
    rig.insert(rig.camera, orthographic(1.0, 1.0));
    rig.spawn(square(4.0), lambert(0.5), Transform::default());
    rig.spawn_bundle((PointLight { intensity: 500.0, ..default() }, Transform::from_xyz(0.0, 0.0, 1.0)));
    let rays = |rig: &mut Rig, technique| {
        let (direct, paths) = (di::candidates_only(), paths::candidates_only());
        rig.set(|r| *r = Restir { technique, bounces: 1, direct, paths, ..plain() });
        rig.until_ready();
        rig.frames(4);
        rig.report().rays as f64 / 1024.0
    };
    let techniques = [Technique::Reference, Technique::Di, Technique::Pt];
    for technique in techniques {
        let traced = rays(&mut rig, technique);
        assert!((0.5..=1.0).contains(&traced), "{technique:?}: {traced} rays a pixel, although no surface is bright");
    }
    rig.spawn(square(1.0), both_sides(1.0), Transform::from_xyz(3.0, 0.0, 1.0));
    for technique in techniques {
        let traced = rays(&mut rig, technique);
        assert!(traced > 1.5, "{technique:?}: {traced} rays a pixel");
    }
    rig.assert_sound();
}
