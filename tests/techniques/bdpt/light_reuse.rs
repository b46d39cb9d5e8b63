//! Reuse of light sub-paths between frames: a replayed sub-path is the one that was stored, and a frame of a moving scene equals on average
//! the reference of the still scene at that moment.  The technique t = 1 is tested alone, too, because it finds all light of a diffuse room.

use super::shifts::{SPLATS, leave_out};
use crate::{
    support::{
        app::*,
        equivalence::Length,
        proof::{Bidirectional, Proof, Subject, emission},
        reuse_settings::paths,
        small_scenes::*,
    },
    techniques::previous_frame::{changing, pose},
};
use LightTechniques::*;
use bevy::prelude::*;
use bevy_restir::{
    Bdpt, DebugView, Jitter, LightTechniques, Restir, Technique,
    testing::{plant_shader_defs, replace_pass_shader, shader_library::ShaderEdit},
};

const SIZE: u32 = 48;
/// Seeds after which a test of too few samples ends.
const PATIENCE: u32 = 400;

fn lightweight() -> Bidirectional {
    Bidirectional(Lightweight, paths::temporal())
}

fn jittered(make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(32, make)?;
    rig.set(|r| r.jitter = Jitter::Always);
    Some(rig)
}

/// Samples that were replayed in another pixel or with another contribution, and all samples.  Further seeds follow until there are at least
/// this many.
fn replayed(rig: &mut Rig, emitted: &[Picture], least: u32) -> (u32, u32) {
    let (mut wrong, mut all) = (0, 0);
    for seed in 0..PATIENCE {
        rig.set(|r| r.seed = seed);
        pose(rig, 0);
        rig.until_ready();
        rig.frames(2);
        for step in 1..=STEPS {
            pose(rig, step);
            let now = rig.next();
            for (at, value) in now.iter() {
                let found = value - emitted[step as usize].at(at.x, at.y);
                if (found.z - 1.0).abs() < 0.01 {
                    all += 1;
                    wrong += u32::from((found.x - 1.0).abs() > 0.01 || found.y > 2e-3);
                }
            }
        }
        if all >= least {
            break;
        }
    }
    (wrong, all)
}

fn replaying_rig(size: u32) -> Option<(Rig, Vec<Picture>)> {
    let mut rig = scene(size, changing)?;
    let emitted = (0..=STEPS)
        .map(|step| {
            pose(&mut rig, step);
            emission(&mut rig)
        })
        .collect();
    plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
    let kernels = [
        ("splats_forward", include_str!("../../support/kernels/splat_forward_nothing.wgsl")),
        ("splats_gather", include_str!("../../support/kernels/splat_replay.wgsl")),
        ("splats_reuse", include_str!("../../support/kernels/splat_show.wgsl")),
    ];
    for (pass, text) in kernels {
        replace_pass_shader(&mut rig.app, pass, text);
    }
    let bdpt = Bdpt { light_paths: 8.0, ..default() };
    let paths = paths::temporal();
    rig.set(|r| *r = Restir { technique: Technique::Bdpt, bdpt, paths, bounces: 3, ..plain() });
    Some((rig, emitted))
}

fn check_replays(size: u32, least: u32) {
    let Some((mut rig, emitted)) = replaying_rig(size) else { return };
    let (wrong, all) = replayed(&mut rig, &emitted, least);
    eprintln!("{wrong} of {all}");
    assert!(all >= least, "{all}");
    // The inverse of the last frame's transform is rounded to f32, which may move a ray to the other side of an edge.
    assert!(wrong <= all / 100, "{wrong} of {all}");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_of_the_last_frame_are_replayed_as_they_were() {
    check_replays(SIZE, 500);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_hundred_thousand_light_paths_are_replayed_as_they_were() {
    check_replays(96, 100_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_light_paths_are_replayed_as_they_were() {
    check_replays(192, 1_000_000);
}

/// Edits that make a read of the last frame read this frame.
pub const WRONG: [(&str, &str, &str, &str); 5] = [
    ("camera", "view/camera.wgsl", "return view.previous;", "return view.current;"),
    (
        "first ray",
        "path/light_path.wgsl",
        "trace_closest_in_frame(Ray(ray.origin, ray.t_min, ray.direction, FAR), alpha_seed, previous)",
        "trace_closest_in_frame(Ray(ray.origin, ray.t_min, ray.direction, FAR), alpha_seed, false)",
    ),
    ("light", "light/emission.wgsl", "light_record(light, previous)", "light_record(light, false)"),
    ("sphere around the scene", "light/emitted_ray.wgsl", "scene.previous_center, scene", "scene.center, scene"),
    ("surface", "path/light_path.wgsl", "-direction, Cone(0.0, 0.0), previous)", "-direction, Cone(0.0, 0.0), false)"),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_wrong_replays_of_light_paths_are_found() {
    let Some((mut rig, emitted)) = replaying_rig(SIZE) else { return };
    for (name, module, from, to) in WRONG {
        plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
        let (wrong, all) = replayed(&mut rig, &emitted, 500);
        eprintln!("{name}: {wrong} of {all}");
        assert!(wrong > all / 50, "{name} is not found: {wrong} of {all}");
    }
}

/// A lamp that faces away from the camera lights a corner, also by a mirror and through a block of glass if `with_caustics`.
/// [`pose_corner`] moves them and the camera.
pub fn corner(rig: &mut Rig, with_caustics: bool) {
    let floor = Transform::from_xyz(0.0, -1.2, 0.0).with_rotation(Quat::from_rotation_x(-core::f32::consts::FRAC_PI_2));
    rig.spawn(square(6.0), lambert(0.7), floor);
    rig.spawn(square(6.0), lambert(0.5), Transform::from_xyz(0.0, 0.0, -1.2));
    let glass =
        StandardMaterial { specular_transmission: 1.0, thickness: 0.5, ior: 1.4, ..shiny(Color::WHITE, 0.0, 0.0) };
    let mirror = shiny(Color::linear_rgb(0.9, 0.9, 0.9), 0.0, 1.0);
    let [mirror, glass] = if with_caustics { [mirror, glass] } else { [lambert(0.3), lambert(0.6)] };
    for (name, material, size) in [("mirror", mirror, Vec3::new(0.9, 0.9, 0.02)), ("block", glass, Vec3::splat(0.5))] {
        let body = rig.spawn(Cuboid::from_size(size), material, Transform::default());
        rig.insert(body, Name::new(name));
    }
    let lamp = rig.spawn(square(0.5), lamp(9.0, 8.0, 7.0), Transform::default());
    rig.insert(lamp, Name::new("lamp"));
    pose_corner(rig, STEPS);
}

fn pose_corner(rig: &mut Rig, step: u32) {
    pose_corner_at(rig, step as f32);
}

/// Poses the corner between steps.
pub fn pose_corner_at(rig: &mut Rig, step: f32) {
    let ago = STEPS as f32 - step;
    let turned = |x: f32, y: f32| Quat::from_euler(EulerRot::YXZ, y, x, 0.0);
    let places = [
        ("mirror", Transform::from_xyz(1.0, -0.6 + 0.05 * ago, -0.3).with_rotation(turned(-0.3, -0.7 + 0.06 * ago))),
        ("block", Transform::from_xyz(-0.5 - 0.1 * ago, -0.8, 0.1).with_rotation(turned(0.2, 0.5 - 0.1 * ago))),
        // A square faces +Z.
        ("lamp", Transform::from_xyz(0.2 + 0.1 * ago, 0.5, 1.4).looking_to(Vec3::new(0.1, 0.5, 1.0), Vec3::Y)),
    ];
    for (name, place) in places {
        let entity = rig.named(name);
        *rig.get_mut::<Transform>(entity) = place;
    }
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3 - 0.1 * ago, 0.2, 4.0).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
}

pub const STILL: Proof = Proof { bounces: 4, margin: 0.03, warm_up: 6, ..Proof::of((12, 4), (12, 16)) };
pub const MOVING: Proof =
    Proof { warm_up: 0, pose: Some(&pose_corner), ..Proof { ours: Length { restarts: 10, frames: 3 }, ..STILL } };

#[test]
#[ignore = "second tier: ./run test --more"]
fn reused_caustics_equal_the_reference_in_still_scenes_and_in_moving_ones() {
    let Some(mut rig) = jittered(|rig| corner(rig, true)) else { return };
    STILL.check("a still corner", &mut rig, &[("temporal", lightweight())]);
    MOVING.check("a moving corner", &mut rig, &[("temporal", lightweight())]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn connected_paths_equal_the_reference_in_moving_scenes() {
    let Some(mut rig) = jittered(|rig| corner(rig, false)) else { return };
    let longer = Proof { ours: Length { restarts: 24, frames: 3 }, ..MOVING };
    longer.check("a moving corner", &mut rig, &[("both, all techniques", Bidirectional(Full, paths::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reused_light_paths_alone_find_all_light_of_a_diffuse_corner() {
    let Some(mut rig) = jittered(|rig| corner(rig, false)) else { return };
    for (name, proof) in [("still", STILL), ("moving", MOVING)] {
        let truth = proof.truth(&mut rig, 1000);
        plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
        let found = proof.resampled(&mut rig, &lightweight(), 2000).compare(&truth, 0.03);
        plant_shader_defs(&mut rig.app, &[]);
        eprintln!("{name}: {found}");
        assert!(found.is_equal(), "{name}: {found}");
    }
    rig.assert_sound();
}

/// Errors of the reuse of light sub-paths.
pub const PLANTED: [(&str, &str, &str, &str); 4] = [
    (
        "confidence of a success",
        "pass/splats_gather.wgsl",
        "    r.confidence = proxy_confidence(pixel);",
        "    r.confidence = proxy_confidence(pixel) * f32(r.ucw > 0.0);",
    ),
    (
        "the scene of this frame in place of the last one",
        "restir/splats/domain.wgsl",
        "replayed_splat(s.path, s.frame, s.light, s.events, true)",
        "replayed_splat(s.path, s.frame, s.light, s.events, false)",
    ),
    (
        "the weight of one landed sample",
        "pass/splats_gather.wgsl",
        "guarded(exact_total(sum).x / luminance(r.f), GUARD_CONTRIBUTION_WEIGHT)",
        "r.ucw",
    ),
    (
        "samples that stay in their pixel",
        "pass/splats_forward.wgsl",
        "        to = reservoir_index(vec2<u32>(splat.pixel % view.size.x, splat.pixel / view.size.x));\n",
        "",
    ),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_planted_errors_of_the_reuse_of_light_paths_are_found() {
    let Some(mut rig) = jittered(|rig| corner(rig, false)) else { return };
    let truth = MOVING.truth(&mut rig, 1000);
    plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
    for (name, module, from, to) in PLANTED {
        plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
        let found = MOVING.resampled(&mut rig, &lightweight(), 5000).compare(&truth, 0.01);
        eprintln!("{name}: {found}");
        assert!(found.is_different(), "{name} is not found: {found}");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn debug_views_show_reservoirs_of_light_paths() {
    let Some(mut rig) = room_scene(32) else { return };
    rig.set(|r| *r = Restir { technique: Technique::Bdpt, paths: paths::temporal(), bounces: 3, ..plain() });
    let mut view = |view, frames| {
        rig.set(|r| r.debug_view = view);
        rig.picture(frames)
    };
    for (frames, expected) in [(1, 1.0), (4, 4.0), (14, 9.0)] {
        // The cap of the history is 8.
        let confidence = view(DebugView::LightPathConfidence, frames);
        assert!(confidence.iter().all(|(_, value)| value.x == expected), "{frames} frames: {:?}", confidence.center());
    }
    let lengths = view(DebugView::LightPathLengths, 4);
    let lit = lengths.iter().filter(|(_, value)| value.x > 0.0).count();
    assert!(lit > 300, "{lit} pixels have a sample");
    assert!(lengths.iter().all(|(_, value)| [0.0, 1.0, 2.0, 3.0].contains(&value.x)));
    let ages = view(DebugView::LightPathAges, 4);
    assert!(ages.iter().all(|(_, value)| value.x < 4.0) && ages.iter().any(|(_, value)| value.x == 3.0));
    let weights = view(DebugView::LightPathWeights, 4);
    assert!(weights.is_finite() && weights.mean() > 0.0);
}

/// A path of the last frame that is connected with a light vertex gets the vertex that its light path has now.
#[test]
#[ignore = "second tier: ./run test --more"]
fn connected_paths_store_the_light_vertices_of_this_frame() {
    let Some(mut rig) = jittered(|rig| corner(rig, false)) else { return };
    leave_out(&mut rig, &SPLATS);
    replace_pass_shader(&mut rig.app, "bdpt_debug", include_str!("../../support/kernels/stored_light_vertices.wgsl"));
    rig.set(|r| {
        Bidirectional(Full, paths::temporal()).apply_to(r);
        (r.bounces, r.debug_view) = (3, DebugView::PathEnds);
    });
    let mut found_again = |edits: &[ShaderEdit]| {
        plant_edits(&mut rig.app, edits);
        rig.until_ready();
        let mut stored = Vec3::ZERO;
        for seed in 0..8 {
            rig.set(|r| r.seed = seed);
            for step in 0..=STEPS {
                pose_corner(&mut rig, step);
                stored += rig.next().iter().map(|(_, c)| c).sum::<Vec3>();
            }
        }
        eprintln!("{} of {} found again, {} of an earlier frame", stored.y, stored.x, stored.z);
        assert!(stored.x > 1_000.0 && stored.z > 300.0);
        stored.y / stored.x
    };
    assert!(found_again(&[]) > 0.995);
    let kept = ShaderEdit { module: "restir/shift/path_end.wgsl", from: "(*w).path = end.path;", to: "" };
    assert!(found_again(&[kept]) < 0.95);
}

/// A path of the last frame, shifted to its own pixel of the last frame, has its own light vertex there.
#[test]
fn light_vertices_of_the_last_frame_are_found_in_its_scene() {
    let Some(mut rig) = jittered(|rig| corner(rig, false)) else { return };
    leave_out(&mut rig, &SPLATS);
    replace_pass_shader(&mut rig.app, "bdpt_reuse", include_str!("../../support/kernels/light_vertices_before.wgsl"));
    rig.set(|r| {
        Bidirectional(Full, paths::temporal()).apply_to(r);
        r.bounces = 3;
    });
    let mut stored = Vec3::ZERO;
    for seed in 0..16 {
        rig.set(|r| r.seed = seed);
        rig.until_ready();
        for step in 0..=STEPS {
            pose_corner(&mut rig, step);
            stored += rig.next().iter().map(|(_, c)| c).sum::<Vec3>();
        }
    }
    eprintln!("{} of {} found", stored.y, stored.x);
    assert!(stored.x > 1_000.0 && stored.y > 0.99 * stored.x, "{} of {}", stored.y, stored.x);
}

/// The paths have s + t vertices, one more than the index of the light.
#[test]
#[ignore = "second tier: ./run test --more"]
fn a_debug_view_shows_the_technique_that_found_a_path() {
    let Some(mut rig) = room_scene(32) else { return };
    for (techniques, has_connections) in [(Lightweight, false), (Full, true)] {
        rig.set(|r| {
            Bidirectional(techniques, paths::temporal()).apply_to(r);
            (r.bounces, r.debug_view) = (3, DebugView::PathTechniques);
        });
        let shown = rig.picture(4);
        let found = |s: f32, t: f32| shown.iter().any(|(_, value)| value.x == s && value.y == t);
        assert!(found(1.0, 2.0) && found(1.0, 3.0), "{techniques:?}");
        assert_eq!((found(2.0, 2.0), found(3.0, 2.0)), (has_connections, has_connections), "{techniques:?}");
        assert!(shown.iter().all(|(_, value)| value.x + value.y <= 5.0), "{techniques:?}");
    }
}
