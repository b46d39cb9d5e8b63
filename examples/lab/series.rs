//! The compared settings, as data.

use bevy_restir::{
    BiasCorrection, Denoiser, Direct, Jitter, Mis, Paths, Preset, Reconnection, Research, ReservoirLayout, Restir,
    Reuse, ReuseOrder, Technique, VisibilityReuse,
};

/// Figures of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    Presample,
    Candidates,
    Reuse,
    Lighting,
    Rays,
    Error,
}

/// A row: settings and the figures to show.
pub struct Entry {
    pub section: &'static str,
    pub label: String,
    pub settings: Restir,
    pub shown: &'static [Shown],
}

/// Without jitter and energy compensation, so that all techniques converge to one picture.  Direct light is a part of the paths of PT, as in
/// Lin et al. 2026.
pub fn plain(technique: Technique, bounces: u32) -> Restir {
    Restir {
        technique,
        bounces,
        jitter: Jitter::Never,
        energy_compensation: false,
        firefly_limit: 0.0,
        denoiser: Denoiser::OFF,
        paths: Paths { separate_direct_light: false, ..Paths::default() },
        ..Restir::default()
    }
}

/// The default settings.
pub fn default() -> Restir {
    with(|_| ())
}

/// The default settings with a change.
pub fn with(change: impl FnOnce(&mut Direct)) -> Restir {
    let mut direct = Direct::default();
    change(&mut direct);
    Restir { direct, ..plain(Technique::Di, 1) }
}

/// The reference tracer.
pub fn reference() -> Restir {
    plain(Technique::Reference, 1)
}

/// The final pipeline of Wyman and Panteleev 2021.
pub fn paper() -> Restir {
    paper_within(0.0)
}

/// Direct light from neighbors of the last frame.  (`Shown` has a variant `Reuse`, too.)
const SPATIOTEMPORAL: Reuse = Reuse::SPATIOTEMPORAL;

/// Reuse with a history of 20 frames, and neighbors that are tried once and face the same direction within 25 degrees.
fn published(reuse: Reuse, spatial_samples: u32, radius: f32) -> Reuse {
    Reuse { spatial_samples, radius, confidence_cap: 20.0, neighbor_attempts: 1, normal_threshold: 0.9, ..reuse }
}

/// The pipeline of the paper with visibility reuse within a radius in pixels (7.3).
fn paper_within(radius: f32) -> Restir {
    with(|d| {
        d.reuse = published(SPATIOTEMPORAL, 1, 30.0);
        d.bias_correction = BiasCorrection::HeuristicsAndMis;
        d.visibility = VisibilityReuse::Decoupled;
        d.visibility_radius = radius;
        d.bsdf_candidate = false;
    })
}

/// The two pipelines of Bitterli et al. 2020: "biased" combines samples by their confidence alone and tests the visibility of the one
/// that it shades; "unbiased" tests which neighbors could have found a sample.
pub fn bitterli() -> [(&'static str, Restir); 2] {
    let pipeline = |neighbors, iterations, visibility, correction| {
        with(|d| {
            d.subset_count = 0;
            d.bsdf_candidate = false;
            d.visibility = visibility;
            d.bias_correction = correction;
            d.reuse = Reuse {
                disocclusion_samples: 0,
                paired: false,
                spatial_iterations: iterations,
                temporal_attempts: 1,
                dual_motion: false,
                mis: Mis::OneOverZ,
                shade_all: false,
                depth_threshold: 0.1,
                ..published(Reuse::DIRECT, neighbors, 30.0)
            };
        })
    };
    [
        ("biased", pipeline(5, 2, VisibilityReuse::Decoupled, BiasCorrection::Heuristics)),
        ("unbiased", pipeline(3, 1, VisibilityReuse::Resampled, BiasCorrection::HeuristicsAndUnbiasedMis)),
    ]
}

/// How the rows of [`bitterli`] differ from the paper.
pub const BITTERLI_NOTE: &str = "Bitterli et al. 2020: 32 light candidates from all lights, a temporal neighbor, two rounds of five (biased) or \
    one of three spatial neighbors (unbiased) within 30 pixels, confidence up to 20 frames, visibility in the target only for the selected \
    candidate (biased). Differences: a reservoir holds one sample, not four, so that a frame shades one and traces fewer rays; neighbors lie \
    anywhere in the circle, not on a sequence of low discrepancy; the depth test of 10 % is of the distance from the tangent plane; the \
    unbiased form weights each sample before it selects one, and so traces a ray for each pair of a sample and a neighbor.";

/// Direct light of the cheapest preset.
pub fn performance() -> Restir {
    Restir { direct: Restir::preset(Preset::Performance).direct, ..plain(Technique::Di, 1) }
}

/// Candidates without any reuse.
pub fn candidates_only() -> Restir {
    reusing(default(), false, false)
}

/// The settings with these kinds of reuse of direct light only.
fn reusing(mut settings: Restir, temporal: bool, spatial: bool) -> Restir {
    let reuse = &mut settings.direct.reuse;
    reuse.temporal &= temporal;
    if !spatial {
        (reuse.spatial_samples, reuse.disocclusion_samples) = (0, 0);
    }
    settings
}

/// The settings without any ray, to measure the remaining cost.
pub fn without_rays(mut settings: Restir) -> Restir {
    settings.direct.visibility = VisibilityReuse::Ignored;
    settings.direct.bsdf_candidate = false;
    settings
}

/// The rows that compare settings.
pub fn entries() -> Vec<Entry> {
    use Shown::*;
    let mut all = Vec::new();
    let mut add = |section, shown, rows: Vec<(String, Restir)>| {
        all.extend(rows.into_iter().map(|(label, settings)| Entry { section, label, settings, shown }));
    };
    let radii = [
        (0.0, "0 pixels (as the paper measures)"),
        (15.0, "15 pixels"),
        (20.0, "20 pixels"),
        (25.0, "25 pixels"),
        (1e6, "always"),
    ];
    add(
        "The paper's pipeline: visibility reused within a radius (7.3)",
        &[Rays, Lighting, Error],
        radii.map(|(radius, label)| (label.into(), paper_within(radius))).into(),
    );
    add("Bitterli et al. 2020", &[Rays, Lighting, Error], named(bitterli().into()));
    add("Decoupled shading (7.1)", &[Rays, Lighting, Error], decoupled_shading());
    add("Kinds of reuse (6.3)", &[Rays, Lighting, Error], kinds_of_reuse());
    add("Rays by purpose", &[Rays, Lighting, Error], rays_by_purpose());

    let counts = |label: &str, values: &[u32], set: fn(&mut Direct, u32)| -> Vec<(String, Restir)> {
        values.iter().map(|&n| (format!("{label}{n}"), with(|d| set(d, n)))).collect()
    };
    let bare = |rows: Vec<(String, Restir)>| rows.into_iter().map(|(l, s)| (l, without_rays(s))).collect();
    let tiles = [1, 2, 4, 8, 16].map(|n| {
        let light_tile_size = Research { light_tile_size: n, ..Research::default() };
        (format!("pixels a side: {n}"), Restir { research: light_tile_size, ..default() })
    });
    let tiles = tiles.into();
    add("Pixel tiles that share a subset, without rays (5.2)", &[Candidates], bare(tiles));
    let sizes = counts("size ", &[1024, 4096, 16384], |d, n| d.subset_size = n);
    add("Light subsets, without rays (5.2)", &[Presample, Candidates], bare(sizes));
    let subsets = counts("number ", &[128, 512, 2048], |d, n| d.subset_count = n);
    add("Light subsets, without rays (5.2)", &[Presample, Candidates], bare(subsets));
    let none = vec![("not presampled".into(), without_rays(with(|d| d.subset_count = 0)))];
    add("Light subsets, without rays (5.2)", &[Presample, Candidates], none);
    add("Correlation by presampled lights (5.2)", &[Presample, Candidates, Lighting, Error], shared_subsets());
    let candidates = counts("", &[1, 8, 32], |d, n| d.candidates = n);
    add("Candidates", &[Candidates, Lighting, Error], candidates);

    let targets = [("reflected light", false), ("arriving light (9)", true)].map(|(label, target_without_bsdf)| {
        let research = Research { target_without_bsdf, ..Research::default() };
        (label.into(), Restir { research, ..default() })
    });
    add("Candidates are chosen by", &[Candidates, Lighting, Error], targets.into());

    let classic = with(|d| {
        d.reuse = published(SPATIOTEMPORAL, 5, 30.0);
        d.reuse.order = ReuseOrder::TemporalThenSpatial;
        d.reuse.spatial_iterations = 2;
    });
    add(
        "Order of reuse (6.2)",
        &[Rays, Lighting, Error],
        vec![
            ("temporal, then 3 spatial neighbors in pairs (the default)".into(), default()),
            ("spatiotemporal, 2 neighbors".into(), with(|d| d.reuse = SPATIOTEMPORAL)),
            ("temporal, then 2 iterations of 5 neighbors (as Bitterli et al. 2020)".into(), classic),
        ],
    );
    // Partners are not searched for.
    let attempts = counts("", &[1, 3], |d, n| {
        d.reuse = SPATIOTEMPORAL;
        d.reuse.neighbor_attempts = n;
    });
    add("Spatial samples (6.3)", &[Lighting, Error], counts("", &[1, 2, 3, 5], |d, n| d.reuse.spatial_samples = n));
    add("Neighbor attempts", &[Lighting, Error], attempts);
    let caps = [1.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 250.0];
    let caps = caps.map(|cap| (cap.to_string(), with(|d| d.reuse.confidence_cap = cap)));
    add("Confidence cap", &[Lighting, Error], caps.into());
    add(
        "Bias correction (4.6)",
        &[Rays, Lighting, Error],
        kinds(
            [
                BiasCorrection::Off,
                BiasCorrection::Heuristics,
                BiasCorrection::HeuristicsAndMis,
                BiasCorrection::UnbiasedMis,
                BiasCorrection::HeuristicsAndUnbiasedMis,
            ],
            |d, kind| d.bias_correction = kind,
        ),
    );
    add(
        "MIS weights",
        &[Lighting, Error],
        kinds(
            [Mis::OneOverZ, Mis::Balance, Mis::Pairwise, Mis::DefensivePairwise, Mis::DefensivePairwiseGris],
            |d, kind| d.reuse.mis = kind,
        ),
    );
    add(
        "Visibility reuse (7.2)",
        &[Rays, Lighting, Error],
        kinds(
            [
                VisibilityReuse::Ignored,
                VisibilityReuse::Shading,
                VisibilityReuse::Candidates,
                VisibilityReuse::Discard,
                VisibilityReuse::Resampled,
                VisibilityReuse::Decoupled,
            ],
            |d, kind| d.visibility = kind,
        ),
    );
    add(
        "Reservoirs in memory",
        &[Reuse],
        [
            ReservoirLayout::Rows,
            ReservoirLayout::Columns,
            ReservoirLayout::Tiles2,
            ReservoirLayout::Tiles4,
            ReservoirLayout::Tiles8,
            ReservoirLayout::Tiles40,
        ]
        .map(|reservoir_layout| {
            let research = Research { reservoir_layout, ..Research::default() };
            (format!("{reservoir_layout:?}"), Restir { research, ..default() })
        })
        .into(),
    );
    all
}

fn named(rows: Vec<(&str, Restir)>) -> Vec<(String, Restir)> {
    rows.into_iter().map(|(label, settings)| (label.into(), settings)).collect()
}

/// The default, whose visibility is resampled, and the pipeline of Wyman and Panteleev 2021, which they decouple.
fn decoupled_shading() -> Vec<(String, Restir)> {
    let pipelines = [("resampled visibility", default()), ("decoupled visibility (the paper's pipeline)", paper())];
    let shading = [("all samples are shaded", true), ("only the one that is kept", false)];
    let rows = pipelines.into_iter().flat_map(|(pipeline, settings)| {
        shading.map(|(label, shade_all)| {
            let mut settings = settings.clone();
            settings.direct.reuse.shade_all = shade_all;
            (format!("{pipeline}, {label}"), settings)
        })
    });
    rows.collect()
}

/// Pixels that draw from the same subset of lights have similar errors, which reuse between them does not average.
fn shared_subsets() -> Vec<(String, Restir)> {
    let shared = |subset_count, light_tile_size| {
        let research = Research { light_tile_size, ..Research::default() };
        Restir { research, ..with(|d| d.subset_count = subset_count) }
    };
    named(vec![
        ("each pixel draws from all lights", shared(0, 8)),
        ("128 subsets, chosen for each pixel", shared(128, 1)),
        ("128 subsets, chosen for 8 x 8 pixels (the default)", shared(128, 8)),
        ("128 subsets, chosen for 16 x 16 pixels", shared(128, 16)),
        ("8 subsets, chosen for 8 x 8 pixels", shared(8, 8)),
    ])
}

fn kinds_of_reuse() -> Vec<(String, Restir)> {
    named(vec![
        ("none", candidates_only()),
        ("temporal only", reusing(default(), true, false)),
        ("spatial only", reusing(default(), false, true)),
        ("both (the default)", default()),
        ("the paper's pipeline, temporal only", reusing(paper(), true, false)),
        ("the paper's pipeline, spatial only, from the last frame", reusing(paper(), false, true)),
        ("the paper's pipeline", paper()),
    ])
}

/// Rays are traced for the BSDF candidate, the selected candidate, the samples of neighbors in the target, MIS weights, and shading.  Those
/// of the target need those of candidates, and those of MIS weights need both.
fn rays_by_purpose() -> Vec<(String, Restir)> {
    use {BiasCorrection as B, VisibilityReuse as V};
    let row = |label, bsdf_candidate, visibility, bias_correction| {
        let settings = with(|d| {
            (d.bsdf_candidate, d.visibility, d.bias_correction) = (bsdf_candidate, visibility, bias_correction);
        });
        (label, settings)
    };
    named(vec![
        row("none", false, V::Ignored, B::HeuristicsAndMis),
        row("BSDF candidates only", true, V::Ignored, B::HeuristicsAndMis),
        row("selected candidates only", false, V::Candidates, B::HeuristicsAndMis),
        row("shaded samples only", false, V::Shading, B::HeuristicsAndMis),
        row("selected candidates and targets", false, V::Resampled, B::HeuristicsAndMis),
        row("selected candidates, targets and MIS weights", false, V::Resampled, B::HeuristicsAndUnbiasedMis),
    ])
}

/// One row per variant of an enum.
fn kinds<K: Copy + core::fmt::Debug, const N: usize>(
    kinds: [K; N],
    set: impl Fn(&mut Direct, K),
) -> Vec<(String, Restir)> {
    kinds.map(|kind| (format!("{kind:?}"), with(|d| set(d, kind)))).into()
}

/// Those steps of Table 1 of Lin et al. 2026, supplement, that are settings.  Each row adds a step to the one above; the first is ReSTIR PT
/// of 2022 beside separate direct light without pairs (Wyman and Panteleev 2021, but unbiased), and the last two differ from the default.
/// Compaction needs pairs here and follows them.
pub fn steps(default: &Restir) -> Vec<(&'static str, Restir)> {
    let mut settings = default.clone();
    let paths = &mut settings.paths;
    (paths.separate_direct_light, paths.reconnection, paths.jacobian_limit) = (true, Reconnection::Distance, f32::MAX);
    paths.reuse = Reuse {
        paired: false,
        shade_all: false,
        dual_motion: false,
        disocclusion_samples: 0,
        temporal_attempts: 1,
        ..published(Reuse::PATHS, 3, 60.0)
    };
    let direct = &mut settings.direct;
    direct.reuse = Reuse { dual_motion: false, temporal_attempts: 1, ..published(SPATIOTEMPORAL, 1, 30.0) };
    (settings.research.russian_roulette, settings.research.replay_compaction) = (false, false);
    let mut rows = vec![("ReSTIR PT of 2022 and separate direct light", settings.clone())];
    let mut add = |name, change: &dyn Fn(&mut Restir)| {
        change(&mut settings);
        rows.push((name, settings.clone()));
    };
    add("+ spatial reuse in pairs", &|r| r.paths.reuse.paired = true);
    add("+ replay compaction", &|r| r.research.replay_compaction = true);
    add("+ Russian roulette", &|r| r.research.russian_roulette = true);
    add("+ direct light in the reservoirs of paths", &|r| r.paths.separate_direct_light = false);
    add("+ thresholds by footprints, and a limit of Jacobians", &|r| {
        r.paths.reconnection = default.paths.reconnection;
        r.paths.jacobian_limit = default.paths.jacobian_limit;
    });
    add("+ light of all samples (vector weights)", &|r| r.paths.reuse.shade_all = true);
    add("+ two motion vectors, and more places for neighbors", &|r| {
        let Reuse { dual_motion, temporal_attempts, neighbor_attempts, disocclusion_samples, .. } = default.paths.reuse;
        let reuse = &mut r.paths.reuse;
        (reuse.dual_motion, reuse.disocclusion_samples) = (dual_motion, disocclusion_samples);
        (reuse.temporal_attempts, reuse.neighbor_attempts) = (temporal_attempts, neighbor_attempts);
    });
    add("+ five neighbors within 100 pixels, shorter histories", &|r| r.paths.reuse = default.paths.reuse.clone());
    add("+ direct light in reservoirs of its own", &|r| r.paths.separate_direct_light = true);
    add("+ direct light in pairs (the default)", &|r| r.direct.reuse = default.direct.reuse.clone());
    add("the default, lights drawn one by one", &|r| r.direct.subset_count = 0);
    add("the default, without reuse", &|r| {
        r.direct.subset_count = default.direct.subset_count;
        for reuse in [&mut r.paths.reuse, &mut r.direct.reuse] {
            (reuse.temporal, reuse.spatial_samples, reuse.disocclusion_samples) = (false, 0, 0);
        }
    });
    rows
}

/// Criteria of reconnection and their constants, in sections: the sweep of c of Lin et al. 2026, supplement, 10, and the criteria that it is
/// compared with (11).  The first row of all is the default.
pub fn thresholds(default: &Restir) -> Vec<(&'static str, String, Restir)> {
    let of = |reconnection, footprint| {
        let mut settings = default.clone();
        (settings.paths.reconnection, settings.paths.footprint) = (reconnection, footprint);
        settings
    };
    let row = |section, kind, c: f32| (section, format!("c = {c}"), of(kind, c));
    let mut rows = vec![("Default", "c = 0.02".to_owned(), default.clone())];
    let swept = [0.0, 0.005, 0.01, 0.04, 0.08, 0.16, 0.32, 0.64, 20.0];
    rows.extend(swept.map(|c| row("Both footprints (Eq. 5)", Reconnection::Footprints, c)));
    rows.extend([0.0002, 0.02].map(|c| row("Bounded Jacobian (Eq. 27)", Reconnection::JacobianBound, c)));
    rows.extend([0.02, 2.0].map(|c| row("Footprint of the path (11)", Reconnection::PathFootprint, c)));
    const OTHERS: &str = "Others";
    rows.extend([
        (OTHERS, "black box".into(), of(Reconnection::BlackBox, 0.02)),
        (OTHERS, "black box as printed".into(), of(Reconnection::BlackBoxPrinted, 0.02)),
        (OTHERS, "0.01 m and roughness (Lin et al. 2022)".into(), of(Reconnection::Distance, 0.02)),
    ]);
    rows
}
