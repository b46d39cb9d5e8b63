//! Light in a head with thin ears and a nose equals the reference: with every shift of ReSTIR SSS, and in the paths of ReSTIR PT.

use super::small_scenes::{SHIFTS, with};
use crate::support::{
    app::*,
    proof::Proof,
    reuse_settings::{paths, subsurface},
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Subsurface, SubsurfaceSampling};
use bevy_restir_support::bodies::head;

/// A head, 2.2 m high, with a lamp before it and one behind it.  The camera sees neither of them.
fn bust(rig: &mut Rig) {
    let skin = StandardMaterial { base_color: Color::linear_rgb(0.83, 0.79, 0.75), reflectance: 0.5, ..lambert(0.8) };
    let place = Transform::from_xyz(0.0, -0.15, 0.0).with_rotation(Quat::from_rotation_y(0.4));
    let body = rig.spawn(head(), skin, place.with_scale(Vec3::splat(20.0)));
    rig.insert(body, Subsurface { mean_free_path: Vec3::new(0.1, 0.05, 0.02), weight: 1.0 });
    rig.spawn(square(1.0), lamp(9.0, 8.0, 7.0), facing(Vec3::new(2.2, 1.8, 1.2), Vec3::ZERO));
    rig.spawn(square(1.2), lamp(5.0, 6.0, 8.0), facing(Vec3::new(-3.3, 0.8, -1.6), Vec3::ZERO));
}

/// Mesa 22.3 needed more than 20 GB of memory for this test when it compiled direct light again in every frame (`view/camera.wgsl`).
#[test]
#[ignore = "minutes, and more than 20 GB of memory: ./run test --full"]
fn full_length_light_in_a_head_equals_the_reference_with_every_shift() {
    let Some(mut rig) = scene(48, bust) else { return };
    let proof = Proof { margin: 0.03, ..Proof::of((40, 10), (24, 40)) };
    let cases: Vec<_> = SHIFTS
        .iter()
        .map(|&shift| (format!("{shift:?}"), with(SubsurfaceSampling { shift, ..subsurface::all_reuse() })))
        .collect();
    let cases: Vec<_> = cases.iter().map(|(name, case)| (name.as_str(), case.clone())).collect();
    proof.check("bust", &mut rig, &cases);
    // Light that leaves the head enters it again beside the nose and behind the ears.
    let proof = Proof { bounces: 2, ..proof };
    proof.check("bust", &mut rig, &[("PT, both", paths::all_reuse())]);
}
