//! Light in a head with thin ears and a nose: the scene, and paths in it that have all light.  `every_shift` has direct light apart.

use crate::support::{app::*, proof::Proof, reuse_settings::paths, small_scenes::*};
use bevy::prelude::*;
use bevy_restir::Subsurface;
use bevy_restir_support::bodies::head;

/// For pictures of [`bust_scene`].
pub(super) const PROOF: Proof = Proof { margin: 0.03, ..Proof::of((40, 10), (40, 40)) };
/// With a second bounce, because light that leaves the head enters it again beside the nose and behind the ears.
pub(super) const PATHS: Proof = Proof { bounces: 2, ..PROOF };

/// A head, 2.2 m high, with a lamp before it and one behind it.  The camera sees neither of them.
fn bust(rig: &mut Rig) {
    let skin = StandardMaterial { base_color: Color::linear_rgb(0.83, 0.79, 0.75), reflectance: 0.5, ..lambert(0.8) };
    let place = Transform::from_xyz(0.0, -0.15, 0.0).with_rotation(Quat::from_rotation_y(0.4));
    let body = rig.spawn(head(), skin, place.with_scale(Vec3::splat(20.0)));
    rig.insert(body, Subsurface { mean_free_path: Vec3::new(0.1, 0.05, 0.02), weight: 1.0 });
    rig.spawn(square(1.0), lamp(9.0, 8.0, 7.0), facing(Vec3::new(2.2, 1.8, 1.2), Vec3::ZERO));
    rig.spawn(square(1.2), lamp(5.0, 6.0, 8.0), facing(Vec3::new(-3.3, 0.8, -1.6), Vec3::ZERO));
}

/// [`bust`] in 48 x 48 pixels.  Tests of one process render its references once.
pub(super) fn bust_scene() -> Option<Rig> {
    let mut rig = scene(48, bust)?;
    rig.shared = Some("bust".into());
    Some(rig)
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_paths_in_a_head_equal_the_reference() {
    let Some(mut rig) = bust_scene() else { return };
    PATHS.check("bust", &mut rig, &[("PT, both", paths::all_reuse())]);
}
