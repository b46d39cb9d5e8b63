//! MIS weights of bidirectional path tracing: the recursion, and the three floats that give the weight after a reconnection, equal the
//! densities of all techniques, for random paths of 3 to 9 vertices.  A path of 2 vertices has one technique: the camera sees a light.

use crate::support::{
    compose::{Def, flag},
    gpu::{Bound, Gpu, gpu},
    oracle::bidirectional::{Path, VERTICES},
    stats::Random,
};
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
    /// Eq. 42 as it is printed: the geometry term of the wrong direction.
    Direction,
    /// The probability of a delta lobe between the reconnection and the connection is counted in one direction only.
    DeltaSuffix,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Weights {
    recursive: [f32; VERTICES],
    cached: [f32; VERTICES],
}

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
        splats: random.pick(&[1.0, 64.0, 2.0e6]),
        nee: density(random),
        light: density(random),
        ..Path::zeroed()
    };
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
    if r < path.k as usize {
        path.forward[r + 1] = density(random);
    }
    for i in 1..r {
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

fn weights(gpu: &Gpu, base: &[Path], shifted: &[Path], defs: &[Def]) -> Vec<Weights> {
    let [a, b] = [base, shifted].map(|paths| gpu.storage(paths));
    let output = gpu.zeroed::<Weights>(base.len());
    let bound = [(0, 0, Bound::Buffer(&a)), (0, 1, Bound::Buffer(&b)), (0, 2, Bound::Buffer(&output))];
    gpu.kernel("bidirectional_mis", include_str!("../support/kernels/bidirectional_mis.wgsl"), defs)
        .run([(base.len() as u32).div_ceil(64), 1, 1], &bound);
    gpu.read(&output)
}

/// The greatest errors of the weights by recursion, of their sums, and of the weights after a reconnection.
#[derive(Debug, Default)]
struct Errors {
    recursive: f64,
    sum: f64,
    cached: f64,
}

fn errors(gpu: &Gpu, light: Light, error: Error, defs: &[Def]) -> Errors {
    let (base, shifted) = paths(light, error);
    let mut errors = Errors::default();
    let worst = |error: &mut f64, found: f32, expected: f64| {
        let difference = (f64::from(found) - expected).abs();
        *error = if difference.is_nan() { f64::INFINITY } else { error.max(difference) };
    };
    for ((base, shifted), found) in base.iter().zip(&shifted).zip(weights(gpu, &base, &shifted, defs)) {
        let expected = base.weights();
        for (&found, &expected) in found.recursive.iter().zip(&expected) {
            worst(&mut errors.recursive, found, expected);
        }
        if expected.iter().sum::<f64>() > 0.0 {
            let sum = found.recursive.iter().map(|&w| f64::from(w)).sum::<f64>();
            errors.sum = errors.sum.max((sum - 1.0).abs());
        }
        let expected = shifted.weights();
        if base.reconnection > 0 {
            let later = base.reconnection as usize + 1..=base.k as usize + 1;
            for (&found, &expected) in found.cached[later.clone()].iter().zip(&expected[later]) {
                worst(&mut errors.cached, found, expected);
            }
        }
    }
    errors
}

#[test]
fn weights_of_bidirectional_techniques_equal_their_densities() {
    let Some(gpu) = gpu() else { return };
    for light in LIGHTS {
        let found = errors(gpu, light, Error::None, &[]);
        eprintln!("{light:?}: {found:?}");
        assert!(found.recursive < TOLERANCE && found.cached < TOLERANCE, "{light:?}: {found:?}");
        assert!(found.sum < 2.0 * TOLERANCE, "{light:?}: {found:?}");
    }
}

#[test]
fn planted_errors_of_bidirectional_weights_are_found() {
    let Some(gpu) = gpu() else { return };
    let found = |light, error, defs: &[Def]| {
        let found = errors(gpu, light, error, defs);
        eprintln!("{error:?} {defs:?}: {found:?}");
        found
    };
    let order = found(Light::Area, Error::None, &[flag("PLANT_MIS_ORDER")]);
    assert!(order.sum > 0.1 && order.recursive > 0.1, "{order:?}");
    for (light, error) in
        [(Light::Area, Error::Splats), (Light::Infinite, Error::Environment), (Light::Area, Error::SplatDensity)]
    {
        let wrong = found(light, error, &[]);
        assert!(wrong.sum > 0.1 && wrong.recursive > 0.1, "{error:?}: {wrong:?}");
    }
    for error in [Error::Direction, Error::DeltaSuffix] {
        let wrong = found(Light::Area, error, &[]);
        assert!(wrong.recursive < TOLERANCE && wrong.cached > 0.1, "{error:?}: {wrong:?}");
    }
}
