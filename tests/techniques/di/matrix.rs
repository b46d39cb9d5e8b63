//! The long form of `asset_scenes`: ReSTIR DI equals the reference in every row of a pairwise covering set of scenes, reuse, MIS kinds,
//! bias corrections, shading, light choice and visibility.  The results are a table of `docs/proof-matrix.md`.

use crate::support::{
    matrix::{self, Choices, Row},
    proof::{Proof, Subject},
    reuse_settings::pixels,
    small_scenes::*,
};
use bevy_restir::{BiasCorrection, Direct, Mis, Reuse, ReuseOrder, VisibilityReuse};

const SCENES: [&str; 6] = ["cornell", "glossy", "many_lights", "punctual", "furnace", "moving"];
const REUSE: [&str; 6] = ["none", "temporal", "spatial", "both", "classic", "two rounds"];
const MIS: [Mis; 5] = [Mis::DefensivePairwise, Mis::Pairwise, Mis::Balance, Mis::OneOverZ, Mis::DefensivePairwiseGris];
const CORRECTIONS: [BiasCorrection; 2] = [BiasCorrection::HeuristicsAndUnbiasedMis, BiasCorrection::UnbiasedMis];
const VISIBILITY: [VisibilityReuse; 2] = [VisibilityReuse::Resampled, VisibilityReuse::Shading];

#[derive(Clone, Copy)]
struct DirectRow(Choices);

impl DirectRow {
    fn reuse(self) -> &'static str {
        REUSE[self.0[1]]
    }

    /// Neighbors across edges, MIS weights without target functions, and targets without visibility all produce rare bright pixels; the
    /// mean of a few restarts is then skewed.
    fn is_noisy(self) -> bool {
        MIS[self.0[2]] == Mis::OneOverZ || self.0[3] != 0 || self.0[6] != 0
    }
}

impl Row for DirectRow {
    const NAME: &'static str = "direct matrix";
    const SIZE: u32 = 64;
    const SCENES: &'static [&'static str] = &SCENES;
    const CHOICES: [(&'static str, usize); 7] = [
        ("scene", SCENES.len()),
        ("reuse", REUSE.len()),
        ("MIS", MIS.len()),
        ("correction", CORRECTIONS.len()),
        ("shaded", 2),
        ("lights", 2),
        ("visibility", VISIBILITY.len()),
    ];
    const PLANTED: (&'static str, &'static str) = ("PLANT_SLIGHTLY_SCALED_UCW", "planted error of 0.3 %");

    fn new(choices: Choices) -> Self {
        Self(choices)
    }

    fn choices(&self) -> Choices {
        self.0
    }

    /// Without reuse there are no MIS weights, and only one sample to shade.
    fn is_relevant(&self, choice: usize) -> bool {
        self.reuse() != "none" || !(2..=4).contains(&choice)
    }

    /// Only the BSDF finds lights in the mirrors of the furnace, so that scene needs BSDF candidates to be unbiased.  1/|Z| weights ignore
    /// target functions: where targets differ by a factor of a thousand (across edges, between narrow lobes, near moving lights) they
    /// produce rare pixels that are a thousand times too bright, and no run of affordable length can show that the mean is right.  For
    /// those scenes `mis_enumeration` shows it exactly.
    fn is_testable(&self) -> bool {
        let is_unbiased = self.scene() != "furnace" || self.0[6] == 0;
        let is_rough = !matches!(self.scene(), "furnace" | "glossy" | "moving");
        let is_calm = MIS[self.0[2]] != Mis::OneOverZ || (self.0[3] == 0 && self.0[6] == 0 && is_rough);
        is_unbiased && is_calm
    }

    fn names(&self) -> Vec<String> {
        vec![
            self.scene().into(),
            self.reuse().into(),
            format!("{:?}", MIS[self.0[2]]),
            format!("{:?}", CORRECTIONS[self.0[3]]),
            ["decoupled", "kept"][self.0[4]].into(),
            ["presampled", "all"][self.0[5]].into(),
            format!("{:?}", VISIBILITY[self.0[6]]),
        ]
    }

    /// Lengths that give most rows a power of at least 0.95 at their margin (the table of `docs/proof-matrix.md` lists each).  The margin is
    /// 0.2 % where that is affordable.
    fn proof(&self) -> Proof<'static> {
        let quiet = |margin| if self.is_noisy() { 0.01 } else { margin };
        match self.scene() {
            "cornell" => Proof { margin: quiet(0.002), ..Proof::of((24, 24), (40, 40)) },
            "furnace" => Proof { margin: quiet(0.002), ..Proof::of((40, 40), (40, 40)) },
            "glossy" => Proof::of((24, 24), (40, 80)),
            "many_lights" => Proof::of((40, 24), (40, 200)),
            "punctual" => Proof::of((24, 24), (40, 60)),
            _ => Proof { pose: Some(&pose_moving), ..Proof::of((200, 1), (40, 40)) },
        }
    }

    fn subject(&self) -> impl Subject {
        let [_, _, mis, correction, shading, lights, visibility] = self.0;
        // Near neighbors and a short history reduce the number of bright pixels.
        let (radius, confidence_cap) = if self.is_noisy() { (10.0, 4.0) } else { (30.0, 20.0) };
        let radius = pixels(radius, Self::SIZE);
        let direct = Direct {
            reuse: Reuse { mis: MIS[mis], shade_all: shading == 0, radius, confidence_cap, ..Reuse::SPATIOTEMPORAL },
            bias_correction: CORRECTIONS[correction],
            subset_count: if lights == 0 { 128 } else { 0 },
            visibility: VISIBILITY[visibility],
            // A BSDF candidate is visible by construction: beside it, targets that ignore visibility are biased.
            bsdf_candidate: visibility == 0,
            ..Default::default()
        };
        match self.reuse() {
            "none" => Direct {
                reuse: Reuse { temporal: false, spatial_samples: 0, disocclusion_samples: 0, ..direct.reuse.clone() },
                ..direct
            },
            "temporal" => Direct {
                reuse: Reuse { spatial_samples: 0, disocclusion_samples: 0, ..direct.reuse.clone() },
                ..direct
            },
            "spatial" => {
                Direct { reuse: Reuse { temporal: false, spatial_samples: 3, ..direct.reuse.clone() }, ..direct }
            }
            "classic" => Direct {
                reuse: Reuse {
                    order: ReuseOrder::TemporalThenSpatial,
                    spatial_samples: 2,
                    spatial_iterations: 2,
                    ..direct.reuse.clone()
                },
                ..direct
            },
            "two rounds" => Direct { reuse: Reuse { spatial_iterations: 2, ..direct.reuse.clone() }, ..direct },
            _ => direct,
        }
    }
}

#[test]
#[ignore = "half an hour: ./run test --full"]
fn full_length_every_pair_of_settings_of_direct_light_is_equal_to_the_reference() {
    matrix::run::<DirectRow>();
}
