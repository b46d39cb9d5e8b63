//! The criteria of reconnections equal the f64 oracle: the footprints of both vertices with their factors 4π and 1/100, the density of
//! black-box materials, the bound of the Jacobian, the footprint of the path, distances, and roughness (Lin et al. 2026, supplement, 2-4
//! and 11).  Any criterion that is consistent with itself is unbiased, so no picture shows a wrong one.

use crate::support::{
    gpu::{Bound, Gpu, gpu},
    oracle::reconnection::{Pixel, Rule, Vertex, decide, primary_footprint},
    stats::Random,
};
use bevy_restir::testing::{gpu_layout::*, shader_library::ShaderEdit};
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use std::f64::consts::PI;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Side {
    position: [f32; 3],
    pdf: f32,
    n_geo: [f32; 3],
    roughness: f32,
    coat_roughness: f32,
    lobe: u32,
    delta: u32,
    diffuse: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Pair {
    eye: [f32; 3],
    kind: u32,
    first: [f32; 3],
    separation: f32,
    first_normal: [f32; 3],
    roughness: f32,
    index: u32,
    pad: [u32; 3],
    earlier: Side,
    from: Side,
    to: Side,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Answer {
    threshold: f32,
    rough: u32,
    connectable: u32,
    connectable_end: u32,
}

/// `LOBE_*` of `shaders/bsdf/types.wgsl`.
const DIFFUSE: u32 = 0;
const COAT: u32 = 3;

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

fn side(random: &mut Random, size: f64) -> Side {
    let lobe = random.pick(&[DIFFUSE, 1, 2, COAT]);
    let position = (random.direction() * size * random.unit()).as_vec3().to_array();
    let perceptual = |random: &mut Random| (0.05 + 0.95 * random.unit()).powi(2) as f32;
    Side {
        position,
        pdf: 10f64.powf(6.0 * random.unit() - 2.0) as f32,
        n_geo: random.direction().as_vec3().to_array(),
        roughness: perceptual(random),
        coat_roughness: perceptual(random),
        lobe,
        delta: u32::from(lobe != DIFFUSE && random.unit() < 0.2),
        diffuse: u32::from(lobe == DIFFUSE && random.unit() < 0.5),
    }
}

/// All kinds, in the order of their numbers.
const KINDS: [u32; 7] = [
    RECONNECT_FOOTPRINTS,
    RECONNECT_BLACK_BOX,
    RECONNECT_BLACK_BOX_PRINTED,
    RECONNECT_JACOBIAN_BOUND,
    RECONNECT_PATH_FOOTPRINT,
    RECONNECT_DISTANCE,
    RECONNECT_FIRST,
];

/// Pairs of every kind whose ratios to the limits spread around 1.
fn random_pairs(count: usize) -> Vec<Pair> {
    let mut random = Random(31);
    (0..count)
        .map(|i| {
            let kind = KINDS[i % KINDS.len()];
            let size = 10f64.powf(4.0 * random.unit() - 2.0);
            let mut pair = Pair {
                eye: (random.direction() * size).as_vec3().to_array(),
                kind,
                first: (random.direction() * size * 0.3).as_vec3().to_array(),
                first_normal: random.direction().as_vec3().to_array(),
                roughness: (0.1 + 0.8 * random.unit()) as f32,
                index: random.pick(&[1, 1, 2, 3]),
                earlier: side(&mut random, size),
                from: side(&mut random, size),
                to: side(&mut random, size),
                ..Default::default()
            };
            pair.separation = if kind >= RECONNECT_DISTANCE {
                (size * random.unit()) as f32
            } else {
                10f64.powf(4.0 * random.unit() - 3.0) as f32
            };
            // Narrow lobes would fail every other threshold.
            let roughness = f64::from(pair.roughness);
            let limit = if kind == RECONNECT_BLACK_BOX { roughness.powi(-2) } else { roughness.powf(-0.5) };
            if matches!(kind, RECONNECT_BLACK_BOX | RECONNECT_BLACK_BOX_PRINTED) && random.unit() < 0.8 {
                pair.from.pdf = (random.unit() * 2.0 * limit) as f32;
            }
            pair
        })
        .collect()
}

fn answers(gpu: &Gpu, pairs: &[Pair], edits: &[ShaderEdit]) -> Vec<Answer> {
    let (input, output) = (gpu.storage(pairs), gpu.zeroed::<Answer>(pairs.len()));
    let bound = [(0, 0, Bound::Buffer(&input)), (0, 1, Bound::Buffer(&output))];
    gpu.kernel_with("connection", include_str!("../../support/kernels/connection.wgsl"), &[], edits)
        .run([(pairs.len() as u32).div_ceil(64), 1, 1], &bound);
    gpu.read(&output)
}

fn vertex(s: &Side) -> Vertex {
    // α is the square of the perceptual roughness; a diffuse lobe is as rough as a lobe can be.
    let alpha = if s.lobe == COAT { s.coat_roughness } else { s.roughness };
    Vertex {
        position: wide(s.position),
        n_geo: wide(s.n_geo),
        pdf: s.pdf.into(),
        roughness: if s.lobe == DIFFUSE { 1.0 } else { f64::from(alpha).sqrt() },
        is_delta: s.delta != 0,
        is_diffuse: s.diffuse != 0,
    }
}

fn rule(pair: &Pair) -> Rule {
    let value = pair.separation.into();
    match pair.kind {
        RECONNECT_FOOTPRINTS => Rule::Footprints(value),
        RECONNECT_BLACK_BOX => Rule::BlackBox(value),
        RECONNECT_BLACK_BOX_PRINTED => Rule::BlackBoxPrinted(value),
        RECONNECT_JACOBIAN_BOUND => Rule::JacobianBound(value),
        RECONNECT_PATH_FOOTPRINT => Rule::PathFootprint(value),
        RECONNECT_DISTANCE => Rule::Distance(value),
        _ => Rule::First(value),
    }
}

/// Decisions nearer to their limit than this may differ by rounding.
const ROUNDING: f64 = 1e-4;

/// The numbers of answers in which the shader and the oracle differ; and, by kind of criterion, how often the oracle decided no and yes.
#[derive(Default, Debug)]
struct Differences {
    thresholds: usize,
    rough: usize,
    connectable: usize,
    ends: usize,
    decided: [[usize; 2]; KINDS.len()],
}

impl Differences {
    fn total(&self) -> usize {
        self.thresholds + self.rough + self.connectable + self.ends
    }
}

fn differences(pairs: &[Pair], answers: &[Answer]) -> Differences {
    let mut found = Differences::default();
    for (pair, answer) in pairs.iter().zip(answers) {
        let pixel = Pixel { eye: wide(pair.eye), rule: rule(pair), roughness: pair.roughness.into() };
        let first = Vertex { position: wide(pair.first), n_geo: wide(pair.first_normal), ..Default::default() };
        let threshold = match pixel.rule {
            Rule::Footprints(c) | Rule::BlackBox(c) | Rule::BlackBoxPrinted(c) | Rule::PathFootprint(c) => {
                c / 100.0 * primary_footprint(pixel.eye, &first)
            }
            Rule::JacobianBound(c) => 2.0 * PI * c / 100.0 * primary_footprint(pixel.eye, &first),
            Rule::Distance(d) | Rule::First(d) => d,
        };
        let cosine = first.n_geo.dot((pixel.eye - first.position).normalize()).abs();
        // Edge-on, the cosine has no precision left.
        if cosine < 1e-3 {
            continue;
        }
        found.thresholds += usize::from((f64::from(answer.threshold) / threshold - 1.0).abs() > 1e-4 / cosine.min(1.0));
        let (x, y) = (vertex(&pair.from), vertex(&pair.to));
        let before = if pair.index > 1 { vec![vertex(&pair.earlier), x] } else { vec![x] };
        let of = |ratios: &[f64], answer: u32, count: &mut usize| {
            let (expected, margin) = decide(ratios);
            *count += usize::from(expected != (answer != 0) && margin > ROUNDING / cosine);
            expected
        };
        let mut ratio = vec![pixel.roughness_ratio(&x)];
        if matches!(pixel.rule, Rule::First(_)) && pair.index != 1 {
            ratio.push(0.0);
        }
        of(&ratio, answer.rough, &mut found.rough);
        let both = pixel.ratios(&first, &before, pair.index as usize, &y, false);
        let yes = of(&both, answer.connectable, &mut found.connectable);
        found.decided[pair.kind as usize][usize::from(yes)] += 1;
        let end = pixel.ratios(&first, &before, pair.index as usize, &y, true);
        of(&end, answer.connectable_end, &mut found.ends);
    }
    found
}

#[test]
fn connection_criteria_equal_those_of_the_paper() {
    let Some(gpu) = gpu() else { return };
    let pairs = random_pairs(140_000);
    let found = differences(&pairs, &answers(gpu, &pairs, &[]));
    eprintln!("{found:?}");
    assert_eq!(found.total(), 0, "{found:?}");
    assert!(found.decided.iter().flatten().all(|&n| n > 500), "every kind decides both ways: {:?}", found.decided);
}

const CRITERIA: &str = "restir/shift/reconnection.wgsl";

/// Errors of the criteria.  Each is consistent with itself, so that no picture is biased.
const WRONG: [(&str, &str, &str); 17] = [
    ("no 4π", "separation * FOUR_PI * d2", "separation * d2"),
    ("no 1/100", "return 0.01 * separation", "return separation"),
    ("no cosine of the pixel", "d2 / max(cosine, 1.0e-6)", "d2"),
    (
        "footprint of the first vertex only",
        "&& (bsdf_is_diffuse(s.bsdf) || is_apart(s.position, a.position, a.n_geo, pdf_after, c.kind, c.separation))",
        "",
    ),
    ("diffuse vertices are tested, too", "(bsdf_is_diffuse(s.bsdf) || is_apart(", "(is_apart("),
    (
        "cosine at the wrong end",
        "is_apart(s.position, a.position, a.n_geo,",
        "is_apart(s.position, a.position, s.bsdf.n_geo,",
    ),
    (
        "density of the lobe",
        "v.surface.bsdf.n_geo, step.pdf, step.pdf_lobe",
        "v.surface.bsdf.n_geo, step.pdf_lobe, step.pdf_lobe",
    ),
    ("α for the perceptual roughness", "select(sqrt(select(b.roughness,", "select((select(b.roughness,"),
    ("roughness of the base for the coat", "b.coat_roughness, lobe == LOBE_COAT", "b.coat_roughness, false"),
    ("1/p for 1/√p", "step.pdf * c.roughness * c.roughness <= 1.0", "step.pdf * c.roughness <= 1.0"),
    ("1/p for 1/p²", "step.pdf * step.pdf * c.roughness <= 1.0", "step.pdf * c.roughness <= 1.0"),
    ("no 2π in the bound of the Jacobian", "select(1.0, TWO_PI, kind", "select(1.0, 1.0, kind"),
    ("the Jacobian lacks the density after", "n_geo_b) * pdf_after * c.separation", "n_geo_b) * c.separation"),
    ("the spread of the path is forgotten", "return a.spread + inverseSqrt(", "return inverseSqrt("),
    ("footprints are added in place of their roots", "a.spread + inverseSqrt(max(", "a.spread + 1.0 / (max("),
    ("a delta after a path is spread", "step.delta && c.kind != RECONNECT_PATH_FOOTPRINT", "step.delta"),
    ("roughness before a distance only", "c.kind == RECONNECT_DISTANCE && !rough_after", "false"),
];

#[test]
fn wrong_connection_criteria_are_found() {
    let Some(gpu) = gpu() else { return };
    let pairs = random_pairs(14_000);
    for (name, from, to) in WRONG {
        let edit = ShaderEdit { module: CRITERIA, from, to };
        let found = differences(&pairs, &answers(gpu, &pairs, &[edit])).total();
        eprintln!("{name}: {found} differences");
        assert!(found > 20, "{name} is not found");
    }
}
