// Resampling MIS weights of a canonical sample and its neighbors, from their targets and confidences.  All techniques use them.  1/|Z| and
// the balance heuristic are those of Wyman and Panteleev 2021, 4, with confidence (Lanz 2025, Eq. 25).  MIS_PAIRWISE and
// MIS_DEFENSIVE_PAIRWISE are the pairwise weights with confidence of Wyman et al. 2023, 7.1.3.  MIS_DEFENSIVE_PAIRWISE_GRIS is Eq. 38 of
// Lin et al. 2022 (Lanz 2025, Eqs. 28-29), where confidence multiplies the targets.  Eqs. 26-27 of Lanz 2025 are none of these: at equal
// confidence they weight a pair by p_i/(p_i + p_c), where MIS_PAIRWISE has k p_i/(k p_i + p_c).
//
// Pixel i, domain i of the papers, is the one that input i comes from.  `targets` has, for pixel i and sample j, the target of pixel i at
// sample j, shifted there from the canonical pixel, times the Jacobian of that shift; 0 if the shift is not defined.  Pixel 0 and sample 0
// are the canonical ones.
#define_import_path bevy_restir::restir::mis

#import bevy_restir::common::constants::LEAST_MAGNITUDE
#import bevy_restir::common::guard::{GUARD_MIS_WEIGHT, guard_holds, guarded}
#import bevy_restir::common::math::quotient

// One canonical sample and at most six neighbors.  With at most two neighbors, the arrays take a fifth of the memory.
#ifdef MANY_NEIGHBORS
const MAX_INPUTS: u32 = 7u;
#else
const MAX_INPUTS: u32 = 3u;
#endif

// Places of targets: all of them, or those that pairwise weights need, which are the canonical pixel, the canonical sample, and each
// neighbor's sample in its own pixel.
#ifdef PAIRED
const MAX_TARGETS: u32 = 3u * MAX_INPUTS;

fn place_of(at_pixel: u32, sample: u32) -> u32 {
    if at_pixel == 0u {
        return sample;
    }
    return select(2u, 1u, sample == 0u) * MAX_INPUTS + at_pixel;
}
#else
const MAX_TARGETS: u32 = MAX_INPUTS * MAX_INPUTS;

fn place_of(at_pixel: u32, sample: u32) -> u32 {
    return at_pixel * MAX_INPUTS + sample;
}
#endif

const MIS_UNIFORM: u32 = 0u;                  // confidence over the sum of all: biased, dark where a neighbor cannot draw the sample
const MIS_ONE_OVER_Z: u32 = 1u;               // confidence over the sum of those that can draw the sample: unbiased, noisy
const MIS_BALANCE: u32 = 2u;                  // generalized balance heuristic: k² + k targets for k neighbors
const MIS_PAIRWISE: u32 = 3u;                 // each neighbor against the canonical sample: 2k targets
const MIS_DEFENSIVE_PAIRWISE: u32 = 4u;       // pairwise, with a share c/C for the canonical sample by its confidence
const MIS_DEFENSIVE_PAIRWISE_GRIS: u32 = 5u;  // pairwise, with a share 1/(k+1) for it: for inputs of equal confidence

struct MisInputs {
    count: u32,
    confidence: array<f32, MAX_INPUTS>,
    targets: array<f32, MAX_TARGETS>,
}

fn target_of(inputs: ptr<function, MisInputs>, at_pixel: u32, sample: u32) -> f32 {
    return (*inputs).targets[place_of(at_pixel, sample)];
}

fn set_target(inputs: ptr<function, MisInputs>, at_pixel: u32, sample: u32, value: f32) {
    (*inputs).targets[place_of(at_pixel, sample)] = value;
}

// Whether a kind of weights needs the target of pixel i at sample j; other targets may be 0.
fn mis_needs_target(kind: u32, at_pixel: u32, sample: u32) -> bool {
    if at_pixel == 0u {
        return true;
    }
    switch kind {
        case MIS_UNIFORM: {
            return false;
        }
        case MIS_ONE_OVER_Z, MIS_BALANCE: {
            return true;
        }
        default: {
            return sample == 0u || at_pixel == sample;
        }
    }
}

// The weight m_j of sample j.  The weights of all pixels that can draw a sample sum to 1.
fn mis_weight(inputs: ptr<function, MisInputs>, kind: u32, sample: u32) -> f32 {
    let weight = guarded(unguarded_weight(inputs, kind, sample), GUARD_MIS_WEIGHT);
    _ = guard_holds(weight <= 1.0 + WEIGHT_ROUNDING, GUARD_MIS_WEIGHT);
    return weight;
}

// A weight may exceed 1 by rounding.
const WEIGHT_ROUNDING: f32 = 1.0e-4;

fn unguarded_weight(inputs: ptr<function, MisInputs>, kind: u32, sample: u32) -> f32 {
    switch kind {
        case MIS_UNIFORM: {
            return (*inputs).confidence[sample] / total_confidence(inputs);
        }
        case MIS_ONE_OVER_Z, MIS_BALANCE: {
            return balance_weight(inputs, kind == MIS_BALANCE, sample);
        }
        default: {
            return pairwise_weight(inputs, kind, sample);
        }
    }
}

fn total_confidence(inputs: ptr<function, MisInputs>) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < (*inputs).count; i++) {
        sum += (*inputs).confidence[i];
    }
    return max(sum, LEAST_MAGNITUDE);
}

// Weight by confidence, and by the target too if `by_target`; otherwise over the pixels whose target is positive.
fn balance_weight(inputs: ptr<function, MisInputs>, by_target: bool, sample: u32) -> f32 {
    // Targets are divided by the greatest one: confidence times a huge target would overflow.
    var greatest = 0.0;
    for (var i = 0u; i < (*inputs).count; i++) {
        greatest = max(greatest, select(0.0, target_of(inputs, i, sample), (*inputs).confidence[i] > 0.0));
    }
    if !(greatest > 0.0) {
        return 0.0;
    }
    var sum = 0.0;
    var own = 0.0;
    for (var i = 0u; i < (*inputs).count; i++) {
        let p = min(quotient(target_of(inputs, i, sample), greatest), 1.0);
        let share = (*inputs).confidence[i] * select(f32(target_of(inputs, i, sample) > 0.0), p, by_target);
        sum += share;
        own = select(own, share, i == sample);
    }
    if !(sum > 0.0) {
        return 0.0;
    }
    return own / sum;
}

// Confidence may depend on geometry, never on the sample: that would add bias.  PLANT_*: errors that only tests define, and must find.
#ifdef PLANT_CONFIDENCE_OF_SUCCESS
fn count_confidence(mis: ptr<function, MisInputs>) {
    for (var j = 1u; j < (*mis).count; j++) {
        (*mis).confidence[j] *= f32(target_of(mis, 0u, j) > 0.0);
    }
}
#else
fn count_confidence(mis: ptr<function, MisInputs>) {
}
#endif

// Pairwise weights sum over pairs of a neighbor and the canonical pixel, each a balance heuristic of two.  In the three kinds, `weight` is
// the weight of a pair, and `neighbor_scale` and `canonical_scale` are the factors of its two targets.
fn pairwise_weight(inputs: ptr<function, MisInputs>, kind: u32, sample: u32) -> f32 {
    let k = (*inputs).count - 1u;
    if k == 0u {
        return 1.0;
    }
    let total = total_confidence(inputs);
    let canonical_confidence = (*inputs).confidence[0];
    var neighbor_confidence = 0.0;
    for (var i = 1u; i <= k; i++) {
        neighbor_confidence += (*inputs).confidence[i];
    }
    // Without confidence in any neighbor, the canonical sample has the whole weight.
    if !(neighbor_confidence > 0.0) {
        return f32(sample == 0u);
    }
    let gris = kind == MIS_DEFENSIVE_PAIRWISE_GRIS;

    var sum = 0.0;
    for (var i = 1u; i <= k; i++) {
        if sample != 0u && i != sample {
            continue;
        }
        let c = (*inputs).confidence[i];
        var weight = c / select(neighbor_confidence, total, kind == MIS_DEFENSIVE_PAIRWISE);
        var neighbor_scale = neighbor_confidence;
        var canonical_scale = canonical_confidence;
        if gris {
            weight = 1.0 / f32(k + 1u);
            neighbor_scale = c;
            canonical_scale = canonical_confidence / f32(k);
        }
        let targets = target_pair(target_of(inputs, i, sample), target_of(inputs, 0u, sample));
        let neighbor_term = neighbor_scale * targets.x;
        let canonical_term = canonical_scale * targets.y;
        let both = neighbor_term + canonical_term;
        if sample == 0u {
            // If neither can draw the sample, the canonical one has the weight of the pair.
            sum += weight * select(1.0, canonical_term / both, both > 0.0);
        } else {
            sum += weight * select(0.0, neighbor_term / both, both > 0.0);
        }
    }
    if sample == 0u {
        sum += select(0.0, canonical_confidence / total, kind == MIS_DEFENSIVE_PAIRWISE);
        sum += select(0.0, 1.0 / f32(k + 1u), gris);
    }
    return sum;
}

// (neighbor's target, canonical target), divided by the greater one: confidence times a huge target would overflow.
fn relative_pair(neighbor: f32, canonical: f32) -> vec2<f32> {
    let greater = max(neighbor, canonical);
    return select(vec2<f32>(0.0), vec2<f32>(quotient(neighbor, greater), quotient(canonical, greater)), greater > 0.0);
}

// PLANT_*: an error that only tests define, and must find.
#ifdef PLANT_SWAPPED_MIS
fn target_pair(neighbor: f32, canonical: f32) -> vec2<f32> {
    return relative_pair(canonical, neighbor);
}
#else
fn target_pair(neighbor: f32, canonical: f32) -> vec2<f32> {
    return relative_pair(neighbor, canonical);
}
#endif
