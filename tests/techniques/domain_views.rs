//! Debug views of single domains show the documented values: of light that enters translucent bodies, and of light paths.

use crate::support::{
    app::*,
    oracle::subsurface::Origin,
    reuse_settings::{paths, subsurface},
};
use bevy::prelude::*;
use bevy_restir::{
    Bdpt, DebugView, Direct, LightTechniques, Restir, Reuse, Subsurface, SubsurfaceSampling, SubsurfaceShift,
    Technique, testing::replace_pass_shader,
};
use core::f32::consts::{FRAC_PI_4, PI, SQRT_2};
use glam::DVec3;

/// Width and height of all pictures, pixels.  Views of shifts look 8 pixels to the right, which is half of that.
const SIZE: u32 = 16;
/// Lengths d of all bodies, m.
const LENGTHS: [f32; 3] = [0.1, 0.05, 0.02];

const RED: Vec3 = Vec3::X;
const GREEN: Vec3 = Vec3::Y;
const BLUE: Vec3 = Vec3::Z;
const YELLOW: Vec3 = Vec3::new(1.0, 1.0, 0.0);

/// Reuse of light in bodies from the last frame alone, where each pixel takes the sample of the same pixel.
fn in_bodies(shift: SubsurfaceShift) -> Restir {
    let sampling = subsurface::temporal();
    let reuse = Reuse { bilinear: false, ..sampling.reuse };
    Restir {
        technique: Technique::Di,
        direct: Direct { subset_count: 0, ..default() },
        subsurface: SubsurfaceSampling { shift, reuse, ..sampling },
        ..plain()
    }
}

/// A body that fills the window of the camera, whose side is given in meters, and light that shines in one direction.
fn spawn_body(rig: &mut Rig, mesh: impl Into<Mesh>, place: Transform, shines: Vec3, window: f32) -> [Entity; 2] {
    rig.insert(rig.camera, orthographic(window, window));
    let body = rig.spawn(mesh, lambert(0.8), place);
    // For this albedo, d is the mean free path over 1.1.
    rig.insert(body, Subsurface { mean_free_path: 1.1 * Vec3::from(LENGTHS), weight: 1.0 });
    let light = DirectionalLight { illuminance: 3.0, ..default() };
    let light = rig.spawn_bundle((light, Transform::default().looking_to(shines, Vec3::Y)));
    [body, light]
}

fn despawn(rig: &mut Rig, entities: impl IntoIterator<Item = Entity>) {
    for entity in entities {
        rig.app.world_mut().despawn(entity);
    }
}

/// A debug view after this number of frames since a reset, which always have the same random numbers.
fn view(rig: &mut Rig, debug_view: DebugView, frames: u32) -> Picture {
    rig.set(|r| r.debug_view = debug_view);
    rig.picture(frames)
}

/// The pixels that are not black.
fn samples(picture: &Picture) -> impl Iterator<Item = (UVec2, Vec3)> {
    picture.iter().filter(|(_, color)| *color != Vec3::ZERO)
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn views_of_light_in_bodies_show_the_stored_samples() {
    let Some(mut rig) = Rig::new(SIZE, SIZE) else { return };
    light_crosses_a_body(&mut rig);
    light_enters_nearby(&mut rig);
    light_misses_the_other_face(&mut rig);
    rig.assert_sound();
}

/// Two squares of one body look away from each other, 3 d apart, and light shines on the one that the camera does not see.  All its points are
/// far, and every sample can be shifted to every pixel.
fn light_crosses_a_body(rig: &mut Rig) {
    const SIDE: f32 = 0.04;
    let half = 1.5 * LENGTHS[0];
    let mut mesh = square(SIDE).translated_by(half * Vec3::Z);
    let back = square(SIDE).rotated_by(Quat::from_rotation_y(PI)).translated_by(-half * Vec3::Z);
    mesh.merge(&back).expect("both squares have the same attributes");
    rig.set(|r| *r = in_bodies(SubsurfaceShift::Hybrid));
    let body = spawn_body(rig, mesh, Transform::default(), Vec3::Z, SIDE);

    for (frames, expected) in [(1, 1.0), (4, 4.0), (14, 9.0)] {
        // The cap of the history is 8.
        let confidence = view(rig, DebugView::SubsurfaceConfidence, frames);
        assert!(confidence.iter().all(|(_, c)| c == Vec3::splat(expected)), "{frames}: {:?}", confidence.center());
    }
    let distances = view(rig, DebugView::SubsurfaceDistances, 16);
    let filled: Vec<UVec2> = samples(&distances).map(|(at, _)| at).collect();
    assert!(filled.len() > 80, "{} pixels have a sample", filled.len());
    // The diagonal of a square is 0.57 d.
    assert!(samples(&distances).all(|(_, c)| (2.9999..3.06).contains(&c.x) && c == Vec3::splat(c.x)));
    for (debug_view, expected) in
        [(DebugView::SubsurfaceReconnections, GREEN), (DebugView::SubsurfaceShifts, Vec3::ONE)]
    {
        let picture = view(rig, debug_view, 16);
        assert!(samples(&picture).map(|(at, _)| at).eq(filled.iter().copied()), "{debug_view:?}");
        assert!(samples(&picture).all(|(_, c)| c == expected), "{debug_view:?}");
    }
    weights_are_inverse_densities(rig, SIDE);
    despawn(rig, body);
}

/// In the first frame there is one probe, and one of its hits is lit.  The weight is then one over the density of that point, in the measure
/// of its triangle.
fn weights_are_inverse_densities(rig: &mut Rig, side: f32) {
    let lengths = DVec3::from_array(LENGTHS.map(f64::from));
    let origin = Origin { position: DVec3::ZERO, frame: [DVec3::X, DVec3::Y, DVec3::Z], d: lengths };
    let area = f64::from(0.5 * side * side);
    let mut checked = 0;
    for seed in 0..6 {
        rig.set(|r| r.seed = seed);
        let distances = view(rig, DebugView::SubsurfaceDistances, 1);
        let weights = view(rig, DebugView::SubsurfaceWeights, 1);
        for ((at, distance), (_, weight)) in distances.iter().zip(weights.iter()) {
            assert_eq!(distance == Vec3::ZERO, weight == Vec3::ZERO, "{at}");
            // The distance across the axis; near the axis it is not known exactly.
            let across = lengths.x * (f64::from(distance.x).powi(2) - 9.0).max(0.0).sqrt();
            if across > 0.01 {
                let density = origin.density(DVec3::new(across, 0.0, -3.0 * lengths.x), DVec3::NEG_Z);
                let ratio = f64::from(weight.x) * area * density;
                assert!((ratio - 1.0).abs() < 0.01, "{at}: {ratio}");
                checked += 1;
            }
        }
    }
    assert!(checked > 20, "{checked} weights");
}

/// A square of a side of 1 d, whose right half lies in shadow, from 2 mm left of its middle on.
fn light_enters_nearby(rig: &mut Rig) {
    rig.set(|r| *r = in_bodies(SubsurfaceShift::Delayed));
    let body = spawn_body(rig, square(0.1), Transform::default(), Vec3::new(-1.0, 0.0, -1.0), 0.1);
    let blocker = rig.spawn(Cuboid::new(1.0, 1.0, 0.1), lambert(0.8), Transform::from_xyz(1.548, 0.0, 1.0));

    let distances = view(rig, DebugView::SubsurfaceDistances, 24);
    assert!(samples(&distances).count() > 80);
    assert!(samples(&distances).all(|(_, c)| c.x > 0.0 && c.x < 1.42));
    let reconnections = view(rig, DebugView::SubsurfaceReconnections, 24);
    assert!(samples(&reconnections).count() > 80);
    assert!(samples(&reconnections).all(|(_, c)| c == RED), "no two points are 2 d apart");
    let shifts = view(rig, DebugView::SubsurfaceShifts, 24);
    let of = |columns: core::ops::Range<u32>| samples(&shifts).filter(move |(at, _)| columns.contains(&at.x));
    // All samples of the left half move into the shadow.
    assert!(of(0..8).count() > 40);
    assert!(of(0..8).all(|(_, c)| c == YELLOW));
    // The last column has no pixel to the right, and is shifted to itself.
    assert!(of(15..16).count() > 0);
    assert!(of(15..16).all(|(_, c)| c == Vec3::ONE));
    despawn(rig, body.into_iter().chain([blocker]));
}

/// The edge of a large box, where light from the left shines on the left face alone.
fn light_misses_the_other_face(rig: &mut Rig) {
    let place = Transform::from_xyz(0.0, 0.0, -5.0 * SQRT_2).with_rotation(Quat::from_rotation_y(FRAC_PI_4));
    let body = spawn_body(rig, Cuboid::from_length(10.0), place, Vec3::X, 0.1);
    let shifts = view(rig, DebugView::SubsurfaceShifts, 8);
    // Samples of the left half are drawn again on the right face, which is dark, or pass the edge and find nothing.
    let left: Vec<Vec3> = samples(&shifts).filter(|(at, _)| at.x < 8).map(|(_, c)| c).collect();
    assert!(left.iter().all(|c| [RED, BLUE].contains(c)), "{left:?}");
    assert!(left.contains(&RED) && left.contains(&BLUE), "{left:?}");
    despawn(rig, body);
}

/// Passes that do not matter to the views of light paths; compiling them takes longer than running them.
const IDLE: [(&str, &str); 6] = [
    ("bdpt_candidates", "path_candidates"),
    ("bdpt_reuse", "reuse"),
    ("splats", "splats"),
    ("splats_forward", "splats_forward"),
    ("splats_gather", "splats_gather"),
    ("splats_reuse", "reuse"),
];

/// A spot in a white box: all light paths hit the wall that the camera sees, and go on from there.
#[test]
fn views_of_light_paths_count_those_that_are_seen_and_stored_vertices() {
    use LightTechniques::*;
    let Some(mut rig) = Rig::new(SIZE, SIZE) else { return };
    for (pass, entry) in IDLE {
        replace_pass_shader(&mut rig.app, pass, &format!("@compute @workgroup_size(8, 8)\nfn {entry}() {{}}\n"));
    }
    let walls = StandardMaterial { double_sided: true, cull_mode: None, ..lambert(1.0) };
    rig.spawn(Cuboid::from_length(12.0), walls, Transform::default());
    let angle: f32 = 0.3;
    rig.spawn_bundle(SpotLight { intensity: 60.0, outer_angle: angle, inner_angle: 0.1, ..default() });
    rig.insert(rig.camera, orthographic(6.0, 6.0));
    let show = |rig: &mut Rig, techniques, bounces, debug_view| {
        let bdpt = Bdpt { light_paths: 2.0, techniques, ..default() };
        let paths = paths::temporal();
        rig.set(|r| *r = Restir { technique: Technique::Bdpt, bdpt, paths, bounces, debug_view, ..plain() });
        rig.picture(1)
    };

    // One event each: as many arrive in the picture as start.
    let counts = show(&mut rig, Lightweight, 1, DebugView::LightPathCounts);
    assert_eq!(counts.iter().map(|(_, c)| c.x).sum::<f32>(), (2 * SIZE * SIZE) as f32);
    let pixel = 6.0 / SIZE as f32;
    // Pixels beyond the cone, which the wall cuts 6 m away.
    let beyond = |at: UVec2| (at.as_vec2() + 0.5 - 0.5 * SIZE as f32).length() * pixel > 6.0 * angle.tan() + pixel;
    assert!(counts.iter().all(|(at, c)| c == Vec3::splat(c.x.round()) && (c.x == 0.0 || !beyond(at))));
    assert!(counts.iter().any(|(at, _)| beyond(at)) && counts.iter().any(|(_, c)| c.x > 1.0));

    // The last event of three has no edge to a camera path.  Two light paths a pixel store one vertex each, for both of their others.
    let stored = Vec3::new(2.0, 4.0, 0.0);
    for (techniques, bounces, debug_view, expected) in [
        (NoLightTracing, 1, DebugView::LightPathCounts, Vec3::ZERO),
        (NoLightTracing, 3, DebugView::LightVertices, stored),
        (Full, 3, DebugView::LightVertices, stored),
        (Full, 1, DebugView::LightVertices, Vec3::ZERO),
        (Lightweight, 3, DebugView::LightVertices, Vec3::ZERO),
    ] {
        let picture = show(&mut rig, techniques, bounces, debug_view);
        let wrong = picture.iter().find(|(_, c)| *c != expected);
        assert!(wrong.is_none(), "{techniques:?}, {bounces} bounces, {debug_view:?}: {wrong:?}");
    }

    // The report has the sums of these views.  All frames have the same counts, which arrive some frames late.
    let pixels = u64::from(SIZE * SIZE);
    for (techniques, bounces, vertices, splats) in
        [(Lightweight, 1, 0, Some(2)), (NoLightTracing, 3, 4, Some(0)), (Full, 1, 0, Some(2)), (Full, 3, 4, None)]
    {
        show(&mut rig, techniques, bounces, DebugView::Off);
        rig.frames(4);
        let report = rig.report();
        let counts = (report.light_paths, report.light_vertices);
        assert_eq!(counts, (2 * pixels, vertices * pixels), "{techniques:?}, {bounces} bounces");
        let seen = report.splats;
        assert!(
            splats.map_or(seen > 2 * pixels, |splats| seen == splats * pixels),
            "{techniques:?}, {bounces} bounces: {seen}"
        );
    }
    // Such counts are not kept on from frames with light paths.
    rig.set(|r| r.technique = Technique::Pt);
    rig.until_ready();
    rig.frames(6);
    let report = rig.report();
    assert_eq!((report.light_paths, report.light_vertices, report.splats), (0, 0, 0));
    rig.assert_sound();
}

#[test]
fn views_with_nothing_to_show_are_black() {
    let shown = |technique, view: DebugView| view.shows(&Restir { technique, ..plain() });
    assert!(shown(Technique::Di, DebugView::SubsurfaceShifts) && shown(Technique::Gi, DebugView::SubsurfaceShifts));
    assert!(!shown(Technique::Pt, DebugView::SubsurfaceShifts) && !shown(Technique::Bdpt, DebugView::SubsurfaceShifts));
    for view in [DebugView::LightPathCounts, DebugView::LightVertices] {
        assert!(Technique::ALL.iter().all(|technique| shown(*technique, view) == (*technique == Technique::Bdpt)));
    }
    let Some(mut rig) = Rig::new(8, 8) else { return };
    rig.spawn(square(20.0), lambert(0.5), Transform::default());
    rig.insert(rig.camera, sky(1.0));
    rig.set(|r| r.technique = Technique::Di);
    assert!((rig.debug(DebugView::Albedo).center().x - 0.5).abs() < 1e-5);
    // The scene has no body, and the technique no paths.
    for view in [DebugView::SubsurfaceConfidence, DebugView::SubsurfaceDistances, DebugView::PathEnds] {
        assert_eq!(rig.debug(view).mean(), 0.0, "{view:?}");
    }
    rig.assert_sound();
}
