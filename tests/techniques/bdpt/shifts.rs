//! The shift of camera paths whose weights count light sub-paths: a path returns unchanged from another pixel, of this frame or the last.
//! In the other pixel its stored suffix, with two numbers for the weight, is worth as much as the suffix that is traced again.

use crate::support::{
    app::*,
    proof::{Bidirectional, Subject, emission},
    reuse_settings::paths,
    small_scenes::*,
};
use LightTechniques::*;
use bevy::prelude::*;
use bevy_restir::{
    LightTechniques, Paths, ShiftedMis,
    testing::{plant_shader_defs, replace_pass_shader, shader_library::ShaderEdit},
};

const BOUNCES: u32 = 4;
const SIZE: u32 = 128;
/// Seeds after which a test of too few paths ends.
const PATIENCE: u32 = 1000;
/// Results of `path_shift.wgsl`.
const STORED_DIFFERS: u32 = 30;
const AT_THRESHOLD: u32 = 40;
const NOT_THERE: u32 = 50;
/// `TERMINATION_CONNECTION` of `shaders/restir/path_sample.wgsl`.
const CONNECTION: u32 = 4;
/// `shaders/restir/shift/shifted_path.wgsl`.
const HIDDEN: u32 = 7;
/// A relative error above this is due to rounding.
const COARSE: f32 = 0.05;

/// Replaces passes, given with their entry points, by passes that do nothing.  Compiling takes longer than running.
pub fn leave_out(rig: &mut Rig, passes: &[(&'static str, &str)]) {
    for &(pass, entry) in passes {
        replace_pass_shader(&mut rig.app, pass, &format!("@compute @workgroup_size(8, 8)\nfn {entry}() {{}}\n"));
    }
}

/// Passes of light sub-paths that the camera sees.
pub const SPLATS: [(&str, &str); 4] = [
    ("splats", "splats"),
    ("splats_forward", "splats_forward"),
    ("splats_gather", "splats_gather"),
    ("splats_reuse", "reuse"),
];

/// All passes of light sub-paths.
const OF_LIGHT_PATHS: [(&str, &str); 5] = [SPLATS[0], SPLATS[1], SPLATS[2], SPLATS[3], ("light_paths", "light_paths")];

/// The number of paths that returned, whose first shift failed, that were lost where a threshold or an edge is within rounding, that were
/// lost otherwise, whose stored suffix has another value, and that returned with a large error; and the largest error.  Of those that
/// returned, the connections that reconnect at the light vertex, at the vertex before, and earlier.
#[derive(Debug, Default)]
struct RoundTrips {
    returned: u32,
    connected: [u32; 3],
    away: u32,
    at_threshold: u32,
    at_edge: u32,
    lost: u32,
    stored_differs: u32,
    coarse: u32,
    worst: f32,
}

impl RoundTrips {
    /// Adds a picture of (reason, kind, error); pixels that see a light are ignored.
    fn add(&mut self, picture: &Picture, emitted: &Picture) {
        for ((_, c), (_, e)) in picture.iter().zip(emitted.iter()) {
            if e != Vec3::ZERO || c.y == 0.0 {
                continue;
            }
            let kind = c.y.round() as u32;
            let (end, length, reconnection) = (kind & 7, kind >> 3 & 7, kind >> 6 & 7);
            match c.x.round() as u32 {
                0 => {
                    self.returned += 1;
                    if end == CONNECTION {
                        self.connected[(length - reconnection).min(2) as usize] += 1;
                    }
                    self.coarse += u32::from(c.z > COARSE);
                    self.worst = self.worst.max(c.z);
                }
                STORED_DIFFERS => self.stored_differs += 1,
                AT_THRESHOLD => self.at_threshold += 1,
                HIDDEN => self.at_edge += 1,
                reason if reason >= NOT_THERE => self.away += 1,
                _ => self.lost += 1,
            }
        }
    }
}

/// A rig whose candidates show the result of a shift.  These passes do nothing.
fn shift_rig(make: impl FnOnce(&mut Rig), idle: &[(&'static str, &str)]) -> Option<Rig> {
    let mut rig = scene(SIZE, make)?;
    leave_out(&mut rig, idle);
    for (pass, kernel) in [
        ("bdpt_candidates", include_str!("../../support/kernels/path_shift.wgsl")),
        ("bdpt_reuse", include_str!("../../support/kernels/copied_light.wgsl")),
    ] {
        replace_pass_shader(&mut rig.app, pass, kernel);
    }
    Some(rig)
}

/// Settings with one pass of reuse, so that light sub-paths have the shares of resampled paths, and `copied_light.wgsl` runs once.
fn choose(rig: &mut Rig, (techniques, footprint): (LightTechniques, f32)) {
    let paths = Paths { footprint, ..paths::temporal() };
    rig.set(|r| {
        Bidirectional(techniques, paths).apply_to(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
}

/// Light techniques with a footprint: the default one, and one with which paths are often replayed.
const KINDS: [(LightTechniques, f32); 2] = [(Full, 0.02), (Lightweight, 20.0)];

/// Shifts paths to pixels near their own and back, until this many of each kind have returned from each scene.
fn check_other_pixels(scenes: &[(&str, fn(&mut Rig))], each: u32) {
    for &(name, make) in scenes {
        let Some(mut rig) = shift_rig(make, &OF_LIGHT_PATHS) else { return };
        let emitted = emission(&mut rig);
        plant_shader_defs(&mut rig.app, &["TEST_ROUND_TRIP", "TEST_BESIDE", "TEST_STORED", "TEST_COPIED"]);
        for kind in KINDS {
            choose(&mut rig, kind);
            let trips = other_pixels(&mut rig, &emitted, each);
            eprintln!("{name}, {kind:?}: {trips:?}");
            // Two, or one in ten thousand.
            let few = 2 + trips.returned / 10_000;
            assert!(trips.returned >= each && trips.lost == 0, "{name}, {kind:?}: {trips:?}");
            assert!(trips.stored_differs <= few, "{name}, {kind:?}: {trips:?}");
            assert!(trips.at_threshold + trips.at_edge + trips.coarse <= few, "{name}, {kind:?}: {trips:?}");
        }
    }
}

fn other_pixels(rig: &mut Rig, emitted: &Picture, least: u32) -> RoundTrips {
    let mut trips = RoundTrips::default();
    for seed in 0..PATIENCE {
        rig.set(|r| r.seed = seed);
        trips.add(&rig.next(), emitted);
        if trips.returned >= least {
            break;
        }
    }
    trips
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_beside_light_paths_return_unchanged_from_other_pixels() {
    let mirrors = PATH_SCENES[2];
    check_other_pixels(&[mirrors], 100_000);
}

/// Shifts paths that end with a connection, until this many have returned from each scene.
fn check_connections(scenes: &[(&str, fn(&mut Rig))], each: u32, mis: ShiftedMis) {
    for &(name, make) in scenes {
        let Some(mut rig) = shift_rig(make, &SPLATS) else { return };
        let emitted = emission(&mut rig);
        plant_shader_defs(
            &mut rig.app,
            &["TEST_ROUND_TRIP", "TEST_BESIDE", "TEST_STORED", "TEST_COPIED", "TEST_CONNECTIONS"],
        );
        rig.set(|r| r.bdpt.mis = mis);
        for (_, footprint) in KINDS {
            choose(&mut rig, (Full, footprint));
            let trips = other_pixels(&mut rig, &emitted, each);
            eprintln!("{name}, {footprint}: {trips:?}");
            let few = 2 + trips.returned / 10_000;
            assert!(trips.returned >= each && trips.lost == 0, "{name}, {footprint}: {trips:?}");
            assert!(trips.at_threshold + trips.at_edge + trips.coarse <= few, "{name}, {footprint}: {trips:?}");
            assert_eq!(trips.connected.iter().sum::<u32>(), trips.returned);
            assert!(trips.connected.iter().all(|&kind| kind > each / 200), "{name}, {footprint}: {trips:?}");
        }
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn connected_paths_return_unchanged_from_other_pixels() {
    check_connections(&PATH_SCENES[..1], 100_000, ShiftedMis::Exact);
}

/// Such a path has its first weight wherever it goes, so that it returns with the same light.
#[test]
#[ignore = "second tier: ./run test --more"]
fn connected_paths_with_copied_weights_return_unchanged_from_other_pixels() {
    check_connections(&PATH_SCENES[..1], 100_000, ShiftedMis::Copied);
}

/// Each picture takes four frames, so that the second tier has half as many paths as in the test of other pixels.
#[test]
#[ignore = "second tier: ./run test --more"]
fn connected_paths_return_unchanged_from_the_last_frame() {
    check_last_frame_of("moving", moving, &pose_moving, 50_000, 1e-3, true);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_connected_paths_return_from_the_last_frame() {
    check_last_frame_of("moving", moving, &pose_moving, 1_000_000, 1e-3, true);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_connected_paths_return_from_other_pixels() {
    check_connections(&PATH_SCENES, 1_000_000, ShiftedMis::Exact);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_paths_beside_light_paths_return_from_other_pixels() {
    check_other_pixels(&PATH_SCENES, 1_000_000);
}

/// Wrong numbers of the stored weight, as (name, file, text, replacement).
const WRONG: [(&str, &str, &str, &str); 2] = [
    (
        "swapped",
        "path/technique_weights.wgsl",
        "return 1.0 / (1.0 + dot(coefficients, s.basis.yz));",
        "return 1.0 / (1.0 + dot(coefficients, s.basis.zy));",
    ),
    (
        "not stored",
        "restir/bdpt/reservoir.wgsl",
        "r.path.mis_coefficients = bitcast<vec2<f32>>(p.suffix.zw);",
        "r.path.mis_coefficients = vec2<f32>(0.0);",
    ),
];

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_wrong_stored_weights_are_found() {
    let Some(mut rig) = shift_rig(mirrors, &OF_LIGHT_PATHS) else { return };
    let emitted = emission(&mut rig);
    plant_shader_defs(&mut rig.app, &["TEST_ROUND_TRIP", "TEST_BESIDE", "TEST_STORED", "TEST_COPIED"]);
    for (name, module, from, to) in WRONG {
        plant_edits(&mut rig.app, &[ShaderEdit { module, from, to }]);
        choose(&mut rig, KINDS[0]);
        let trips = other_pixels(&mut rig, &emitted, 2_000);
        eprintln!("{name}: {trips:?}");
        let wrong = trips.stored_differs + trips.coarse + trips.lost;
        assert!(wrong > trips.returned / 50, "{name} is not found: {trips:?}");
    }
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_paths_beside_light_paths_return_from_the_last_frame() {
    check_last_frame("moving", moving, &pose_moving, 1_000_000, 1e-4);
}

/// Shifts paths to the last frame of a motion and back, until this many have returned.  Asserts that at most this share of them is lost or
/// has a large error.
pub fn check_last_frame(name: &str, make: impl FnOnce(&mut Rig), pose: &dyn Fn(&mut Rig, u32), least: u32, share: f64) {
    check_last_frame_of(name, make, pose, least, share, false);
}

/// `of_connections`: only paths that end with a connection.
fn check_last_frame_of(
    name: &str,
    make: impl FnOnce(&mut Rig),
    pose: &dyn Fn(&mut Rig, u32),
    least: u32,
    share: f64,
    of_connections: bool,
) {
    let idle: &[_] = if of_connections { &SPLATS } else { &OF_LIGHT_PATHS };
    let Some(mut rig) = shift_rig(make, idle) else { return };
    pose(&mut rig, STEPS);
    let emitted = emission(&mut rig);
    let defs = ["TEST_ROUND_TRIP", "TEST_BEFORE", "TEST_COPIED", "TEST_CONNECTIONS"];
    plant_shader_defs(&mut rig.app, if of_connections { &defs } else { &defs[..3] });
    choose(&mut rig, KINDS[0]);
    let mut trips = RoundTrips::default();
    for seed in 0..PATIENCE {
        rig.set(|r| r.seed = seed);
        for step in 0..STEPS {
            pose(&mut rig, step);
            rig.frame();
        }
        pose(&mut rig, STEPS);
        trips.add(&rig.next(), &emitted);
        if trips.returned >= least {
            break;
        }
    }
    eprintln!("{name}: {trips:?}");
    let wrong = trips.at_threshold + trips.at_edge + trips.lost + trips.coarse;
    assert!(trips.returned >= least, "{name}: {trips:?}");
    assert!(f64::from(wrong) <= share * f64::from(trips.returned), "{name}: {trips:?}");
}
