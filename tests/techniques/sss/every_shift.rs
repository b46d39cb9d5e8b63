//! Every shift of light that enters translucent bodies, with each kind of reuse, equals the reference: alone (ReSTIR DI), beside the indirect
//! light of ReSTIR GI, and beside the paths of ReSTIR PT, whose direct light is apart so that the shift is in use.

use super::{
    bust::{self, bust_scene},
    paths,
    small_scenes::{self, bodies, check_moving},
};
use crate::support::{
    proof::{Proof, Subject},
    reuse_settings,
};
use bevy_restir::{Direct, Paths, Restir, SubsurfaceSampling, SubsurfaceShift, Technique};

const SHIFTS: [SubsurfaceShift; 4] =
    [SubsurfaceShift::Reconnection, SubsurfaceShift::Delayed, SubsurfaceShift::Hybrid, SubsurfaceShift::Sequential];

/// A kind of reuse by name, for all light of a frame.
#[derive(Clone, Copy)]
struct Kind {
    name: &'static str,
    direct: fn() -> Direct,
    subsurface: fn() -> SubsurfaceSampling,
    paths: fn() -> Paths,
}

/// In a still scene all shifts between frames are the identity.
const TEMPORAL: Kind = Kind {
    name: "temporal",
    direct: reuse_settings::di::temporal,
    subsurface: reuse_settings::subsurface::temporal,
    paths: reuse_settings::paths::temporal,
};
const SPATIAL: Kind = Kind {
    name: "spatial",
    direct: reuse_settings::di::spatial,
    subsurface: reuse_settings::subsurface::spatial,
    paths: reuse_settings::paths::spatial,
};
const BOTH: Kind = Kind {
    name: "both",
    direct: reuse_settings::di::all_reuse,
    subsurface: reuse_settings::subsurface::all_reuse,
    paths: reuse_settings::paths::all_reuse,
};

/// A technique with a shift and a kind of reuse.
#[derive(Clone, Copy)]
struct Row {
    technique: Technique,
    shift: SubsurfaceShift,
    kind: Kind,
}

impl Row {
    fn name(&self) -> String {
        format!("{:?}, {:?}, {}", self.technique, self.shift, self.kind.name)
    }
}

impl Subject for Row {
    fn apply_to(&self, settings: &mut Restir) {
        settings.technique = self.technique;
        // Pixels of a tile share a subset of the lights, so that small pictures with subsets are noisy as a whole.
        settings.direct = Direct { subset_count: 0, ..(self.kind.direct)() };
        settings.subsurface = SubsurfaceSampling { shift: self.shift, ..(self.kind.subsurface)() };
        settings.paths = Paths { separate_direct_light: true, ..(self.kind.paths)() };
    }
}

/// Proves the rows of a technique: all shifts with each kind of reuse.
fn with_rows(technique: Technique, prove: impl FnOnce(&[(&str, Row)])) {
    let kinds = |shift| [TEMPORAL, SPATIAL, BOTH].map(|kind| Row { technique, shift, kind });
    let rows: Vec<(String, Row)> = SHIFTS.into_iter().flat_map(kinds).map(|row| (row.name(), row)).collect();
    let rows: Vec<(&str, Row)> = rows.iter().map(|(name, row)| (name.as_str(), *row)).collect();
    prove(&rows);
}

fn check_bodies(technique: Technique, proof: Proof) {
    let Some(mut rig) = bodies() else { return };
    with_rows(technique, |rows| proof.check("bodies", &mut rig, rows));
}

fn check_bodies_in_motion(technique: Technique, proof: Proof) {
    with_rows(technique, |rows| check_moving(proof, rows));
}

fn check_bust(technique: Technique, proof: Proof) {
    let Some(mut rig) = bust_scene() else { return };
    with_rows(technique, |rows| proof.check("bust", &mut rig, rows));
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_in_bodies_equals_the_reference() {
    check_bodies(Technique::Di, small_scenes::PROOF);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_in_moving_bodies_equals_the_reference() {
    check_bodies_in_motion(Technique::Di, small_scenes::MOVING);
}

/// Mesa 22.3 needed more than 20 GB of memory for this test when it compiled direct light again in every frame (`view/camera.wgsl`).
#[test]
#[ignore = "minutes, and more than 20 GB of memory: ./run test --full"]
fn full_length_every_shift_in_a_head_equals_the_reference() {
    check_bust(Technique::Di, bust::PROOF);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_beside_indirect_light_in_bodies_equals_the_reference() {
    check_bodies(Technique::Gi, paths::PROOF);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_beside_indirect_light_in_moving_bodies_equals_the_reference() {
    check_bodies_in_motion(Technique::Gi, paths::MOVING);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_beside_indirect_light_in_a_head_equals_the_reference() {
    check_bust(Technique::Gi, bust::PATHS);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_beside_paths_in_bodies_equals_the_reference() {
    check_bodies(Technique::Pt, paths::PROOF);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_beside_paths_in_moving_bodies_equals_the_reference() {
    check_bodies_in_motion(Technique::Pt, paths::MOVING);
}

#[test]
#[ignore = "minutes: ./run test --full"]
fn full_length_every_shift_beside_paths_in_a_head_equals_the_reference() {
    check_bust(Technique::Pt, bust::PATHS);
}

/// A row for the second tier.
fn check_briefly(row: Row) {
    let Some(mut rig) = bodies() else { return };
    let proof = Proof { bounces: paths::BOUNCES, margin: 0.03, ..Proof::of((36, 12), (16, 32)) };
    proof.check("bodies", &mut rig, &[(row.name().as_str(), row)]);
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn indirect_light_in_translucent_bodies_equals_the_reference() {
    check_briefly(Row { technique: Technique::Gi, shift: SubsurfaceShift::Hybrid, kind: BOTH });
}

#[test]
#[ignore = "second tier: ./run test --more"]
fn paths_beside_direct_light_in_translucent_bodies_equal_the_reference() {
    check_briefly(Row { technique: Technique::Pt, shift: SubsurfaceShift::Sequential, kind: BOTH });
}
