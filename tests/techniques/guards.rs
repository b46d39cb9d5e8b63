//! The guards of the shaders: each stops the numbers that it is for, and no other guard meets them; legal numbers raise none.

use super::ray_counts::count_rays;
use crate::support::{
    app::*,
    gpu::{Bound, gpu},
    small_scenes::{room, translucent_room},
};
use bevy::prelude::*;
use bevy_restir::{
    DebugView, Denoiser, Restir, Technique,
    testing::{gpu_layout::*, guards::GUARDS, plant_shader_defs},
};
use std::collections::BTreeSet;

const NAN: u32 = 0x7fc0_0000;
const INFINITY: u32 = 0x7f80_0000;
const MINUS_ONE: u32 = 0xbf80_0000;

/// The output of the kernel `guard` for one number.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
struct Out {
    number: u32,
    raised: u32,
    color: [u32; 2],
    raised_by_color: u32,
    with_infinity: u32,
    raised_with_infinity: u32,
    raised_by_condition: u32,
}

#[test]
fn guards_pass_finite_numbers_that_are_not_negative() {
    let Some(gpu) = gpu() else { return };
    let one = 1f32.to_bits();
    let legal = [0, one, 0x0080_0000, f32::MAX.to_bits(), 0x8000_0000];
    let overflow = [INFINITY];
    let illegal = [NAN, 0xffc0_0000, 0x7f80_0001, 0xff80_0000, MINUS_ONE, (-f32::MIN_POSITIVE).to_bits()];
    let numbers: Vec<u32> = legal.iter().chain(&overflow).chain(&illegal).copied().collect();
    let input = gpu.storage(&numbers);
    let results = gpu.zeroed::<Out>(numbers.len());
    let kernel = gpu.kernel("guard", include_str!("../support/kernels/guard.wgsl"), &[]);
    kernel.run([numbers.len() as u32, 1, 1], &[(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&results))]);
    for (bits, out) in numbers.iter().zip(gpu.read::<Out>(&results)) {
        let is_legal = legal.contains(bits);
        let guard = match bits {
            _ if is_legal => 0,
            &INFINITY => GUARD_FLOAT_OVERFLOW,
            _ => GUARD_RAY,
        };
        // Numbers pass unchanged, except for the sign of zero.
        let passed = |found: u32, number: u32| is_legal && f32::from_bits(found) == f32::from_bits(number);
        assert!(if is_legal { passed(out.number, *bits) } else { out.number == 0 }, "{bits:#x}: {out:?}");
        assert!(if is_legal { passed(out.color[1], one) } else { out.color == [0, 0] }, "{bits:#x}: {out:?}");
        assert_eq!((out.raised, out.raised_by_color), (guard, guard), "{bits:#x}");
        assert_eq!(out.with_infinity == INFINITY, *bits == INFINITY, "{bits:#x}");
        assert_eq!(out.raised_with_infinity, guard & GUARD_RAY, "{bits:#x}");
        assert_eq!(out.raised_by_condition, if is_legal { 0 } else { GUARD_RAY }, "{bits:#x}");
    }
}

/// Guards that fail together, the technique, the bits that are planted there, and the guards that are raised.
type Plant = (&'static [&'static str], Technique, u32, &'static [&'static str]);

/// Each guard with one technique.
const QUICK: &[Plant] = {
    use Technique::{Bdpt, Di, Gi, Pt, Reference};
    const PATHS: &[&str] = &["non_finite", "negative_pixel", "light_contribution", "bsdf_sample", "throughput"];
    const WEIGHTS: &[&str] = &["resampling_weight", "contribution_weight", "target", "mis_weight"];
    const SHIFTS: &[&str] = &["shift_contribution", "jacobian"];
    const LIGHT_PATHS: &[&str] = &["light_contribution", "throughput", "contribution_weight"];
    &[
        (PATHS, Reference, NAN, PATHS),
        (&["surface", "light_sample"], Reference, MINUS_ONE, &["surface", "light_sample"]),
        (&["ray", "light_contribution"], Reference, INFINITY, &["float_overflow", "ray"]),
        (WEIGHTS, Di, MINUS_ONE, WEIGHTS),
        (SHIFTS, Pt, NAN, SHIFTS),
        (&["gi_measure"], Gi, NAN, &["gi_measure"]),
        (&["reservoir"], Di, NAN, &["reservoir"]),
        (LIGHT_PATHS, Bdpt, NAN, LIGHT_PATHS),
    ]
};

/// Guards of light that scatters below surfaces.
const QUICK_BELOW: &[Plant] =
    &[(&["light_contribution", "reservoir"], Technique::Di, NAN, &["light_contribution", "reservoir"])];

/// The same guards, each alone with each technique.
const FULL_BELOW: &[Plant] = {
    use Technique::{Bdpt, Di, Gi, Pt, Reference};
    &[
        (&["throughput"], Reference, NAN, &["throughput"]),
        (&["light_contribution"], Di, MINUS_ONE, &["light_contribution"]),
        (&["contribution_weight"], Gi, NAN, &["contribution_weight"]),
        (&["reservoir"], Di, NAN, &["reservoir"]),
        (&["throughput"], Pt, NAN, &["throughput"]),
        (&["throughput"], Bdpt, NAN, &["throughput"]),
    ]
};

/// Each guard alone with each technique that has numbers of its own for it.
const FULL: &[Plant] = {
    use Technique::{Bdpt, Di, Gi, Pt, Reference};
    &[
        (&["non_finite"], Reference, NAN, &["non_finite"]),
        (&["non_finite"], Pt, INFINITY, &["non_finite"]),
        (&["negative_pixel"], Reference, NAN, &["negative_pixel"]),
        (&["ray"], Pt, NAN, &["ray"]),
        (&["surface"], Reference, NAN, &["surface"]),
        (&["light_sample"], Reference, NAN, &["light_sample"]),
        (&["light_sample"], Di, MINUS_ONE, &["light_sample"]),
        (&["light_contribution"], Reference, NAN, &["light_contribution"]),
        (&["light_contribution"], Pt, INFINITY, &["float_overflow"]),
        (&["bsdf_sample"], Reference, MINUS_ONE, &["bsdf_sample"]),
        (&["bsdf_sample"], Pt, NAN, &["bsdf_sample"]),
        (&["throughput"], Reference, NAN, &["throughput"]),
        (&["throughput"], Gi, NAN, &["throughput"]),
        (&["resampling_weight"], Di, NAN, &["resampling_weight"]),
        (&["contribution_weight"], Di, MINUS_ONE, &["contribution_weight"]),
        (&["target"], Pt, NAN, &["target"]),
        (&["mis_weight"], Di, NAN, &["mis_weight"]),
        (&["mis_weight"], Pt, NAN, &["mis_weight"]),
        (&["shift_contribution"], Pt, NAN, &["shift_contribution"]),
        (&["jacobian"], Pt, MINUS_ONE, &["jacobian"]),
        (&["gi_measure"], Gi, NAN, &["gi_measure"]),
        (&["reservoir"], Di, NAN, &["reservoir"]),
        (&["reservoir"], Gi, NAN, &["reservoir"]),
        (&["reservoir"], Pt, NAN, &["reservoir"]),
        (&["light_sample"], Bdpt, NAN, &["light_sample"]),
        (&["light_contribution"], Bdpt, MINUS_ONE, &["light_contribution"]),
        (&["throughput"], Bdpt, NAN, &["throughput"]),
        (&["contribution_weight"], Bdpt, NAN, &["contribution_weight"]),
        (&["shift_contribution"], Bdpt, NAN, &["shift_contribution"]),
        (&["reservoir"], Bdpt, NAN, &["reservoir"]),
    ]
};

/// Definitions that make guards fail.
fn planted(rig: &mut Rig, guards: &[&str], bits: u32) {
    let bit = |name: &&str| GUARDS.iter().find(|g| g.name == *name).expect("a guard has this name").bit;
    let mask: u32 = guards.iter().map(bit).sum();
    plant_shader_defs(&mut rig.app, &[&format!("PLANTED_GUARDS={mask}"), &format!("PLANTED_BITS={bits}")]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn the_debug_view_of_guards_shows_the_pixels_that_raised_one() {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    room(&mut rig);
    let is_black = |picture: &Picture| picture.iter().map(|(_, color)| color == Vec3::ZERO).collect::<Vec<_>>();
    for technique in [Technique::Reference, Technique::Pt] {
        rig.set(|r| (r.technique, r.bounces, r.debug_view) = (technique, 4, DebugView::Guards));
        plant_shader_defs(&mut rig.app, &[]);
        assert!(is_black(&rig.picture(2)).iter().all(|black| *black), "{technique:?}");
        planted(&mut rig, &["bsdf_sample"], NAN);
        let shown = is_black(&rig.picture(2)).iter().filter(|black| !**black).count();
        assert!(shown > 64, "{technique:?}: {shown} of 256 pixels");
        rig.assert_raised(&["bsdf_sample"]);
        rig.reset_guards();
    }
}

/// Asserts that planted failures in a scene raise exactly the expected guards, and leave the picture finite.  Returns these guards; `None`
/// without an adapter.
fn check(make: impl FnOnce(&mut Rig), plants: &[Plant]) -> Option<BTreeSet<&'static str>> {
    let mut rig = Rig::new(16, 16)?;
    make(&mut rig);
    rig.set(|r| r.bounces = 4);
    let mut tested = BTreeSet::new();
    for &(guards, technique, bits, raised) in plants {
        planted(&mut rig, guards, bits);
        rig.set(|r| (r.technique, r.accumulate) = (technique, true));
        rig.until_ready();
        rig.reset_guards();
        let picture = rig.picture(4);
        assert!(picture.is_finite(), "{guards:?}, {technique:?}");
        eprintln!("{guards:?}, {technique:?}: {:?}", rig.report().raised_guards());
        rig.assert_raised(raised);
        tested.extend(raised);
    }
    Some(tested)
}

/// [`check`] in a room, for each guard.
fn check_all(plants: &[Plant]) {
    let make = |rig: &mut Rig| _ = room(rig);
    let Some(tested) = check(make, plants) else { return };
    // Traversals overflow in `tracing::traversal`.
    let others = GUARDS.iter().map(|guard| guard.name).filter(|name| !tested.contains(name));
    assert_eq!(others.collect::<Vec<_>>(), ["overflow_stack", "overflow_steps", "overflow_probe"]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn every_guard_stops_its_numbers_and_is_raised() {
    check_all(QUICK);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_each_guard_stops_its_number_and_is_raised_alone() {
    check_all(FULL);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn guards_of_light_below_surfaces_stop_its_numbers_and_are_raised() {
    check(translucent_room, QUICK_BELOW);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_guards_of_light_below_surfaces_are_raised_alone() {
    check(translucent_room, FULL_BELOW);
}

/// Without counts of rays, the pass that writes light counts the guards of all passes, as `statistics` does otherwise.
fn check_without_rays(settings: &Restir, guard: &'static str) {
    let Some(mut rig) = Rig::new(16, 16) else { return };
    room(&mut rig);
    rig.set(|r| *r = settings.clone());
    planted(&mut rig, &[guard], NAN);
    let [with, without] = [true, false].map(|counts_rays| {
        count_rays(&rig, counts_rays);
        rig.until_ready();
        rig.frames(3);
        assert_eq!(rig.report().rays > 0, counts_rays);
        // The same frames.
        rig.reset_guards();
        rig.set(|r| r.reset = true);
        rig.frames(6);
        rig.report().raised_guards()
    });
    assert!(matches!(with[..], [(raised, 64..)] if raised == guard), "{with:?}");
    assert_eq!(with, without);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn guards_are_counted_without_rays() {
    check_without_rays(&Restir { technique: Technique::Di, ..plain() }, "resampling_weight");
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn guards_of_paths_and_of_the_denoiser_are_counted_without_rays() {
    check_without_rays(&Restir { bounces: 4, ..plain() }, "bsdf_sample");
    // Light that was denoised is guarded by the pass that counts.
    check_without_rays(&Restir { technique: Technique::Di, denoiser: Denoiser::ON, ..plain() }, "negative_pixel");
}

#[test]
fn guards_are_counted_over_the_whole_run_and_a_new_size() {
    let Some(mut rig) = Rig::new(12, 8) else { return };
    room(&mut rig);
    let count = |rig: &Rig| rig.report().raised_guards();
    rig.until_ready();
    rig.assert_sound();
    planted(&mut rig, &["non_finite"], NAN);
    rig.until_ready();
    rig.frames(3);
    plant_shader_defs(&mut rig.app, &[]);
    rig.until_ready();
    rig.frames(5);
    let counted = count(&rig);
    assert!(matches!(counted[..], [("non_finite", 1..)]), "{counted:?}");
    assert_eq!(rig.report().non_finite_pixels, 0, "no pixel of the last frame");
    // Another size gives the camera new buffers, but it stays the same run.
    let target = rig.target.clone();
    rig.edit(&target, |image| *image = target_image(UVec2::new(16, 8)));
    rig.until_ready();
    rig.frames(3);
    assert_eq!(count(&rig), counted);
    rig.reset_guards();
    assert_eq!(count(&rig), []);
    rig.assert_sound();
}
