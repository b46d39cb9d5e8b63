//! The long form of `small_scenes`: ReSTIR BDPT equals the reference with every use of light paths and every kind of reuse, in the scenes of
//! `assets/scenes`.  The rows are a pairwise covering set of these, MIS kinds, numbers of light paths, reuse gains, and ways to find neighbors.
//! The results are a table of `docs/proof-matrix.md`.

use crate::support::{
    app::*,
    matrix::{self, Choices, Row},
    proof::{Bidirectional, Proof, Subject},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy::prelude::*;
use bevy_restir::{Jitter, LightTechniques, Mis, Paths, Restir, Reuse};
use std::collections::BTreeSet;

const BLINDS_UNDER_A_SKY: &str = "blinds under a sky";
const SCENES: [&str; 13] = [
    "cornell",
    "glossy",
    "ajar",
    "blinds",
    BLINDS_UNDER_A_SKY,
    "mirror_room",
    "punctual",
    "many_lights",
    "furnace",
    "glass_lamp",
    "caustic_egg",
    "bodies",
    "moving",
];
const LIGHT_TECHNIQUES: [LightTechniques; 3] =
    [LightTechniques::Full, LightTechniques::Lightweight, LightTechniques::NoLightTracing];
const REUSE: [&str; 4] = ["none", "temporal", "spatial", "both"];
const MIS: [Mis; 2] = [Mis::DefensivePairwise, Mis::Balance];
const LIGHT_PATHS: [f32; 2] = [1.0, 0.1];
const REUSE_GAINS: [f32; 2] = [16.0, 1.0];

/// The room of `blinds`, with a sky outside in place of the lamp.
fn blinds_under_a_sky(size: u32) -> Option<Rig> {
    let mut rig = Rig::load("blinds", size)?;
    let lamp = rig.named("sky");
    assert!(rig.app.world_mut().despawn(lamp), "the file has a lamp outside of the window");
    environment_of(&mut rig, true);
    // The references of the file have the lamp.
    rig.shared = None;
    Some(rig)
}

/// [`moving`] with a spot that moves, too.  No mirror and no glass is in its light: the reference has no caustics of lights without a size.
fn moving_with_spot(rig: &mut Rig) {
    moving(rig);
    let spot = SpotLight { intensity: 30.0, outer_angle: 0.5, inner_angle: 0.2, ..default() };
    rig.spawn_bundle((Name::new("spot"), spot, Transform::default()));
}

fn pose_moving_with_spot(rig: &mut Rig, step: u32) {
    pose_moving(rig, step);
    let step = step as f32;
    let place = Transform::from_xyz(-0.4 + 0.3 * step, 1.6, 1.2);
    let spot = rig.named("spot");
    *rig.get_mut::<Transform>(spot) = place.looking_at(Vec3::new(0.6 - 0.4 * step, -1.0, 0.0), Vec3::Y);
}

#[derive(Clone, Copy)]
struct LightRow(Choices);

/// [`Bidirectional`] with a number of light paths and a reuse gain.
struct Sampling {
    techniques: LightTechniques,
    paths: Paths,
    light_paths: f32,
    reuse_gain: f32,
}

impl Subject for Sampling {
    fn apply_to(&self, settings: &mut Restir) {
        Bidirectional(self.techniques, self.paths.clone()).apply_to(settings);
        (settings.bdpt.light_paths, settings.bdpt.reuse_gain) = (self.light_paths, self.reuse_gain);
    }
}

impl LightRow {
    fn techniques(self) -> LightTechniques {
        LIGHT_TECHNIQUES[self.0[1] / REUSE.len()]
    }

    fn reuse(self) -> &'static str {
        REUSE[self.0[1] % REUSE.len()]
    }
}

impl Row for LightRow {
    const NAME: &'static str = "light matrix";
    const SIZE: u32 = 32;
    const SCENES: &'static [&'static str] = &SCENES;
    const CHOICES: [(&'static str, usize); 7] = [
        ("scene", SCENES.len()),
        // One choice, so that every scene has all combinations of the two.
        ("light techniques, reuse", LIGHT_TECHNIQUES.len() * REUSE.len()),
        ("MIS", MIS.len()),
        ("light paths", LIGHT_PATHS.len()),
        ("reuse gain", REUSE_GAINS.len()),
        ("found by", 2),
        ("neighbors", 2),
    ];
    const PLANTED: (&'static str, &'static str) = ("PLANT_SCALED_UCW", "planted error of 3 % in every step");

    fn new(choices: Choices) -> Self {
        Self(choices)
    }

    fn choices(&self) -> Choices {
        self.0
    }

    fn rig(name: &str) -> Option<Rig> {
        match name {
            "moving" => scene(Self::SIZE, moving_with_spot),
            BLINDS_UNDER_A_SKY => blinds_under_a_sky(Self::SIZE),
            file => Rig::load(file, Self::SIZE),
        }
    }

    /// Each scene with all techniques, both kinds of reuse, and the first value of all other choices: that of the default settings.
    fn first_rows() -> Vec<Self> {
        let both = REUSE.len() - 1;
        (0..SCENES.len()).map(|scene| Self([scene, both, 0, 0, 0, 0, 0])).collect()
    }

    /// The MIS kind and the heuristics need spatial reuse, the gain needs reuse, and pairs need a pairwise kind.
    fn is_relevant(&self, choice: usize) -> bool {
        let is_spatial = matches!(self.reuse(), "spatial" | "both");
        match choice {
            2 | 6 => is_spatial,
            4 => self.reuse() != "none",
            5 => is_spatial && MIS[self.0[2]] == Mis::DefensivePairwise,
            _ => true,
        }
    }

    fn is_testable(&self) -> bool {
        true
    }

    fn names(&self) -> Vec<String> {
        vec![
            self.scene().into(),
            format!("{:?}, {}", self.techniques(), self.reuse()),
            format!("{:?}", MIS[self.0[2]]),
            LIGHT_PATHS[self.0[3]].to_string(),
            REUSE_GAINS[self.0[4]].to_string(),
            ["pairs", "search"][self.0[5]].into(),
            ["alike", "any"][self.0[6]].into(),
        ]
    }

    /// Light paths end anywhere in a pixel.
    fn prepare(rig: &mut Rig) {
        rig.set(|r| r.jitter = Jitter::Always);
    }

    /// The frames are jittered, so that each restart has its own emission.
    fn proof(&self) -> Proof<'static> {
        let of = |margin, ours, truth| Proof {
            margin,
            bounces: 4,
            blended: true,
            warm_up: 6,
            ..Proof::of((24, ours), (24, truth))
        };
        match self.scene() {
            "cornell" | "furnace" | "bodies" => of(0.015, 16, 80),
            "punctual" | "many_lights" => of(0.02, 16, 160),
            // A reflection of a lamp in a pixel, or a lamp that only a sequence of mirrors shows, makes rare bright frames.
            "glass_lamp" | "caustic_egg" | "mirror_room" => of(0.05, 24, 300),
            // Few light paths of a sky pass between the slats.
            BLINDS_UNDER_A_SKY => of(0.05, 24, 300),
            "ajar" | "blinds" | "glossy" => of(0.03, 24, 300),
            "moving" => Proof {
                bounces: 3,
                warm_up: 0,
                pose: Some(&pose_moving_with_spot),
                ..Proof { ours: Proof::of((160, 1), (1, 1)).ours, ..of(0.02, 1, 80) }
            },
            scene => unreachable!("{scene} is not a scene of this matrix"),
        }
    }

    fn subject(&self) -> impl Subject {
        let all = paths::all_reuse();
        let paths = match self.reuse() {
            "none" => paths::candidates_only(),
            "temporal" => paths::temporal(),
            "spatial" => paths::spatial(),
            _ => all,
        };
        let reuse = Reuse { mis: MIS[self.0[2]], paired: self.0[5] == 0, ..paths.reuse.clone() };
        Sampling {
            techniques: self.techniques(),
            paths: Paths { reuse, heuristics: self.0[6] == 0, ..paths },
            light_paths: LIGHT_PATHS[self.0[3]],
            reuse_gain: REUSE_GAINS[self.0[4]],
        }
    }
}

#[test]
fn every_scene_has_rows_of_every_use_of_light_paths_with_every_reuse() {
    let rows = matrix::covering_set::<LightRow>();
    let covered: BTreeSet<_> =
        rows.iter().map(|row| (row.scene(), format!("{:?}", row.techniques()), row.reuse())).collect();
    assert_eq!(covered.len(), SCENES.len() * LIGHT_TECHNIQUES.len() * REUSE.len());
    for (row, name) in rows.iter().zip(SCENES) {
        assert_eq!(row.scene(), name);
        let (mut settings, default) = (Restir::default(), Restir::default());
        row.subject().apply_to(&mut settings);
        assert_eq!(settings.bdpt, default.bdpt, "{name}");
        let chosen = |r: &Restir| (r.paths.reuse.mis, r.paths.reuse.paired, r.paths.heuristics);
        assert_eq!(chosen(&settings), chosen(&default), "{name}");
    }
}

#[test]
#[ignore = "hours: ./run test --full"]
fn full_length_every_pair_of_settings_of_light_paths_is_equal_to_the_reference() {
    matrix::run::<LightRow>();
}
