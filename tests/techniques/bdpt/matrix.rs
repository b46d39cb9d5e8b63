//! The long form of `small_scenes`: ReSTIR BDPT equals the reference in every row of a pairwise covering set of the scenes of
//! `assets/scenes`, light techniques, reuse, MIS kinds, numbers of light paths, reuse gains and neighbor heuristics.  The results are a
//! table of `docs/proof-matrix.md`.

use crate::support::{
    app::*,
    matrix::{self, Choices, Row},
    proof::{Bidirectional, Proof, Subject},
    reuse_settings::paths,
    small_scenes::*,
};
use bevy_restir::{Jitter, LightTechniques, Mis, Paths, Restir, Reuse};

const SCENES: [&str; 12] = [
    "cornell",
    "glossy",
    "ajar",
    "blinds",
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
        LIGHT_TECHNIQUES[self.0[1]]
    }

    fn reuse(self) -> &'static str {
        REUSE[self.0[2]]
    }
}

impl Row for LightRow {
    const NAME: &'static str = "light matrix";
    const SIZE: u32 = 32;
    const SCENES: &'static [&'static str] = &SCENES;
    const CHOICES: [(&'static str, usize); 7] = [
        ("scene", SCENES.len()),
        ("light techniques", LIGHT_TECHNIQUES.len()),
        ("reuse", REUSE.len()),
        ("MIS", MIS.len()),
        ("light paths", LIGHT_PATHS.len()),
        ("reuse gain", REUSE_GAINS.len()),
        ("neighbors", 2),
    ];
    const PLANTED: (&'static str, &'static str) = ("PLANT_SCALED_UCW", "planted error of 3 % in every step");

    fn new(choices: Choices) -> Self {
        Self(choices)
    }

    fn choices(&self) -> Choices {
        self.0
    }

    /// The MIS kind and the heuristics need spatial reuse, and the gain needs reuse.
    fn is_relevant(&self, choice: usize) -> bool {
        match choice {
            3 | 6 => matches!(self.reuse(), "spatial" | "both"),
            5 => self.reuse() != "none",
            _ => true,
        }
    }

    fn is_testable(&self) -> bool {
        true
    }

    fn names(&self) -> Vec<String> {
        vec![
            self.scene().into(),
            format!("{:?}", self.techniques()),
            self.reuse().into(),
            format!("{:?}", MIS[self.0[3]]),
            LIGHT_PATHS[self.0[4]].to_string(),
            REUSE_GAINS[self.0[5]].to_string(),
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
            "ajar" | "blinds" | "glossy" => of(0.03, 24, 300),
            "moving" => Proof {
                bounces: 3,
                warm_up: 0,
                pose: Some(&pose_moving),
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
        let reuse = Reuse { mis: MIS[self.0[3]], ..paths.reuse.clone() };
        Sampling {
            techniques: self.techniques(),
            paths: Paths { reuse, heuristics: self.0[6] == 0, ..paths },
            light_paths: LIGHT_PATHS[self.0[4]],
            reuse_gain: REUSE_GAINS[self.0[5]],
        }
    }
}

#[test]
#[ignore = "half an hour: ./run test --full"]
fn full_length_every_pair_of_settings_of_light_paths_is_equal_to_the_reference() {
    matrix::run::<LightRow>();
}
