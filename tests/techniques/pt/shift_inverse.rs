//! The shift of paths is its own inverse: a path that arrives in another pixel, in this frame or the last, comes back to its own as it was,
//! with the inverse of its Jacobian; its end is traced again both times.  A census over some 100,000 paths a case.

use crate::support::{
    app::*,
    proof::{Subject, emission},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Paths, Reconnection, plant_shader_defs};
use std::collections::BTreeMap;

const BOUNCES: u32 = 4;
const SIZE: u32 = 128;
/// Added to the reason of a path that does not arrive.
const NOT_THERE: u32 = 50;
/// The reason of a path that would come back by a footprint, roughness or limit of Jacobians 1 % lower or higher.
const AT_THRESHOLD: u32 = 40;
/// Reasons: `SHIFT_*` of `shaders/shift/hybrid.wgsl`.
const EARLIER: u32 = 3;
const UNCONNECTABLE: u32 = 4;
const HIDDEN: u32 = 7;

/// Number of paths, by how they end, their length, where others reconnect to them, their lobes, and why they cannot be shifted; the
/// largest relative error of what they carry; and how many have one beyond [`COARSE`], those that are reconnected to from a later vertex
/// than the first apart.
#[derive(Default)]
struct Census(BTreeMap<(u32, u32), (u32, f32)>, [u32; 2]);

/// Relative error of what a path carries after both ways, beyond which rounding was unkind to it.  Directions and places are kept in 16
/// bits.
const COARSE: f32 = 0.05;

impl Census {
    /// Adds a picture of (reason, kind, error) where there is a path.
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

    /// Paths that arrived and came back, that did not arrive, that did not come back; and the largest error of the first.
    fn sums(&self) -> (u32, u32, u32, f32) {
        let worst = self.0.iter().filter(|((_, reason), _)| *reason == 0).map(|(_, (_, e))| *e).fold(0.0, f32::max);
        let lost = self.count(|reason| reason != 0 && reason < NOT_THERE);
        (self.count(|reason| reason == 0), self.count(|reason| reason >= NOT_THERE), lost, worst)
    }

    /// What the rounding of a place may do to a cosine that is all but 0 is reckoned with at the first vertex only: few of the later ones
    /// may be off.
    fn assert_fine(&self, name: &str) {
        let (back, .., worst) = self.sums();
        let [at_first, later] = self.1;
        assert!(
            at_first == 0 && later as f32 <= 5e-6 * back as f32,
            "{name}: {at_first} and {later} of {back} are off by more than {COARSE}, by {worst} at most"
        );
    }
}

/// Of the number that the shader shows.
fn reconnection_of(kind: u32) -> u32 {
    kind >> 5 & 7
}

fn alone(paths: &Paths) -> Paths {
    Paths { temporal: false, spatial_taps: 0, ..paths.clone() }
}

fn census(rig: &mut Rig, defs: &[&'static str], paths: &Paths, seeds: u32) -> Census {
    let emitted = emission(rig);
    plant_shader_defs(&mut rig.app, defs);
    rig.set(|r| {
        paths.ask(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
    let mut census = Census::default();
    for seed in 0..seeds {
        rig.set(|r| r.seed = seed);
        census.add(&rig.next(), &emitted);
    }
    plant_shader_defs(&mut rig.app, &[]);
    census
}

#[test]
fn a_path_is_its_own_image_in_its_own_pixel() {
    // Textures have another level in each pixel, in what mirrors show too.
    for (name, make) in PATH_SCENES.into_iter().chain([("textured", textured as fn(&mut Rig))]) {
        let Some(mut rig) = scene(SIZE, make) else { return };
        let census = census(&mut rig, &["TEST_ROUND_TRIP"], &alone(&Paths::default()), 16);
        let (back, away, lost, worst) = census.sums();
        eprintln!("{name}: {back} paths came back, {away} did not arrive, {lost} were lost, error at most {worst}");
        assert!(back > 100_000 && (away + lost) as f32 <= 1e-4 * back as f32, "{name}: {:?}", census.0);
        census.assert_fine(name);
    }
}

/// How a path ends, where it is reconnected, and by what it goes, of the number that the shader shows: cases of the shift.
fn cases_of(kind: u32) -> Vec<&'static str> {
    let bits = |from: u32, count: u32| kind >> from & ((1 << count) - 1);
    let (end, length, reconnection) = (bits(0, 2), bits(2, 3), reconnection_of(kind));
    let (lobe_before, lobe_after, is_in_mirror) = (bits(8, 2), bits(10, 2), bits(12, 1) == 1);
    let mut cases = vec![match (end, reconnection) {
        (1, k) if k == length => "aimed at a light, which is reconnected to",
        (1, _) => "aimed at a light after the reconnection",
        (_, 0) => "replayed whole",
        (2, _) => "met an emitter",
        _ => "met the environment",
    }];
    if is_in_mirror {
        cases.push("first seen in a mirror");
    }
    // A light that is aimed at is met by all lobes.
    let last = if end == 1 { length - 1 } else { length };
    if reconnection != 0 && reconnection < last && lobe_before != lobe_after {
        cases.push("reconnected from one lobe to another");
    }
    cases
}

#[test]
fn paths_come_back_from_other_pixels_as_they_were() {
    come_back_from_other_pixels(&PATH_SCENES, &[], 10, &AIMED, 100_000);
}

#[test]
fn paths_that_met_light_by_chance_come_back_from_other_pixels() {
    come_back_from_other_pixels(&BY_CHANCE, &["TEST_NOT_AIMED"], 50, &MET, 100_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_millions_of_paths_come_back_from_other_pixels() {
    come_back_from_other_pixels(&PATH_SCENES, &[], 100, &AIMED, 1_000_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_millions_of_paths_that_met_light_by_chance_come_back() {
    come_back_from_other_pixels(&BY_CHANCE, &["TEST_NOT_AIMED"], 450, &MET, 1_000_000);
}

/// Where lights are aimed at from everywhere, few paths that met one by chance are kept: here only those are.
const BY_CHANCE: [(&str, fn(&mut Rig)); 1] = [("by chance", shining)];

const AIMED: [&str; 3] =
    ["aimed at a light, which is reconnected to", "aimed at a light after the reconnection", "met the environment"];
const MET: [&str; 4] =
    ["met an emitter", "replayed whole", "first seen in a mirror", "reconnected from one lobe to another"];

/// At least so many of each case, in so many frames a scene and kind of reconnection.
fn come_back_from_other_pixels(
    scenes: &[(&str, fn(&mut Rig))],
    defs: &[&'static str],
    seeds: u32,
    wanted: &[&str],
    each: u32,
) {
    let often_replayed = Paths { footprint: 20.0, ..Default::default() };
    let black_box = Paths { reconnection: Reconnection::BlackBox, roughness: 0.6, ..Default::default() };
    let by_distance = Paths { reconnection: Reconnection::Distance, distance: 0.5, ..Default::default() };
    let mut cases: BTreeMap<&str, u32> = BTreeMap::new();
    for &(name, make) in scenes {
        let Some(mut rig) = scene(SIZE, make) else { return };
        let defs = [&["TEST_ROUND_TRIP", "TEST_BESIDE"], defs].concat();
        for (what, paths) in [
            ("footprints", &Paths::default()),
            ("often replayed", &often_replayed),
            ("black box", &black_box),
            ("by distance", &by_distance),
        ] {
            let census = census(&mut rig, &defs, &alone(paths), seeds);
            let (back, away, lost, worst) = census.sums();
            let [at_threshold, at_edge] = [AT_THRESHOLD, HIDDEN].map(|reason| census.count(|r| r == reason));
            let flipped = at_threshold + at_edge;
            eprintln!(
                "{name}, {what}: {back} paths came back, {away} did not arrive, {at_threshold} were lost at a threshold, {at_edge} at an \
                 edge, {} otherwise, error at most {worst}",
                lost - flipped
            );
            // A footprint or a Jacobian that is just within its limit there may be just beyond it on the way back, and a place that is
            // kept in 16 bits may lie behind the edge that the ray passed.
            assert!(back > 5000 * seeds && lost == flipped && flipped as f32 <= 1e-5 * back as f32, "{:?}", census.0);
            census.assert_fine(name);
            for (&(kind, reason), (count, _)) in &census.0 {
                for case in cases_of(kind) {
                    *cases.entry(case).or_default() += if reason == 0 { *count } else { 0 };
                }
            }
            // Some would be reconnected earlier there, others not where they are here: the shift must not take them.
            if what == "often replayed" && !matches!(name, "mirrors" | "by chance") {
                for reason in [EARLIER, UNCONNECTABLE] {
                    assert!(census.count(|r| r == NOT_THERE + reason) > 10, "{name}: {reason} is never the reason");
                }
            }
        }
    }
    eprintln!("came back: {cases:#?}");
    assert!(wanted.iter().all(|case| cases.get(case).is_some_and(|&count| count > each)), "{cases:#?}");
}

/// Narrow lobes magnify the rounding of places that are all but in one corner: those paths are counted apart.
#[test]
fn paths_over_every_lobe_come_back_as_they_were() {
    let Some(mut rig) = scene(SIZE, every_lobe) else { return };
    for (what, paths) in
        [("footprints", Paths::default()), ("often replayed", Paths { footprint: 20.0, ..Default::default() })]
    {
        let census = census(&mut rig, &["TEST_ROUND_TRIP", "TEST_BESIDE"], &alone(&paths), 4);
        let (back, away, lost, worst) = census.sums();
        let coarse = census.1[0] + census.1[1];
        eprintln!(
            "{what}: {back} came back, {away} did not arrive, {lost} were lost, {coarse} off, by {worst} at most"
        );
        assert!(back > 20_000 && (lost + coarse) as f32 <= 1e-4 * back as f32, "{:?}", census.0);
    }
}

#[test]
fn paths_come_back_from_the_last_frame_as_they_were() {
    come_back_from_the_last_frame(12, 100_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_paths_come_back_from_the_last_frame() {
    come_back_from_the_last_frame(90, 1_000_000);
}

fn come_back_from_the_last_frame(seeds: u32, least: u32) {
    let Some(mut rig) = scene(SIZE, moving) else { return };
    pose_moving(&mut rig, STEPS);
    let emitted = emission(&mut rig);
    plant_shader_defs(&mut rig.app, &["TEST_ROUND_TRIP", "TEST_BEFORE"]);
    // Without taps nothing is reused, but the last frame is known.
    rig.set(|r| {
        alone(&Paths::default()).ask(r);
        r.bounces = BOUNCES;
    });
    rig.until_ready();
    let mut census = Census::default();
    for seed in 0..seeds {
        rig.set(|r| r.seed = seed);
        for step in 0..STEPS {
            pose_moving(&mut rig, step);
            rig.frame();
        }
        pose_moving(&mut rig, STEPS);
        census.add(&rig.next(), &emitted);
    }
    let (back, away, lost, worst) = census.sums();
    eprintln!("{back} paths came back, {away} did not arrive, {lost} were lost, error at most {worst}");
    assert!(back > least && lost as f32 <= 1e-4 * back as f32, "{:?}", census.0);
    assert!(worst < COARSE, "{worst}");
}
