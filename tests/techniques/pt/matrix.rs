//! The long form of `asset_scenes`: ReSTIR PT and GI equal the reference in every row of a pairwise covering set of scenes, techniques,
//! reuse, MIS kinds, reconnection criteria, shading weights and neighbor heuristics.  The results are a table of `docs/proof-matrix.md`.

use crate::support::{
    matrix::{self, Choices, Row},
    proof::{AllLight, Proof, Subject},
    reuse_settings::{di, paths, pixels},
    small_scenes::*,
};
use bevy_restir::{Mis, Paths, Reconnection, Reuse, ReuseOrder};

const SCENES: [&str; 8] = ["cornell", "glossy", "ajar", "blinds", "mirror_room", "punctual", "furnace", "moving"];
const TECHNIQUES: [&str; 2] = ["PT", "DI + GI"];
const REUSE: [&str; 5] = ["none", "temporal", "spatial", "both", "two joint rounds"];
const MIS: [Mis; 4] = [Mis::DefensivePairwise, Mis::Pairwise, Mis::Balance, Mis::DefensivePairwiseGris];
const RECONNECTIONS: [Reconnection; 3] = [Reconnection::Footprints, Reconnection::BlackBox, Reconnection::Distance];

#[derive(Clone, Copy)]
struct PathRow(Choices);

impl PathRow {
    fn is_of_whole_paths(self) -> bool {
        self.0[1] == 0
    }

    fn reuse(self) -> &'static str {
        REUSE[self.0[2]]
    }
}

impl Row for PathRow {
    const NAME: &'static str = "path matrix";
    const SIZE: u32 = 32;
    const SCENES: &'static [&'static str] = &SCENES;
    const CHOICES: [(&'static str, usize); 7] = [
        ("scene", SCENES.len()),
        ("technique", TECHNIQUES.len()),
        ("reuse", REUSE.len()),
        ("MIS", MIS.len()),
        ("reconnected", RECONNECTIONS.len()),
        ("shaded", 2),
        ("neighbors", 2),
    ];
    const PLANTED: (&'static str, &'static str) = ("PLANT_SCALED_UCW", "planted error of 3 % in every step");

    fn new(choices: Choices) -> Self {
        Self(choices)
    }

    fn choices(&self) -> Choices {
        self.0
    }

    /// Temporal reuse alone always uses the balance heuristic and finds its own surface, so MIS kind and neighbor heuristics need spatial
    /// reuse.  GI always reconnects at the first bounce.
    fn is_relevant(&self, choice: usize) -> bool {
        match choice {
            3 | 6 => !matches!(self.reuse(), "none" | "temporal"),
            4 => self.is_of_whole_paths() && self.reuse() != "none",
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
            TECHNIQUES[self.0[1]].into(),
            self.reuse().into(),
            format!("{:?}", MIS[self.0[3]]),
            format!("{:?}", RECONNECTIONS[self.0[4]]),
            ["vectors", "kept"][self.0[5]].into(),
            ["alike", "any"][self.0[6]].into(),
        ]
    }

    /// Lengths that give most rows enough power at their margin.
    fn proof(&self) -> Proof<'static> {
        let of = |margin, ours, truth| Proof { margin, bounces: 4, ..Proof::of((40, ours), (40, truth)) };
        // Rare samples are reused often, which correlates pixels.
        let often = if self.reuse() == "two joint rounds" { 3 } else { 1 };
        match self.scene() {
            "cornell" | "furnace" => of(0.01, 20, 60),
            "punctual" => of(0.015, 20 * often, 120),
            // These are noisy: little light enters, through few openings, or only glossy surfaces show it.
            "ajar" => of(0.02, 50 * often, 300),
            "blinds" | "glossy" | "mirror_room" => of(0.02, 50, 300),
            "moving" => Proof { margin: 0.02, bounces: 3, pose: Some(&pose_moving), ..Proof::of((240, 1), (40, 60)) },
            scene => unreachable!("{scene} is not a scene of this matrix"),
        }
    }

    fn subject(&self) -> impl Subject {
        let [_, _, _, mis, reconnection, shading, neighbors] = self.0;
        let paths = Paths {
            reuse: Reuse {
                mis: MIS[mis],
                shade_all: shading == 0,
                spatial_samples: 2,
                radius: pixels(5.0, Self::SIZE),
                confidence_cap: 8.0,
                ..Reuse::PATHS
            },
            reconnection: RECONNECTIONS[reconnection],
            distance: 0.1,
            heuristics: neighbors == 0,
            ..paths::unified()
        };
        let paths = match self.reuse() {
            "none" => Paths { reuse: Reuse { temporal: false, spatial_samples: 0, ..paths.reuse.clone() }, ..paths },
            "temporal" => Paths { reuse: Reuse { spatial_samples: 0, ..paths.reuse.clone() }, ..paths },
            "spatial" => Paths { reuse: Reuse { temporal: false, ..paths.reuse.clone() }, ..paths },
            "two joint rounds" => Paths {
                reuse: Reuse { order: ReuseOrder::Spatiotemporal, spatial_iterations: 2, ..paths.reuse.clone() },
                ..paths
            },
            _ => paths,
        };
        if self.is_of_whole_paths() { AllLight::Pt(paths) } else { AllLight::Gi(di::all_reuse(), paths) }
    }
}

#[test]
#[ignore = "half an hour: ./run test --full"]
fn full_length_every_pair_of_settings_of_paths_is_equal_to_the_reference() {
    matrix::run::<PathRow>();
}
