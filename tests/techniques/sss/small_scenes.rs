//! ReSTIR DI with translucent bodies equals the reference at one bounce, still and moving, and planted errors are found.  `every_shift` has
//! all shifts.

use super::shifts::turn;
use crate::support::{
    app::*,
    proof::{Proof, Subject},
    reuse_settings::{di, subsurface},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{
    Direct, Mis, Reuse, ReuseOrder, Subsurface, SubsurfaceSampling, SubsurfaceShift,
    testing::{plant_shader_defs, shader_library::ShaderEdit},
};

fn with(sampling: SubsurfaceSampling) -> (Direct, SubsurfaceSampling) {
    // Pixels of a tile share a subset of the lights, so that small pictures with subsets are noisy as a whole.
    (Direct { subset_count: 0, ..di::all_reuse() }, sampling)
}

/// For pictures of 64 x 64 pixels.
pub(super) const PROOF: Proof = Proof { margin: 0.02, ..Proof::of((40, 16), (40, 64)) };
/// The same in motion.
pub(super) const MOVING: Proof = Proof { margin: 0.03, ..Proof::of((160, 1), (20, 64)) };

/// The bodies of [`translucent`], none as its mesh is: the ball is stretched, and the slab and the plate are mirrored.  Tests of one process
/// render their references once.
pub(super) fn bodies() -> Option<Rig> {
    let mut ball = Entity::PLACEHOLDER;
    let mut rig = scene(64, |rig| ball = translucent(rig)[0])?;
    let world = rig.app.world_mut();
    let bodies: Vec<Entity> = world.query_filtered::<Entity, With<Subsurface>>().iter(world).collect();
    for body in bodies {
        let scale = if body == ball { Vec3::new(1.3, 0.8, 1.0) } else { Vec3::new(-1.0, 1.0, 1.0) };
        rig.get_mut::<Transform>(body).scale = scale;
    }
    rig.shared = Some("translucent bodies".into());
    Some(rig)
}

#[test]
fn light_in_translucent_bodies_equals_the_reference() {
    let Some(mut rig) = bodies() else { return };
    let proof = Proof { margin: 0.05, ..Proof::of((12, 6), (10, 20)) };
    let sampling = SubsurfaceSampling { shift: SubsurfaceShift::Sequential, ..subsurface::all_reuse() };
    proof.check("bodies", &mut rig, &[("Sequential, both", with(sampling))]);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_candidates_and_other_weights_in_translucent_bodies_equal_the_reference() {
    let Some(mut rig) = bodies() else { return };
    let weighted = |mis, order| {
        let reuse = Reuse { mis, order, ..subsurface::all_reuse().reuse };
        with(SubsurfaceSampling { reuse, ..subsurface::all_reuse() })
    };
    let cases = [
        ("candidates", with(subsurface::candidates_only())),
        ("Hybrid, balance", weighted(Mis::Balance, ReuseOrder::TemporalThenSpatial)),
        ("Hybrid, spatiotemporal", weighted(Mis::Pairwise, ReuseOrder::Spatiotemporal)),
    ];
    PROOF.check("bodies", &mut rig, &cases);
    // 1/|Z| is noisier than the other weights.
    let noisy = [("Hybrid, 1/|Z|", weighted(Mis::OneOverZ, ReuseOrder::TemporalThenSpatial))];
    Proof { margin: 0.03, ..Proof::of((80, 16), (40, 64)) }.check("bodies", &mut rig, &noisy);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_presampled_light_in_translucent_bodies_equals_the_reference() {
    let Some(mut rig) = bodies() else { return };
    let proof = Proof { margin: 0.03, ..PROOF };
    proof.check("bodies", &mut rig, &[("subsets", (di::all_reuse(), subsurface::all_reuse()))]);
}

/// With the geometry heuristics, the radius and the numbers of the default settings, still and moving.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_the_default_settings_of_translucent_bodies_equal_the_reference() {
    let Some(mut rig) = bodies() else { return };
    let cases = [("default", with(SubsurfaceSampling::default()))];
    PROOF.check("bodies", &mut rig, &cases);
    check_moving(MOVING, &cases);
}

/// Compares techniques with the reference in bodies that turn and grow under a lamp that moves.
pub(super) fn check_moving(proof: Proof, techniques: &[(&str, impl Subject)]) {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let Some(mut rig) = scene(64, |rig| moving = translucent(rig)) else { return };
    rig.shared = Some("moving translucent bodies".into());
    let pose = |rig: &mut Rig, step: u32| turn(rig, moving, step as f32);
    Proof { pose: Some(&pose), ..proof }.check("moving", &mut rig, techniques);
}

/// When the `Subsurface` of a body changes, samples of the last frame treat the body as a different object.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_bodies_whose_values_change_equal_the_reference() {
    let mut moving = [Entity::PLACEHOLDER; 2];
    let Some(mut rig) = scene(64, |rig| moving = translucent(rig)) else { return };
    let pose = |rig: &mut Rig, step: u32| {
        let mean_free_path = Vec3::new(0.3, 0.1, 0.02) / (1 + step % 5) as f32;
        rig.insert(moving[0], Subsurface { mean_free_path, weight: 1.0 - 0.1 * (step % 5) as f32 });
    };
    let proof = Proof { pose: Some(&pose), ..MOVING };
    proof.check("changing", &mut rig, &[("both", with(subsurface::all_reuse()))]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn planted_errors_in_translucent_bodies_are_found() {
    let Some(mut rig) = bodies() else { return };
    let proof = Proof::of((16, 8), (10, 32));
    let reference = proof.truth(&mut rig, 1000);
    // On flat bodies a missing Jacobian changes little; `shifts` finds it.
    let planted =
        [("PLANT_ONE_AXIS", with(subsurface::candidates_only())), ("PLANT_SWAPPED_MIS", with(subsurface::spatial()))];
    proof.finds(&mut rig, &reference, planted);
    // Probes do not count by the cosine at which they cross the surface.
    plant_shader_defs(&mut rig.app, &[]);
    plant_edits(&mut rig.app, &[COSINE]);
    let found = proof.resampled(&mut rig, &with(subsurface::candidates_only()), 5000).compare(&reference, 0.01);
    eprintln!("{COSINE:?}: {found}");
    assert!(found.is_different(), "{found}");
}

/// A wrong density of probes.
const COSINE: ShaderEdit = ShaderEdit {
    module: "subsurface/probe.wgsl",
    from: "let along = abs(n_geo * frame);",
    to: "let along = vec3<f32>(1.0);",
};

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_nan_stays_in_its_reservoir_of_translucent_bodies() {
    let Some(mut rig) = bodies() else { return };
    let proof = Proof { margin: 0.01, ..Proof::of((120, 16), (80, 64)) };
    proof.survives_nan(&mut rig, &[with(subsurface::all_reuse())]);
}

/// A pixel that loses its own sample between two passes of a frame has nothing to weigh its neighbor's sample against: its light in that
/// frame is noise without a bound.  It spreads no further than any bright pixel.
#[test]
#[ignore = "second tier: ./run test --more"]
fn samples_that_are_lost_between_passes_leave_a_finite_picture() {
    let Some(mut rig) = bodies() else { return };
    rig.set(|r| with(subsurface::all_reuse()).apply_to(r));
    plant_shader_defs(&mut rig.app, &["PLANT_NAN", "PLANT_BETWEEN_PASSES"]);
    let picture = rig.picture(16);
    assert!(picture.is_finite() && picture.mean() > 0.0);
    rig.assert_raised(&["reservoir"]);
}
