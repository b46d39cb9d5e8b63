//! MIS weights of bidirectional path tracing, by the functions of the passes: the recursion, and the two numbers that a reservoir stores for
//! the weight after a reconnection, agree with the densities of all techniques, for random paths of 3 to 9 vertices.  A path of 2 vertices
//! has one technique: the camera sees a light.

use crate::support::{
    compose::{Def, flag},
    gpu::{Bound, Gpu, gpu},
    oracle::bidirectional::{Path, VERTICES},
    stats::Random,
};
use bevy_restir::testing::shader_library::ShaderEdit;
use bytemuck::{Pod, Zeroable};

const PATHS: usize = 20_000;
/// The greatest error of a weight: f32 keeps 24 bits, and a weight is a sum of products of up to 40 factors.
const TOLERANCE: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Light {
    /// Emissive triangles, rectangles and spheres.
    Area,
    /// The environment and suns.
    Infinite,
    /// Points and spots.
    Point,
    Directional,
}

const LIGHTS: [Light; 4] = [Light::Area, Light::Infinite, Light::Point, Light::Directional];

/// An error of the kernel, by its number there.
#[derive(Clone, Copy, Debug)]
enum Error {
    None,
    /// The number of light sub-paths is left out.
    Splats,
    /// An environment counts as a light that no ray hits.
    Environment,
    /// Eq. 40 as it is printed: the density of the wrong vertex.
    SplatDensity,
    /// A vertex that the camera sees counts one light candidate.
    Candidates,
    /// Eq. 42 as it is printed: the geometry term of the wrong direction.
    Direction,
    /// The probability of a delta lobe behind the reconnection is counted in one direction only.
    DeltaSuffix,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Weights {
    recursive: [f32; VERTICES],
    cached: [f32; VERTICES],
}

const fn edit(from: &'static str, to: &'static str) -> ShaderEdit {
    ShaderEdit { module: "path/technique_weights.wgsl", from, to }
}

/// Densities of surfaces and lights are numbers of the path (`bidirectional_mis.wgsl`).
const NUMBERS: [ShaderEdit; 5] = [
    edit("reverse_pdf(v.surface, wi, v.wo)", "v.medium.x"),
    edit("reverse_pdf(v.surface, step.wi, v.wo)", "v.medium.x"),
    edit("reverse_pdf(v.surface, l.wi, v.wo)", "v.medium.x"),
    edit("candidates * light_pmf(l.light) * l.pdf_solid_angle", "candidates * l.pdf_solid_angle"),
    edit(
        "return share * light_pmf(l.light) * l.pdf_solid_angle * emission_density(l);",
        "return share * l.pdf_solid_angle * l.distance;",
    ),
];

/// Errors of the weights of camera sub-paths, and whether they change weights without a shift, too.
const PLANTED: [(&str, ShaderEdit, bool); 7] = [
    (
        "stored numbers in the wrong order",
        edit(
            "return 1.0 / (1.0 + dot(coefficients, s.basis.yz));",
            "return 1.0 / (1.0 + dot(coefficients, s.basis.zy));",
        ),
        false,
    ),
    (
        "the cosine behind the reconnection",
        edit(
            "return behind_reconnection(cos_out, step.pdf, sum.x);",
            "return behind_reconnection(1.0, step.pdf, sum.x);",
        ),
        true,
    ),
    (
        "earlier techniques behind a delta lobe",
        edit(
            "return CameraState(vec3<f32>(0.0), cos_out * s.earlier, s.basis);",
            "return CameraState(vec3<f32>(0.0), vec3<f32>(0.0), s.basis);",
        ),
        true,
    ),
    (
        "the share of caustics",
        edit("select(counts.shares.nee, counts.shares.caustic, by_delta)", "counts.shares.nee"),
        true,
    ),
    (
        "techniques nearer to the light than a connection",
        edit("vec3<f32>(1.0 + pdf * ratios.x, 0.0, 0.0)", "vec3<f32>(1.0, 0.0, 0.0)"),
        true,
    ),
    ("connections that do not exist", edit("(counts.connections * dot(d, d) / cos_in)", "(dot(d, d) / cos_in)"), true),
    (
        "techniques before a point of entry",
        edit("return CameraState(vec3<f32>(0.0), vec3<f32>(0.0), s.basis);", "return s;"),
        true,
    ),
];

/// Log-uniform over the range of densities.
fn density(random: &mut Random) -> f32 {
    (0.05f64.ln() + random.unit() * 400f64.ln()).exp() as f32
}

fn cosine(random: &mut Random) -> f32 {
    (0.05 + 0.95 * random.unit()) as f32
}

/// Makes xi a vertex that scatters by a delta lobe, with one probability in both directions.
fn make_delta(random: &mut Random, path: &mut Path, i: usize) {
    let probability = cosine(random);
    path.connectable &= !(1 << i);
    path.forward[i + 1] = probability;
    path.reverse[i - 1] = probability;
}

fn random_path(random: &mut Random, light: Light) -> Path {
    let k = 2 + (random.unit() * 7.0) as usize;
    let mut path = Path {
        k: k as u32,
        delta_light: u32::from(matches!(light, Light::Point | Light::Directional)),
        connectable: u32::MAX,
        candidates: random.pick(&[1, 16]),
        splats: random.pick(&[1.0, 64.0, 2.0e6]),
        connections: random.pick(&[0.0, 1.0, 16.0]),
        nee: density(random),
        light: density(random),
        ..Path::zeroed()
    };
    // Without reuse, and with a `reuse_gain` of 16.
    (path.nee_share, path.caustic_share) = random.pick(&[(1.0, 1.0), (1.0 / 16.0, 16.0)]);
    for i in 0..=k {
        path.cos_in[i] = cosine(random);
        path.cos_out[i] = cosine(random);
        path.distance2[i] = density(random);
        path.forward[i] = density(random);
        path.reverse[i] = density(random);
    }
    if matches!(light, Light::Infinite | Light::Directional) {
        // Density in area of a disk around the scene.
        path.reverse[k - 1] = 1.0 / (core::f32::consts::PI * 49.0);
        (path.cos_in[k], path.distance2[k]) = (1.0, 1.0);
    }
    if path.delta_light != 0 {
        // The point of a delta light has a probability.
        (path.cos_in[k], path.light) = (1.0, path.nee);
    }
    for _ in 0..(random.unit() * 4.0) as usize {
        let i = 1 + (random.unit() * (k - 1) as f64) as usize;
        make_delta(random, &mut path, i);
    }
    let below = 1 + (random.unit() * (k - 1) as f64) as u32;
    if path.connectable & (1 << below) != 0 && random.unit() < 0.3 {
        path.below = below;
    }
    path
}

/// Replaces the vertices before the reconnection vertex, and everything that depends on them.
fn shifted(random: &mut Random, base: &Path) -> Path {
    let (mut path, r) = (*base, base.reconnection as usize);
    for i in 1..=r {
        (path.cos_in[i], path.cos_out[i - 1], path.distance2[i]) = (cosine(random), cosine(random), density(random));
        path.forward[i] = density(random);
        if i < r {
            path.reverse[i] = density(random);
            path.connectable |= 1 << i;
        }
    }
    // The density behind a point where light enters a body does not depend on the path before.
    if r < path.k as usize && base.reconnection != base.below {
        path.forward[r + 1] = density(random);
    }
    for i in (1..r).filter(|i| *i != base.below as usize) {
        if random.unit() < 0.3 {
            make_delta(random, &mut path, i);
        }
    }
    path
}

/// Base paths, each with a shifted one.
fn paths(light: Light, error: Error) -> (Vec<Path>, Vec<Path>) {
    let mut random = Random(17 + light as u64);
    let pair = |_| {
        let mut base = Path { error: error as u32, ..random_path(&mut random, light) };
        let r = 1 + (random.unit() * f64::from(base.k)) as u32;
        if r < base.k && base.connectable & (1 << r) != 0 {
            base.reconnection = r;
        }
        (base, shifted(&mut random, &base))
    };
    (0..PATHS).map(pair).unzip()
}

fn weights(gpu: &Gpu, base: &[Path], shifted: &[Path], defs: &[Def], edits: &[ShaderEdit]) -> Vec<Weights> {
    let [a, b] = [base, shifted].map(|paths| gpu.storage(paths));
    let output = gpu.zeroed::<Weights>(base.len());
    let bound = [(0, 0, Bound::Buffer(&a)), (0, 1, Bound::Buffer(&b)), (0, 2, Bound::Buffer(&output))];
    let source = include_str!("../support/kernels/bidirectional_mis.wgsl");
    let (defs, edits) = ([&[flag("LIGHT_PATHS")], defs].concat(), [&NUMBERS, edits].concat());
    gpu.kernel_with("bidirectional_mis", source, &defs, &edits).run([(base.len() as u32).div_ceil(64), 1, 1], &bound);
    gpu.read(&output)
}

/// The greatest errors of the weights by recursion, of their sums, and of the weights after a reconnection; the number of the last, and of the
/// connections among them.
#[derive(Debug, Default)]
struct Errors {
    recursive: f64,
    sum: f64,
    cached: f64,
    shifts: u32,
    connections: u32,
}

fn errors(gpu: &Gpu, light: Light, error: Error, defs: &[Def], edits: &[ShaderEdit]) -> Errors {
    let (base, shifted) = paths(light, error);
    let mut errors = Errors::default();
    let worst = |error: &mut f64, found: f32, expected: f64| {
        let difference = (f64::from(found) - expected).abs();
        *error = if difference.is_nan() { f64::INFINITY } else { error.max(difference) };
    };
    for ((base, shifted), found) in base.iter().zip(&shifted).zip(weights(gpu, &base, &shifted, defs, edits)) {
        let expected = base.weights();
        for (&found, &expected) in found.recursive.iter().zip(&expected) {
            worst(&mut errors.recursive, found, expected);
        }
        if expected.iter().sum::<f64>() > 0.0 {
            let sum = found.recursive.iter().map(|&w| f64::from(w)).sum::<f64>();
            errors.sum = errors.sum.max((sum - 1.0).abs());
        }
        let (r, k) = (base.reconnection, base.k);
        let expected = shifted.weights();
        for t in (r + 1..=k + 1).filter(|_| r > 0) {
            // Next-event estimation at the reconnection vertex stores no weight.
            let is_stored = t != k || r + 1 < k || r == base.below;
            if is_stored {
                worst(&mut errors.cached, found.cached[t as usize], expected[t as usize]);
                errors.shifts += u32::from(expected[t as usize] > 0.0);
                errors.connections += u32::from(t < k && expected[t as usize] > 0.0);
            }
        }
    }
    errors
}

#[test]
fn weights_of_bidirectional_techniques_equal_their_densities() {
    let Some(gpu) = gpu() else { return };
    for light in LIGHTS {
        let found = errors(gpu, light, Error::None, &[], &[]);
        eprintln!("{light:?}: {found:?}");
        assert!(found.recursive < TOLERANCE && found.cached < TOLERANCE, "{light:?}: {found:?}");
        assert!(
            found.sum < 2.0 * TOLERANCE && found.shifts > 2_000 && found.connections > 1_000,
            "{light:?}: {found:?}"
        );
    }
}

#[test]
fn planted_errors_of_bidirectional_weights_are_found() {
    let Some(gpu) = gpu() else { return };
    let found = |light, error, defs: &[Def], edits: &[ShaderEdit]| {
        let found = errors(gpu, light, error, defs, edits);
        eprintln!("{error:?} {defs:?}: {found:?}");
        found
    };
    let order = found(Light::Area, Error::None, &[flag("PLANT_MIS_ORDER")], &[]);
    assert!(order.sum > 0.1 && order.recursive > 0.1, "{order:?}");
    for (light, error) in [
        (Light::Area, Error::Splats),
        (Light::Infinite, Error::Environment),
        (Light::Area, Error::SplatDensity),
        (Light::Area, Error::Candidates),
    ] {
        let wrong = found(light, error, &[], &[]);
        assert!(wrong.sum > 0.1 && wrong.recursive > 0.1, "{error:?}: {wrong:?}");
    }
    for error in [Error::Direction, Error::DeltaSuffix] {
        let wrong = found(Light::Area, error, &[], &[]);
        assert!(wrong.recursive > 0.1 && wrong.cached > 0.1, "{error:?}: {wrong:?}");
    }
    for (name, edit, is_of_all) in PLANTED {
        let wrong = found(Light::Area, Error::None, &[], &[edit]);
        assert!(wrong.cached > 0.1 && (wrong.recursive > 0.1) == is_of_all, "{name}: {wrong:?}");
    }
}
