//! The shift of paths is its own inverse: a path that is shifted to another pixel, of this frame or the last, shifts back to the same
//! path with the inverse Jacobian.  The suffix is traced again in both directions.  Each case counts at least 2,000 paths, most 10,000.

use crate::support::{
    app::*,
    proof::{Subject, emission},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    Paths, Reconnection, Reuse,
    testing::{plant_shader_defs, replace_pass_shader},
};
use std::collections::BTreeMap;

const BOUNCES: u32 = 4;
const SIZE: u32 = 128;
/// Added to the reason of a path whose first shift fails.
const NOT_THERE: u32 = 50;
/// The reason of a path whose shift back would succeed if the limits of footprint, roughness or Jacobian were 1 % lower or higher.
const AT_THRESHOLD: u32 = 40;
/// Reasons for a failure: `SHIFT_*` of `shaders/restir/shift/shifted_path.wgsl`.
const EARLIER: u32 = 3;
const UNCONNECTABLE: u32 = 4;
const HIDDEN: u32 = 7;
/// `shaders/bsdf/types.wgsl`.
const LOBE_BELOW: u32 = 4;

/// The number of paths and their largest relative error after both shifts, by (kind of path, reason of failure).  Then the number of
/// paths with an error above [`COARSE`]: first those that reconnect at the first vertex, then those that reconnect later.
#[derive(Default)]
struct RoundTrips(BTreeMap<(u32, u32), (u32, f32)>, [u32; 2]);

/// A relative error above this is due to rounding: directions are stored in 16 bits per coordinate, and barycentrics in 24.
const COARSE: f32 = 0.05;

impl RoundTrips {
    /// Adds a picture of (reason, kind, error); pixels without a path are ignored.
    fn add(&mut self, picture: &Picture, emitted: &Picture) {
        for ((_, c), (_, e)) in picture.iter().zip(emitted.iter()) {
            if e == Vec3::ZERO && c.y > 0.0 {
                let entry = self.0.entry((c.y.round() as u32, c.x.round() as u32)).or_default();
                *entry = (entry.0 + 1, entry.1.max(c.z));
                self.1[usize::from(reconnection_of(c.y.round() as u32) > 2)] += u32::from(c.x == 0.0 && c.z > COARSE);
            }
        }
    }

    fn count(&self, of: impl Fn(u32) -> bool) -> u32 {
        self.0.iter().filter(|((_, reason), _)| of(*reason)).map(|(_, (count, _))| count).sum()
    }

    /// Paths that returned, whose first shift failed, whose shift back failed; and the largest error of those that returned.
    fn sums(&self) -> (u32, u32, u32, f32) {
        let worst = self.0.iter().filter(|((_, reason), _)| *reason == 0).map(|(_, (_, e))| *e).fold(0.0, f32::max);
        let lost = self.count(|reason| reason != 0 && reason < NOT_THERE);
        (self.count(|reason| reason == 0), self.count(|reason| reason >= NOT_THERE), lost, worst)
    }

    /// Only the shift at the first vertex accounts for rounding of a position that changes a cosine close to 0, so that a few of the
    /// later ones may have a large error.
    fn assert_fine(&self, name: &str) {
        let (back, .., worst) = self.sums();
        let [at_first, later] = self.1;
        assert!(
            at_first == 0 && later as f32 <= 5e-6 * back as f32,
            "{name}: {at_first} and {later} of {back} have an error above {COARSE}, at most {worst}"
        );
    }
}

/// The reconnection vertex, from the kind that the shader reports.
fn reconnection_of(kind: u32) -> u32 {
    kind >> 6 & 7
}

/// A scene whose candidates show the result of a shift (`path_shift.wgsl`).
fn shift_scene(size: u32, make: fn(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(size, make)?;
    replace_pass_shader(&mut rig.app, "pt_candidates", include_str!("../../support/kernels/path_shift.wgsl"));
    Some(rig)
}

fn alone(paths: &Paths) -> Paths {
    Paths { reuse: Reuse { temporal: false, spatial_samples: 0, ..paths.reuse.clone() }, ..paths.clone() }
}

fn round_trips(rig: &mut Rig, defs: &[&'static str], paths: &Paths, seeds: u32) -> RoundTrips {
    let emitted = emission(rig);
    plant_shader_defs(&mut rig.app, defs);
    rig.set(|r| {
        paths.apply_to(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
    let mut round_trips = RoundTrips::default();
    for seed in 0..seeds {
        rig.set(|r| r.seed = seed);
        round_trips.add(&rig.next(), &emitted);
    }
    plant_shader_defs(&mut rig.app, &[]);
    round_trips
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_shift_to_the_same_pixel_is_the_identity() {
    // The level of textures depends on the pixel, also in reflections.
    for (name, make) in PATH_SCENES.into_iter().chain([("textured", textured as fn(&mut Rig))]) {
        let Some(mut rig) = shift_scene(SIZE, make) else { return };
        let round_trips = round_trips(&mut rig, &["TEST_ROUND_TRIP"], &alone(&paths::unified()), 3);
        let (back, away, lost, worst) = round_trips.sums();
        eprintln!(
            "{name}: {back} paths returned, {away} first shifts and {lost} shifts back failed, error at most {worst}"
        );
        assert!(back > 10_000 && (away + lost) as f32 <= 1e-4 * back as f32, "{name}: {:?}", round_trips.0);
        round_trips.assert_fine(name);
    }
}

/// The cases of the shift that a kind of path, as the shader reports it, belongs to: how it ends, where it reconnects, and its lobes.
fn cases_of(kind: u32) -> Vec<&'static str> {
    let bits = |from: u32, count: u32| kind >> from & ((1 << count) - 1);
    let (end, length, reconnection) = (bits(0, 3), bits(3, 3), reconnection_of(kind));
    let (lobe_before, lobe_after, is_in_mirror) = (bits(9, 2), bits(11, 3), bits(14, 1) == 1);
    let mut cases = vec![match (end, reconnection) {
        (1, k) if k == length => "NEE, reconnected at the light",
        (1, _) => "NEE after the reconnection",
        (_, 0) => "replayed entirely",
        (2, _) => "hit an emitter",
        _ => "hit the environment",
    }];
    if is_in_mirror {
        cases.push("first surface is a mirror");
    }
    if reconnection != 0 && lobe_after == LOBE_BELOW {
        cases.push("reconnected above a point of entry");
        return cases;
    }
    // Light samples (NEE) are weighed against all lobes.
    let last = if end == 1 { length - 1 } else { length };
    if reconnection != 0 && reconnection < last && lobe_before != lobe_after {
        cases.push("reconnected between different lobes");
    }
    cases
}

#[test]
fn paths_return_unchanged_from_other_pixels() {
    // A room, mirrors, and an environment; the second tier has all scenes.
    let scenes = [PATH_SCENES[0], PATH_SCENES[2], PATH_SCENES[3]];
    check_other_pixels(&scenes, &QUICK, &[], 4, &NEE_CASES, 20_000);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_return_unchanged_from_other_pixels_under_further_criteria() {
    check_other_pixels(&PATH_SCENES, &ALL, &[], 4, &NEE_CASES, 20_000);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_that_hit_light_by_bsdf_samples_return_from_other_pixels() {
    check_other_pixels(&BSDF_SCENES, &QUICK, &["TEST_HITS"], 20, &BSDF_CASES, 10_000);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_through_translucent_bodies_return_from_other_pixels() {
    check_other_pixels(&BODIES, &QUICK, &[], 4, &BODY_CASES, 2_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_millions_of_paths_through_translucent_bodies_return() {
    check_other_pixels(&BODIES, &ALL, &[], 100, &BODY_CASES, 100_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_millions_of_paths_return_from_other_pixels() {
    check_other_pixels(&PATH_SCENES, &ALL, &[], 100, &NEE_CASES, 1_000_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_millions_of_paths_that_hit_light_by_bsdf_samples_return() {
    check_other_pixels(&BSDF_SCENES, &ALL, &["TEST_HITS"], 450, &BSDF_CASES, 1_000_000);
}

/// Where NEE reaches the lights, it supplies most of the selected paths.  With `TEST_HITS` all paths end by BSDF samples.
const BSDF_SCENES: [(&str, fn(&mut Rig)); 1] = [("BSDF samples", shining)];

const BODIES: [(&str, fn(&mut Rig)); 1] = [("bodies", translucent_room)];

/// Criteria of reconnection.
const QUICK: [&str; 2] = ["footprints", "often replayed"];
const FURTHER: [&str; 5] =
    ["black box", "black box as printed", "bounded Jacobian", "footprint of the path", "by distance"];
const ALL: [&str; 7] = [QUICK[0], QUICK[1], FURTHER[0], FURTHER[1], FURTHER[2], FURTHER[3], FURTHER[4]];

const NEE_CASES: [&str; 3] = ["NEE, reconnected at the light", "NEE after the reconnection", "hit the environment"];
const BODY_CASES: [&str; 3] = [NEE_CASES[0], NEE_CASES[1], "reconnected above a point of entry"];
const BSDF_CASES: [&str; 4] =
    ["hit an emitter", "replayed entirely", "first surface is a mirror", "reconnected between different lobes"];

/// Settings of every criterion of [`ALL`].
fn kinds() -> [(&'static str, Paths); ALL.len()] {
    let kind = |reconnection| Paths { reconnection, ..paths::unified() };
    [
        ("footprints", paths::unified()),
        ("often replayed", Paths { footprint: 20.0, ..paths::unified() }),
        ("black box", Paths { roughness: 0.6, ..kind(Reconnection::BlackBox) }),
        ("black box as printed", kind(Reconnection::BlackBoxPrinted)),
        ("bounded Jacobian", Paths { footprint: 2.0, ..kind(Reconnection::JacobianBound) }),
        ("footprint of the path", Paths { footprint: 20.0, ..kind(Reconnection::PathFootprint) }),
        ("by distance", Paths { distance: 0.5, ..kind(Reconnection::Distance) }),
    ]
}

/// Shifts paths to neighboring pixels and back, for each scene and criterion, with this number of seeds.  Asserts that more than `each`
/// paths of every wanted case return.
fn check_other_pixels(
    scenes: &[(&str, fn(&mut Rig))],
    criteria: &[&str],
    defs: &[&'static str],
    seeds: u32,
    wanted: &[&str],
    each: u32,
) {
    let mut cases: BTreeMap<&str, u32> = BTreeMap::new();
    for &(name, make) in scenes {
        let Some(mut rig) = shift_scene(SIZE, make) else { return };
        let defs = [&["TEST_ROUND_TRIP", "TEST_BESIDE"], defs].concat();
        for (what, paths) in kinds().into_iter().filter(|(what, _)| criteria.contains(what)) {
            let round_trips = round_trips(&mut rig, &defs, &alone(&paths), seeds);
            let (back, away, lost, worst) = round_trips.sums();
            let [at_threshold, at_edge] = [AT_THRESHOLD, HIDDEN].map(|reason| round_trips.count(|r| r == reason));
            let flipped = at_threshold + at_edge;
            eprintln!(
                "{name}, {what}: {back} paths came back, {away} did not arrive, {at_threshold} were lost at a threshold, {at_edge} at an \
                 edge, {} otherwise, error at most {worst}",
                lost - flipped
            );
            // A footprint or a Jacobian just within its limit in one pixel may be just outside of it in the other, and a rounded
            // position may lie behind the edge that the ray passed.
            assert!(
                back > 5000 * seeds && lost == flipped && flipped as f32 <= 1.0 + 1e-5 * back as f32,
                "{:?}",
                round_trips.0
            );
            round_trips.assert_fine(name);
            for (&(kind, reason), (count, _)) in &round_trips.0 {
                for case in cases_of(kind) {
                    *cases.entry(case).or_default() += if reason == 0 { *count } else { 0 };
                }
            }
            // Some paths would reconnect earlier in the other pixel, and others cannot reconnect at the same vertex: the shift must
            // reject them.
            if what == "often replayed" && !matches!(name, "mirrors" | "BSDF samples") {
                for reason in [EARLIER, UNCONNECTABLE] {
                    assert!(
                        round_trips.count(|r| r == NOT_THERE + reason) > 10,
                        "{name}: {reason} is never the reason"
                    );
                }
            }
        }
    }
    eprintln!("returned: {cases:#?}");
    assert!(wanted.iter().all(|case| cases.get(case).is_some_and(|&count| count > each)), "{cases:#?}");
}

/// Narrow lobes amplify the rounding of positions close to a corner; those paths are counted separately.
#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_over_every_lobe_return_unchanged() {
    let Some(mut rig) = shift_scene(SIZE, every_lobe) else { return };
    let quick = [QUICK[0], QUICK[1], "bounded Jacobian", "footprint of the path"];
    for (what, paths) in kinds().into_iter().filter(|(what, _)| quick.contains(what)) {
        let round_trips = round_trips(&mut rig, &["TEST_ROUND_TRIP", "TEST_BESIDE"], &alone(&paths), 4);
        let (back, away, lost, worst) = round_trips.sums();
        let coarse = round_trips.1[0] + round_trips.1[1];
        eprintln!(
            "{what}: {back} paths returned, {away} first shifts and {lost} shifts back failed, {coarse} have large errors, at most {worst}"
        );
        assert!(back > 20_000 && (lost + coarse) as f32 <= 1e-4 * back as f32, "{:?}", round_trips.0);
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_return_unchanged_from_the_previous_frame() {
    check_previous_frame(4, 30_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_paths_return_from_the_previous_frame() {
    check_previous_frame(90, 1_000_000);
}

fn check_previous_frame(seeds: u32, least: u32) {
    let Some(mut rig) = shift_scene(SIZE, moving) else { return };
    pose_moving(&mut rig, STEPS);
    let emitted = emission(&mut rig);
    plant_shader_defs(&mut rig.app, &["TEST_ROUND_TRIP", "TEST_BEFORE"]);
    // Without spatial samples nothing is reused, but the previous frame is kept.
    rig.set(|r| {
        alone(&paths::unified()).apply_to(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
    let mut round_trips = RoundTrips::default();
    for seed in 0..seeds {
        rig.set(|r| r.seed = seed);
        for step in 0..STEPS {
            pose_moving(&mut rig, step);
            rig.frame();
        }
        pose_moving(&mut rig, STEPS);
        round_trips.add(&rig.next(), &emitted);
    }
    let (back, away, lost, worst) = round_trips.sums();
    eprintln!("{back} paths returned, {away} first shifts and {lost} shifts back failed, error at most {worst}");
    assert!(back > least && lost as f32 <= 1e-4 * back as f32, "{:?}", round_trips.0);
    assert!(worst < COARSE, "{worst}");
}
