// Resampling MIS weights (Lin et al. 2022; Lanz 2025, Eqs. 26-29; Wyman and Panteleev 2021, 4.4): the share of each input in the
// combination of a canonical sample with its neighbors.  Pure functions of targets and confidences, for every technique alike.
//
// `targets` holds, for domain i and sample j, the target of domain i at sample j as the canonical domain sees it: times the Jacobian
// of the shift from there, 0 where the sample has no counterpart in domain i.  Domain and sample 0 are the canonical ones.
#define_import_path bevy_restir::restir::mis

// Canonical and at most six neighbors; of two it takes a fifth of the memory.
#ifdef MANY_NEIGHBORS
const MAX_INPUTS: u32 = 7u;
#else
const MAX_INPUTS: u32 = 3u;
#endif
const MAX_TARGETS: u32 = MAX_INPUTS * MAX_INPUTS;

const MIS_UNIFORM: u32 = 0u;               // c/C: biased dark where a neighbor could not have drawn the sample
const MIS_ONE_OVER_Z: u32 = 1u;                 // c over those that could have drawn it: unbiased, noisy
const MIS_BALANCE: u32 = 2u;               // generalised balance heuristic: k² + k targets of k neighbors
const MIS_PAIRWISE: u32 = 3u;              // neighbor by neighbor against the canonical sample: 2k targets
const MIS_DEFENSIVE_PAIRWISE: u32 = 4u;    // as above with c_c/C of the weight kept for the canonical sample
const MIS_DEFENSIVE_PAIRWISE_GRIS: u32 = 5u;   // with 1/(k+1) kept for it: for inputs of like confidence

struct MisInputs {
    count: u32,
    confidence: array<f32, MAX_INPUTS>,
    targets: array<f32, MAX_TARGETS>,
}

fn target_of(inputs: ptr<function, MisInputs>, domain: u32, sample: u32) -> f32 {
    return (*inputs).targets[domain * MAX_INPUTS + sample];
}

// Whether a kind asks for the target of domain i at sample j; the others may stay 0.
fn mis_needs_target(kind: u32, domain: u32, sample: u32) -> bool {
    if domain == sample || domain == 0u {
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
            return sample == 0u;
        }
    }
}

// m_j at sample j; the weights of all inputs that could have drawn a sample add up to 1.
fn mis_weight(inputs: ptr<function, MisInputs>, kind: u32, sample: u32) -> f32 {
    switch kind {
        case MIS_UNIFORM: {
            return (*inputs).confidence[sample] / total_confidence(inputs);
        }
        case MIS_ONE_OVER_Z, MIS_BALANCE: {
            return balance(inputs, kind == MIS_BALANCE, sample);
        }
        default: {
            return pairwise(inputs, kind, sample);
        }
    }
}

fn total_confidence(inputs: ptr<function, MisInputs>) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < (*inputs).count; i++) {
        sum += (*inputs).confidence[i];
    }
    return max(sum, 1.0e-30);
}

fn balance(inputs: ptr<function, MisInputs>, by_target: bool, sample: u32) -> f32 {
    // Relative to the greatest: confidence times a huge target would overflow.
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
        let p = min(target_of(inputs, i, sample) / greatest, 1.0);
        let share = (*inputs).confidence[i] * select(f32(target_of(inputs, i, sample) > 0.0), p, by_target);
        sum += share;
        own = select(own, share, i == sample);
    }
    if !(sum > 0.0) {
        return 0.0;
    }
    return own / sum;
}

// The three forms share one pair: how neighbor i and the canonical domain divide a sample between them.  `weight` is what the
// neighbor's pair counts, `scale` and `canonical` the factors of the two targets in it.
fn pairwise(inputs: ptr<function, MisInputs>, kind: u32, sample: u32) -> f32 {
    let k = (*inputs).count - 1u;
    if k == 0u {
        return 1.0;
    }
    let total = total_confidence(inputs);
    let of_canonical = (*inputs).confidence[0];
    var neighbors = 0.0;
    for (var i = 1u; i <= k; i++) {
        neighbors += (*inputs).confidence[i];
    }
    // Neighbors without a history leave all to the canonical sample.
    if !(neighbors > 0.0) {
        return f32(sample == 0u);
    }
    let gris = kind == MIS_DEFENSIVE_PAIRWISE_GRIS;

    var sum = 0.0;
    for (var i = 1u; i <= k; i++) {
        if sample != 0u && i != sample {
            continue;
        }
        let c = (*inputs).confidence[i];
        var weight = c / select(neighbors, total, kind == MIS_DEFENSIVE_PAIRWISE);
        var scale = neighbors;
        var canonical = of_canonical;
        if gris {
            weight = 1.0 / f32(k + 1u);
            scale = c;
            canonical = of_canonical / f32(k);
        }
        let targets = pair_of(target_of(inputs, i, sample), target_of(inputs, 0u, sample));
        let of_neighbor = scale * targets.x;
        let of_own = canonical * targets.y;
        let both = of_neighbor + of_own;
        if sample == 0u {
            // Where neither can draw it the canonical sample keeps the pair.
            sum += weight * select(1.0, of_own / both, both > 0.0);
        } else {
            sum += weight * select(0.0, of_neighbor / both, both > 0.0);
        }
    }
    if sample == 0u {
        sum += select(0.0, of_canonical / total, kind == MIS_DEFENSIVE_PAIRWISE);
        sum += select(0.0, 1.0 / f32(k + 1u), gris);
    }
    return sum;
}

// (the neighbor's target, the canonical one), relative to the greater: confidence times a huge target would overflow.
fn relative_pair(neighbor: f32, canonical: f32) -> vec2<f32> {
    let greater = max(neighbor, canonical);
    return select(vec2<f32>(0.0), vec2<f32>(neighbor, canonical) / greater, greater > 0.0);
}

// PLANT_*: an error that only tests define, and must find.
#ifdef PLANT_SWAPPED_MIS
fn pair_of(neighbor: f32, canonical: f32) -> vec2<f32> {
    return relative_pair(canonical, neighbor);
}
#else
fn pair_of(neighbor: f32, canonical: f32) -> vec2<f32> {
    return relative_pair(neighbor, canonical);
}
#endif
