//! Light paths that are shifted by reconnection of their last edge: each belongs to one domain and contributes as much as its splat, the shift
//! has an inverse and is a change of variables, and pictures with any reuse equal the reference, in still and moving scenes.

use super::{
    light_reuse::{MOVING, STILL, corner},
    shifts::{SPLATS, leave_out},
};
use crate::support::{
    app::*,
    change_of_measure::{Measure, SIZE},
    equivalence::Length,
    proof::{Bidirectional, Proof, Subject, emission},
    reuse_settings::paths,
    small_scenes::*,
};
use LightTechniques::*;
use bevy::prelude::*;
use bevy_restir::{
    Jitter, LightTechniques, Paths, Restir, Reuse,
    testing::{plant_shader_defs, replace_pass_shader, shader_library::ShaderEdit},
};

/// [`Bidirectional`] with the reuse of light paths by reconnection.
pub struct Reconnected(pub LightTechniques, pub Paths);

impl Subject for Reconnected {
    fn apply_to(&self, settings: &mut Restir) {
        Bidirectional(self.0, self.1.clone()).apply_to(settings);
        settings.bdpt.reconnect_light_paths = true;
    }
}

/// Passes of camera paths.
const CAMERA_PATHS: [(&str, &str); 2] = [("bdpt_candidates", "path_candidates"), ("bdpt_reuse", "reuse")];

/// A picture of `size` pixels with light paths alone, each with the weight 1.
fn light_paths_alone(size: u32, make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(size, make)?;
    leave_out(&mut rig, &CAMERA_PATHS);
    plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
    rig.set(|r| {
        Reconnected(Full, paths::candidates_only()).apply_to(r);
        (r.jitter, r.bounces, r.bdpt.light_paths) = (Jitter::Always, 3, 4.0);
    });
    Some(rig)
}

/// Rays pass the panes by random numbers: on the way from vertex to vertex, and to the camera.
fn panes(rig: &mut Rig) {
    room(rig);
    for (x, z) in [(-0.4, 0.9), (0.4, 0.6)] {
        let pane = StandardMaterial {
            base_color: Color::linear_rgba(0.6, 0.6, 0.6, 0.5),
            alpha_mode: AlphaMode::Blend,
            ..lambert(0.6)
        };
        rig.spawn(square(1.6), pane, Transform::from_xyz(x, -0.3, z));
    }
}

/// A diffuse room, and rooms with rough lobes, mirrors and panes.
const SCENES: [(&str, fn(&mut Rig)); 4] = [PATH_SCENES[0], PATH_SCENES[1], PATH_SCENES[2], ("panes", panes)];

/// Without reuse, the light of both domains is that of all light paths that the camera sees.  A path in neither would darken the picture, and
/// one in both would brighten it.
#[test]
#[ignore = "second tier: ./run test --more"]
fn each_light_path_belongs_to_one_domain() {
    for (name, make) in SCENES {
        let Some(mut rig) = light_paths_alone(48, make) else { return };
        let mut luminances = |reconnects| {
            rig.set(|r| (r.bdpt.reconnect_light_paths, r.seed) = (reconnects, 0));
            rig.until_ready();
            // A new seed begins the sequence of random numbers again.
            rig.set(|r| r.seed = 7);
            rig.next().iter().map(|(_, c)| f64::from(c.dot(Vec3::new(0.2126, 0.7152, 0.0722)))).collect::<Vec<_>>()
        };
        let (one, two) = (luminances(false), luminances(true));
        let lit = one.iter().filter(|&&value| value > 0.0).count();
        let wrong = one.iter().zip(&two).filter(|(a, b)| (*a - *b).abs() > 0.01 * a.max(**b)).count();
        let change = two.iter().sum::<f64>() / one.iter().sum::<f64>() - 1.0;
        eprintln!("{name}: {wrong} of {lit} pixels differ, in all by {:.4} %", 100.0 * change);
        assert!(lit > 300 && wrong <= lit / 200 && change.abs() < 2e-3, "{name}: {wrong} of {lit}, {change}");
        rig.assert_sound();
    }
}

/// A rig that shows the results of `reconnected_shift.wgsl`, and the emission that its camera sees in this pose.
fn shift_rig(
    size: u32,
    make: impl FnOnce(&mut Rig),
    pose: impl FnOnce(&mut Rig),
    defs: &[&'static str],
) -> Option<(Rig, Picture)> {
    let mut rig = light_paths_alone(size, make)?;
    leave_out(&mut rig, &SPLATS);
    pose(&mut rig);
    // Emission is the same in all frames.
    rig.set(|r| r.jitter = Jitter::Never);
    let emitted = emission(&mut rig);
    replace_pass_shader(
        &mut rig.app,
        "reconnected_reuse",
        include_str!("../../support/kernels/reconnected_shift.wgsl"),
    );
    plant_shader_defs(&mut rig.app, &[&["TEST_SPLATS", "TEST_ALONE"], defs].concat());
    rig.set(|r| {
        // Many paths lie near the least footprint.
        Reconnected(Full, Paths { footprint: 0.5, ..paths::temporal() }).apply_to(r);
        r.bounces = 3;
    });
    Some((rig, emitted))
}

/// Samples that returned, that have no shift, that were lost, and that returned with another contribution.
#[derive(Debug, Default)]
struct RoundTrips {
    returned: u32,
    no_shift: u32,
    lost: u32,
    coarse: u32,
}

impl RoundTrips {
    /// Pixels that see a light are ignored.
    fn add(&mut self, picture: &Picture, emitted: &Picture) {
        let dark = picture.iter().zip(emitted.iter()).filter(|(_, (_, e))| *e == Vec3::ZERO);
        for ((_, c), _) in dark.filter(|((_, c), _)| c.y > 0.5) {
            match c.x.round() as u32 {
                0 => {
                    self.returned += 1;
                    self.coarse += u32::from(c.z > 0.01);
                }
                1 => self.no_shift += 1,
                _ => self.lost += 1,
            }
        }
    }

    /// Edges and thresholds lie within rounding of few samples.
    fn check(&self, name: &str, least: u32, share: f64) {
        eprintln!("{name}: {self:?}");
        let wrong = f64::from(self.lost + self.coarse);
        assert!(self.returned >= least && wrong <= 2.0 + share * f64::from(self.returned), "{name}: {self:?}");
    }
}

/// Shifts samples to other pixels and back.
fn other_pixels(make: impl FnOnce(&mut Rig), frames: u32) -> Option<RoundTrips> {
    let (mut rig, emitted) = shift_rig(64, make, |_| {}, &["TEST_ROUND_TRIP"])?;
    rig.until_ready();
    let mut trips = RoundTrips::default();
    for seed in 0..frames {
        rig.set(|r| r.seed = seed);
        trips.add(&rig.next(), &emitted);
    }
    Some(trips)
}

/// The contribution of a path is that of its splat, in another measure.  Both include the MIS weight.
#[test]
fn a_reconnected_light_path_contributes_as_much_as_its_splat() {
    let Some((mut rig, emitted)) = shift_rig(64, SCENES[0].1, |_| {}, &["TEST_SPLAT"]) else { return };
    plant_shader_defs(&mut rig.app, &["TEST_SPLAT"]);
    rig.until_ready();
    let mut paths = RoundTrips::default();
    for seed in 0..4 {
        rig.set(|r| r.seed = seed);
        paths.add(&rig.next(), &emitted);
    }
    paths.check("splats", 2_000, 5e-3);
    rig.assert_sound();
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reconnected_light_paths_return_from_other_pixels() {
    for (name, make) in [SCENES[0], SCENES[3]] {
        let Some(trips) = other_pixels(make, 8) else { return };
        trips.check(name, 4_000, 1e-3);
    }
}

/// Shifts samples to the last frame of a motion and back.
fn last_frame(frames: u32) -> Option<RoundTrips> {
    let last = |rig: &mut Rig| pose_moving(rig, STEPS);
    let (mut rig, emitted) = shift_rig(64, moving, last, &["TEST_ROUND_TRIP", "TEST_BEFORE"])?;
    rig.until_ready();
    let mut trips = RoundTrips::default();
    for seed in 0..frames {
        rig.set(|r| r.seed = seed);
        for step in 0..STEPS {
            pose_moving(&mut rig, step);
            rig.frame();
        }
        pose_moving(&mut rig, STEPS);
        trips.add(&rig.next(), &emitted);
    }
    Some(trips)
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reconnected_light_paths_return_from_the_last_frame() {
    let Some(trips) = last_frame(8) else { return };
    trips.check("moving", 2_000, 5e-3);
}

/// The measure of samples that the shift takes to partners, and of those that arrive.
fn measured(make: impl FnOnce(&mut Rig), edits: &[ShaderEdit], frames: u32) -> Option<Measure> {
    let (mut rig, emitted) = shift_rig(SIZE as u32, make, |_| {}, &[])?;
    plant_edits(&mut rig.app, edits);
    rig.until_ready();
    let frames: Vec<Vec<Vec3>> = (0..frames)
        .map(|seed| {
            rig.set(|r| r.seed = seed);
            rig.next().iter().zip(emitted.iter()).map(|((_, c), (_, e))| c - e).collect()
        })
        .collect();
    Some(Measure::of(&frames))
}

/// Frames after which the sums of both sides have a standard error of about 0.4 %, and the difference that is allowed.  With 200 frames it is
/// 0.6 % in the room, and 9 % in a glossy one.
const FRAMES: u32 = 600;
const MARGIN: f64 = 0.03;

#[test]
#[ignore = "second tier: ./run test --more"]
fn the_shift_of_reconnected_light_paths_is_a_change_of_variables() {
    let Some(measure) = measured(PATH_SCENES[0].1, &[], FRAMES) else { return };
    eprintln!("{measure}");
    assert!(measure.is_equal(MARGIN), "{measure}");
}

/// Errors of the measure and of the class of a path.
pub const WRONG: [(&str, &str, &str, &str); 3] = [
    (
        "no distance",
        "restir/reconnected/domain.wgsl",
        "scattered_value(leaving, direction, s.towards_light) * (cos_out / d2);",
        "scattered_value(leaving, direction, s.towards_light) * cos_out;",
    ),
    (
        "no cosine",
        "restir/reconnected/domain.wgsl",
        "scattered_value(leaving, direction, s.towards_light) * (cos_out / d2);",
        "scattered_value(leaving, direction, s.towards_light) / d2;",
    ),
    ("any class", "restir/reconnected/domain.wgsl", "|| !can_reconnect(x.surface, edge, previous) {", "{"),
];

#[test]
#[ignore = "second tier: ./run test --more"]
fn wrong_measures_of_reconnected_light_paths_are_found() {
    for (name, module, from, to) in WRONG {
        let Some(measure) = measured(PATH_SCENES[0].1, &[ShaderEdit { module, from, to }], FRAMES) else { return };
        eprintln!("{name}: {measure}");
        assert!(!measure.is_equal(MARGIN), "{name} is not found: {measure}");
    }
}

/// All kinds of reuse.
fn kinds() -> [(&'static str, Paths); 5] {
    let all = paths::all_reuse();
    let paired = Paths { reuse: Reuse { paired: true, spatial_samples: 3, ..all.reuse.clone() }, ..all.clone() };
    [
        ("none", paths::candidates_only()),
        ("temporal", paths::temporal()),
        ("spatial", paths::spatial()),
        ("both", all),
        ("paired", paired),
    ]
}

fn jittered(make: impl FnOnce(&mut Rig)) -> Option<Rig> {
    let mut rig = scene(32, make)?;
    rig.set(|r| r.jitter = Jitter::Always);
    Some(rig)
}

/// Compares light paths alone with the reference.
fn check_alone(kinds: &[(&'static str, Paths)], proofs: &[(&str, Proof)]) {
    check_alone_in(|rig| corner(rig, false), kinds, proofs);
}

fn check_alone_in(make: impl FnOnce(&mut Rig), kinds: &[(&'static str, Paths)], proofs: &[(&str, Proof)]) {
    let Some(mut rig) = jittered(make) else { return };
    // The reference has no code for these definitions.
    plant_shader_defs(&mut rig.app, &["TEST_SPLATS", "TEST_ALONE"]);
    let subjects: Vec<_> = kinds.iter().map(|(what, paths)| (*what, Reconnected(Lightweight, paths.clone()))).collect();
    for (name, proof) in proofs {
        proof.check(&format!("{name}, reconnected light paths alone"), &mut rig, &subjects);
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reconnected_light_paths_alone_find_all_light_of_a_diffuse_corner() {
    check_alone(&kinds()[3..4], &[("a still corner", STILL), ("a moving corner", MOVING)]);
}

/// The camera comes nearer in long steps.  The least footprint of a reconnection follows its distance.
fn pose_dolly(rig: &mut Rig, step: u32) {
    let away = (STEPS - step) as f32;
    *rig.get_mut::<Transform>(rig.camera) =
        Transform::from_xyz(0.3, 0.2, 4.0 + 1.5 * away).looking_at(Vec3::new(0.0, -0.2, 0.0), Vec3::Y);
}

/// Many paths have changed from one domain to the other since the last frame.  Both domains would count those that are kept.
#[test]
#[ignore = "second tier: ./run test --more"]
fn light_paths_of_the_last_frame_stay_in_their_domain() {
    let often_replayed = Paths { footprint: 3.0, ..paths::all_reuse() };
    // In a run of 10 restarts, paths that are kept in both domains brightened the picture by 1.4 %.
    let proof = Proof {
        ours: Length { restarts: 60, ..MOVING.ours },
        truth: Length { restarts: 24, ..MOVING.truth },
        margin: 0.012,
        pose: Some(&pose_dolly),
        ..MOVING
    };
    check_alone(&[("both", often_replayed)], &[("a camera that comes nearer", proof)]);
}

/// A wall between a lit half and a dark one: most shifts to the other half pass through it.
#[test]
#[ignore = "second tier: ./run test --more"]
fn reconnected_light_paths_do_not_pass_through_a_wall() {
    let halves = |rig: &mut Rig| {
        corner(rig, false);
        let wall = Cuboid::from_size(Vec3::new(0.02, 3.0, 3.0));
        rig.spawn(wall, lambert(0.5), Transform::from_xyz(-0.1, 0.0, 0.3));
    };
    check_alone_in(halves, &kinds()[3..4], &[("a corner with a wall", STILL)]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reconnected_light_paths_alone_find_all_light_with_any_reuse() {
    check_alone(&kinds(), &[("a still corner", STILL), ("a moving corner", MOVING)]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn reconnected_light_paths_beside_caustics_equal_the_reference() {
    let Some(mut rig) = jittered(|rig| corner(rig, true)) else { return };
    let [_, _, _, (_, both), (_, paired)] = kinds();
    let subjects = [
        ("both, lightweight", Reconnected(Lightweight, both.clone())),
        ("both, all techniques", Reconnected(Full, both)),
        ("paired, lightweight", Reconnected(Lightweight, paired)),
    ];
    STILL.check("a still corner with reconnected light paths", &mut rig, &subjects);
    MOVING.check("a moving corner with reconnected light paths", &mut rig, &subjects);
}
