//! Each shift of light that enters translucent bodies is its own inverse and a change of variables, between the pixels of a picture, and to
//! the last frame while bodies turn and grow.

use crate::support::{
    app::*,
    change_of_measure::{Measure, SIZE},
    proof::Subject,
    reuse_settings::{di, subsurface},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    DebugView, Direct, SubsurfaceSampling, SubsurfaceShift,
    testing::{plant_shader_defs, replace_pass_shader, shader_library::ShaderEdit},
};

/// Sequential shifts are reconnection and delayed reconnection, one after the other.
const SHIFTS: [SubsurfaceShift; 3] = [SubsurfaceShift::Reconnection, SubsurfaceShift::Delayed, SubsurfaceShift::Hybrid];

/// The picture has the light of this domain alone.
const ALONE: ShaderEdit = ShaderEdit {
    module: "pass/resolve.wgsl",
    from: "guarded_pixel(directly_seen(ids, pixel) + scattered.rgb)",
    to: "guarded_pixel(select(vec3<f32>(0.0), subsurface_light(pixel).rgb, ids.x != 0xffffffffu))",
};

/// Samples are selected without regard to their light, so that their contribution weights are bounded.
const ANY_SAMPLE: ShaderEdit = ShaderEdit {
    module: "restir/sss/initial_candidates.wgsl",
    from: "let value = luminance(f);",
    to: "let value = f32(luminance(f) > 0.0);",
};

/// A scene whose candidates show the result of a shift.
fn shift_scene(size: u32, edits: &[ShaderEdit], defs: &[&'static str], moving: &mut [Entity; 2]) -> Option<Rig> {
    let mut rig = scene(size, |rig| *moving = translucent(rig))?;
    for (pass, kernel) in [
        ("sss_candidates", include_str!("../../support/kernels/subsurface_shift.wgsl")),
        ("sss_reuse", include_str!("../../support/kernels/copied_light.wgsl")),
        // Compiling passes takes longer than running them.
        ("di_candidates", "@compute @workgroup_size(8, 8)\nfn di_candidates() {}\n"),
        ("di_reuse", "@compute @workgroup_size(8, 8)\nfn reuse() {}\n"),
    ] {
        replace_pass_shader(&mut rig.app, pass, kernel);
    }
    plant_edits(&mut rig.app, &[&[ALONE], edits].concat());
    plant_shader_defs(&mut rig.app, defs);
    Some(rig)
}

fn choose(rig: &mut Rig, shift: SubsurfaceShift, candidates: u32) {
    let alone = SubsurfaceSampling { shift, candidates, ..subsurface::candidates_only() };
    rig.set(|r| (Direct { subset_count: 0, ..di::candidates_only() }, alone).apply_to(r));
    rig.until_ready();
}

fn pixels(rig: &mut Rig, seed: u32) -> Vec<Vec3> {
    rig.set(|r| r.seed = seed);
    rig.next().iter().map(|(_, c)| c).collect()
}

/// Round trips: the number of samples that returned, by the kind of shift (reconnected, drawn again), that did not arrive, and that were lost
/// on the way back; the number with an error above 5 %, and the largest error.  Of samples that were lost or have such an error, those that lie
/// at an edge count apart.
#[derive(Debug, Default)]
struct RoundTrips {
    returned: [u32; 2],
    away: u32,
    /// Undefined, another point, no light, hidden.
    lost: [u32; 4],
    at_edge: u32,
    coarse: u32,
    worst: f32,
}

impl RoundTrips {
    fn add(&mut self, c: Vec3) {
        match c.x.round() as usize {
            0 => {
                self.returned[usize::from(c.y > 1.5)] += 1;
                self.coarse += u32::from(c.z > 0.05);
                self.worst = self.worst.max(c.z);
            }
            5 => self.at_edge += 1,
            50 => self.away += 1,
            reason => self.lost[reason - 1] += 1,
        }
    }

    /// Rounding moves a point of a probe across an edge now and then: the kernel finds the edge by probes beside it, of which some see other
    /// light.  Nothing else may lose a sample, and a reconnection none at all.
    fn assert_fine(&self, what: &str, least: u32) {
        eprintln!("{what}: {self:?}");
        let back = self.returned.iter().sum::<u32>();
        assert!(back > least, "{what}: {self:?}");
        assert_eq!((self.lost, self.coarse), ([0; 4], 0), "{what}: {self:?}");
        assert!(f64::from(self.at_edge) < 2e-3 * f64::from(back), "{what}: {self:?}");
    }
}

fn check_round_trips(size: u32, frames: u32, least: u32) {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let Some(mut rig) = shift_scene(size, &[], &["TEST_ROUND_TRIP", "TEST_BESIDE"], &mut moving) else { return };
    for shift in SHIFTS {
        choose(&mut rig, shift, 4);
        let mut trips = [RoundTrips::default(), RoundTrips::default()];
        for step in 0..frames {
            turn(&mut rig, moving, step as f32);
            // Another seed has no last frame.
            for (_, c) in rig.next().iter().filter(|(_, c)| c.y > 0.5) {
                let before = c.y > 2.5;
                trips[usize::from(before)].add(if before { c - 2.0 * Vec3::Y } else { c });
            }
        }
        for (trips, name) in trips.iter().zip(["beside", "before"]) {
            trips.assert_fine(&format!("{shift:?}, {name}"), least);
        }
    }
}

/// A step of a motion: the ball turns and is stretched, and a lamp moves.
pub(super) fn turn(rig: &mut Rig, moving: [Entity; 2], step: f32) {
    let mut body = rig.get_mut::<Transform>(moving[0]);
    body.rotation = Quat::from_rotation_y(0.2 * step);
    body.scale = Vec3::new(1.0 + 0.05 * (step % 5.0), 1.0, 1.0);
    rig.get_mut::<Transform>(moving[1]).translation.x = 0.5 - 0.1 * (step % 5.0);
}

#[test]
fn light_in_bodies_returns_unchanged_from_other_pixels_and_the_last_frame() {
    check_round_trips(64, 6, 2_000);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_hundred_thousand_samples_in_bodies_return_unchanged() {
    check_round_trips(256, 24, 100_000);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_a_million_samples_in_bodies_return_unchanged() {
    check_round_trips(256, 240, 1_000_000);
}

#[test]
fn delayed_reconnection_has_the_jacobian_of_finite_differences() {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let Some(mut rig) = shift_scene(64, &[], &["TEST_JACOBIAN", "TEST_BESIDE"], &mut moving) else { return };
    choose(&mut rig, SubsurfaceShift::Delayed, 4);
    let mut errors: Vec<f32> =
        (0..6).flat_map(|seed| pixels(&mut rig, seed)).filter(|c| c.y > 0.5).map(|c| (c.x - 1.0).abs()).collect();
    errors.sort_by(f32::total_cmp);
    let quantile = |q: f64| errors[(q * errors.len() as f64) as usize];
    eprintln!("{} samples, error {} at most for half, {} for 95 %", errors.len(), quantile(0.5), quantile(0.95));
    assert!(errors.len() > 2_000 && quantile(0.5) < 0.01 && quantile(0.95) < 0.05);
}

/// The change of measure between paired pixels.
fn measured(plants: &[&'static str], shift: SubsurfaceShift, seeds: u32) -> Option<Measure> {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let mut rig = shift_scene(SIZE as u32, &[ANY_SAMPLE], &[&["TEST_CENSUS"], plants].concat(), &mut moving)?;
    choose(&mut rig, shift, 1);
    let frames: Vec<_> = (0..seeds).map(|seed| pixels(&mut rig, seed)).collect();
    let measure = Measure::of(&frames);
    eprintln!("{shift:?}, {plants:?}: {measure}");
    Some(measure)
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_the_jacobian_is_the_change_of_measure_of_every_shift_in_bodies() {
    for shift in SHIFTS {
        let Some(measure) = measured(&[], shift, 1600) else { return };
        assert!(measure.is_equal(0.02), "{shift:?}: {measure}");
    }
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn a_shift_in_bodies_that_is_not_a_change_of_variables_is_found() {
    let Some(measure) = measured(&["PLANT_NO_JACOBIAN"], SubsurfaceShift::Delayed, 100) else { return };
    assert!(measure.tiles < 1e-9, "{measure}");
}

/// The share of the stored samples whose probe finds their point of entry from the pixel that stores them.
fn samples_found_by_their_probes(rig: &mut Rig, moving: [Entity; 2]) -> f32 {
    let mut stored = Vec2::ZERO;
    for step in 0..6 {
        turn(rig, moving, step as f32);
        stored += rig.next().iter().map(|(_, c)| c.xy()).sum::<Vec2>();
    }
    eprintln!("{} of {} samples found again", stored.y, stored.x);
    assert!(stored.x > 2_000.0);
    stored.y / stored.x
}

/// Reconnected samples keep the probes of the pixels that they come from.
pub(super) const STALE: ShaderEdit =
    ShaderEdit { module: "restir/sss/domain.wgsl", from: "!has(RESAMPLE_INVERT_PROBES) ||", to: "true ||" };

/// Sequential shifts reconnect samples before they draw their probes again, so that reconnected samples need new probes.
#[test]
fn probes_of_sequential_shifts_find_the_stored_points_again() {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let Some(mut rig) = scene(64, |rig| moving = translucent(rig)) else { return };
    replace_pass_shader(&mut rig.app, "sss_debug", include_str!("../../support/kernels/stored_probes.wgsl"));
    let sampling = SubsurfaceSampling { shift: SubsurfaceShift::Sequential, ..subsurface::all_reuse() };
    rig.set(|r| {
        (Direct { subset_count: 0, ..di::candidates_only() }, sampling).apply_to(r);
        r.debug_view = DebugView::SubsurfaceDistances;
    });
    rig.until_ready();
    let found = samples_found_by_their_probes(&mut rig, moving);
    assert!(found > 0.995, "{found}");
    plant_edits(&mut rig.app, &[STALE]);
    rig.until_ready();
    let found = samples_found_by_their_probes(&mut rig, moving);
    assert!(found < 0.9, "{found}");
}
