//! The bias of reconnected samples that keep the probes of other pixels.  It has opposite signs on both sides of the boundary of a shadow, so
//! that it hardly changes the mean of a picture.

use super::shifts::STALE;
use crate::support::{
    app::*,
    oracle::subsurface::length_of,
    proof::Subject,
    reuse_settings::{di, subsurface},
};
use bevy::prelude::*;
use bevy_restir::{
    Direct, Mis, Reuse, Subsurface, SubsurfaceSampling, SubsurfaceShift, Technique, testing::shader_library::ShaderEdit,
};

const ALBEDO: f32 = 0.8;
/// The number of pixels in each row.  All pixels of a row see almost the same point, but are independent of each other.
const COLUMNS: u32 = 64;
/// Angles between the sun and the normals that the two rows see, in degrees.
const ANGLES: [f32; 2] = [80.0, 97.0];

/// Each pixel has one neighbor, which is in the other row.
const OPPOSITE: ShaderEdit = ShaderEdit {
    module: "restir/neighbors.wgsl",
    from: "at = center.position + neighbor_offset(center, is_temporal, t, rng_2(rng));",
    to: "at = vec2<f32>(view.size) - center.position;",
};

/// A ball under a sun, and two rows of pixels on either side of the boundary of its own shadow.  A plate shades a part of its upper side, too.
fn boundary() -> Option<Rig> {
    let mut rig = Rig::new(COLUMNS, 2)?;
    let [lit, dark] = ANGLES.map(|angle| angle.to_radians().cos());
    let middle = Transform::from_xyz(0.1, 0.5 * (lit + dark), 5.0);
    rig.insert(rig.camera, (orthographic(0.02, 2.0 * (lit - dark)), middle));
    let mesh = Sphere::new(1.0).mesh().ico(40).expect("few enough triangles");
    let ball = rig.spawn(mesh, lambert(ALBEDO), Transform::default());
    // The profile of red has a third of the radius as its length.
    let lengths = Vec3::new(1.0, 0.37, 0.185) / 3.0;
    let mean_free_path = lengths / length_of(1.0, f64::from(ALBEDO)) as f32;
    rig.insert(ball, Subsurface { mean_free_path, weight: 1.0 });
    rig.spawn(Cuboid::new(10.0, 0.1, 10.0), lambert(0.0), Transform::from_xyz(-5.4, 3.0, 0.0));
    let down = Transform::default().looking_to(Vec3::NEG_Y, Vec3::X);
    rig.spawn_bundle((DirectionalLight { illuminance: 3.0, ..default() }, down));
    Some(rig)
}

/// The mean luminance of each row, and its standard error.
fn rows(rig: &mut Rig, frames: u32) -> [(f64, f64); 2] {
    rig.set(|r| r.accumulate = true);
    let picture = rig.picture(frames);
    let luminance = |c: Vec3| f64::from(c.dot(Vec3::new(0.2126, 0.7152, 0.0722)));
    [0, 1].map(|y| mean_and_error((0..COLUMNS).map(|x| luminance(picture.at(x, y)))))
}

/// The relative differences of both rows from the truth: of the lit one, and of the dark one.  Their standard errors are below 1 %.
fn differences(rig: &mut Rig, truth: &[(f64, f64); 2], what: &str) -> [f64; 2] {
    let found = rows(rig, 8_000);
    [0, 1].map(|row: usize| {
        let ((expected, error), (mean, own_error)) = (truth[row], found[row]);
        let (difference, error) = (mean / expected - 1.0, error.hypot(own_error) / expected);
        eprintln!("{what}, {} degrees: {:+.2} % ± {:.2}", ANGLES[row], 100.0 * difference, 100.0 * error);
        assert!(error < 0.01, "{what}: the test has no power: {error}");
        difference
    })
}

/// The scene, pixels and passes are those of a numerical experiment without shaders, in which such probes make the dark pixel 20 % too bright
/// and the lit one 6 % too dark.
#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_stale_probes_move_light_across_the_boundary_of_a_shadow() {
    let Some(mut rig) = boundary() else { return };
    rig.set(|r| (r.technique, r.bounces) = (Technique::Reference, 1));
    let truth = rows(&mut rig, 16_000);
    // An iteration that reconnects, and one that draws probes again.
    let reuse = Reuse { mis: Mis::Balance, ..subsurface::spatial().reuse };
    let sampling = SubsurfaceSampling { shift: SubsurfaceShift::Sequential, reuse, ..subsurface::spatial() };
    rig.set(|r| (Direct { subset_count: 0, ..di::candidates_only() }, sampling).apply_to(r));
    plant_edits(&mut rig.app, &[OPPOSITE]);
    let [lit, dark] = differences(&mut rig, &truth, "new probes");
    assert!(lit.abs() < 0.03 && dark.abs() < 0.04, "{lit}, {dark}");
    plant_edits(&mut rig.app, &[OPPOSITE, STALE]);
    let [lit, dark] = differences(&mut rig, &truth, "stale probes");
    assert!(lit < -0.02 && dark > 0.08, "{lit}, {dark}");
    rig.assert_sound();
}
