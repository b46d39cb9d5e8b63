//! The resampling routine in f64 over a space of a few points.  Every random outcome is enumerated, so that expectations are exact: no
//! sample decides whether a kind of weights is unbiased.
//!
//! The model follows Wyman and Panteleev 2021 (3 and 4) and Lin et al. 2022: candidates of each pixel are resampled into a reservoir, and
//! the reservoirs of several pixels are shifted to the first one and resampled there.

/// The functions of one pixel, in one frame, of each point.
#[derive(Clone, Debug)]
pub struct Domain {
    /// The measure of the point in the space of this pixel.  A shift from another pixel has the ratio of both measures as its Jacobian.
    pub measure: Vec<f64>,
    /// The probability of the point as a candidate.
    pub source: Vec<f64>,
    /// The light that the point sends to the pixel, without visibility.
    pub light: Vec<f64>,
    /// The target function, without visibility.
    pub target: Vec<f64>,
    /// Whether the pixel sees the point.
    pub visible: Vec<bool>,
    /// Whether the shift between this pixel and the first one is defined at the point.
    pub shiftable: Vec<bool>,
}

impl Domain {
    /// The integral that resampling estimates.
    pub fn integral(&self) -> f64 {
        let seen = |x: usize| if self.visible[x] { self.light[x] * self.measure[x] } else { 0.0 };
        (0..self.light.len()).map(seen).sum()
    }
}

/// A sample with its contribution weight; `None` has the weight 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reservoir {
    pub point: Option<usize>,
    pub ucw: f64,
    pub confidence: f64,
}

/// The steps that trace rays (`RESAMPLE_*_RAYS` of the shader).
#[derive(Clone, Copy, Debug)]
pub struct Rays {
    /// An occluded candidate is dropped.
    pub candidates: bool,
    /// A sample that is occluded in the first pixel is dropped.
    pub targets: bool,
    /// The targets of MIS weights include visibility.
    pub mis: bool,
    /// Samples are shaded after a test of their visibility.
    pub shading: bool,
    /// The confidence of a dropped sample is dropped, too.
    pub discard: bool,
}

impl Rays {
    /// Rays test candidates, samples of neighbors and MIS weights.
    pub const ALL: Self = Self { candidates: true, targets: true, mis: true, shading: false, discard: false };
    /// Only the samples that are shaded are tested.
    pub const SHADING: Self = Self { candidates: false, targets: false, mis: false, shading: true, discard: false };
}

/// Outcomes with their probabilities.
pub type Outcomes<T> = Vec<(f64, T)>;

/// The weight of input j, from the confidence of each input and the target of each domain at sample j.
pub type Weigh<'a> = &'a dyn Fn(&[f64], &[f64], usize) -> f64;

/// The probability with which a stream of these weights, added in this order, selects each input.
fn selection(weights: &[f64], order: &[usize]) -> Vec<f64> {
    let (mut sum, mut chosen) = (0.0, vec![0.0; weights.len()]);
    for &j in order.iter().filter(|&&j| weights[j] > 0.0) {
        sum += weights[j];
        let share = weights[j] / sum;
        chosen.iter_mut().for_each(|p| *p *= 1.0 - share);
        chosen[j] = share;
    }
    chosen
}

/// The reservoir of a pixel after `count` independent candidates.
pub fn candidates(d: &Domain, count: usize, rays: Rays) -> Outcomes<Reservoir> {
    let points = d.source.len();
    let mut all = Vec::new();
    for mut code in 0..points.pow(count as u32) {
        let drawn: Vec<usize> = (0..count)
            .map(|_| {
                let x = code % points;
                code /= points;
                x
            })
            .collect();
        let probability: f64 = drawn.iter().map(|&x| d.source[x]).product();
        let weight = |&x: &usize| d.target[x] * d.measure[x] / d.source[x] / count as f64;
        let weights: Vec<f64> = drawn.iter().map(weight).collect();
        let sum: f64 = weights.iter().sum();
        let order: Vec<usize> = (0..count).collect();
        let empty = Reservoir { point: None, ucw: 0.0, confidence: 1.0 };
        if sum <= 0.0 {
            all.push((probability, empty));
            continue;
        }
        for (&x, chosen) in drawn.iter().zip(selection(&weights, &order)) {
            let is_seen = d.visible[x] || !rays.candidates;
            let found = Reservoir { point: Some(x), ucw: sum / d.target[x], ..empty };
            all.push((probability * chosen, if is_seen { found } else { empty }));
        }
    }
    all.retain(|(p, _)| *p > 0.0);
    all
}

/// The result of one iteration of reuse.
pub struct Resampled {
    /// The new reservoir of the first pixel.
    pub reservoirs: Outcomes<Reservoir>,
    /// The light of the first pixel where all inputs are shaded by their shares.
    pub all_shaded: f64,
    /// Its expectation where only the selected input is shaded.
    pub selected_shaded: f64,
}

/// Resamples the reservoirs of several pixels into the first one; `order` is the order of the stream.
pub fn reuse(domains: &[&Domain], inputs: &[Reservoir], rays: Rays, weigh: Weigh, order: &[usize]) -> Resampled {
    let first = domains[0];
    let n = domains.len();
    let mut confidence: Vec<f64> = inputs.iter().map(|r| r.confidence).collect();
    let (mut ucw, mut target, mut light) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    // The target of each domain at each sample, in the measure of the first domain.
    let mut targets = vec![vec![0.0; n]; n];
    for (j, input) in inputs.iter().enumerate() {
        let Some(x) = input.point else { continue };
        let to_first = if j == 0 { 1.0 } else { first.measure[x] / domains[j].measure[x] };
        if j > 0 && !domains[j].shiftable[x] {
            continue;
        }
        ucw[j] = input.ucw * to_first;
        let is_seen = first.visible[x] || j == 0 || !rays.targets;
        if !is_seen && first.target[x] > 0.0 && rays.discard {
            (ucw[j], confidence[j]) = (0.0, 0.0);
            continue;
        }
        target[j] = if is_seen { first.target[x] } else { 0.0 };
        let is_lit = is_seen && (first.visible[x] || !rays.shading);
        light[j] = if is_lit { first.light[x] } else { 0.0 };
        for (i, domain) in domains.iter().enumerate() {
            let from_first = domain.measure[x] / first.measure[x];
            let is_seen = domain.visible[x] || i == j || !rays.mis;
            let is_there = i == 0 || domain.shiftable[x];
            targets[j][i] = match i {
                0 => target[j],
                _ if is_seen && is_there => domain.target[x] * from_first,
                _ => 0.0,
            };
        }
    }
    let shares: Vec<f64> =
        (0..n).map(|j| if ucw[j] > 0.0 { weigh(&confidence, &targets[j], j) * ucw[j] } else { 0.0 }).collect();
    let weights: Vec<f64> = (0..n).map(|j| shares[j] * target[j]).collect();
    let sum: f64 = weights.iter().sum();
    let total = confidence.iter().sum();
    let chosen = selection(&weights, order);
    let mut reservoirs = Vec::new();
    let mut selected_shaded = 0.0;
    for j in (0..n).filter(|&j| chosen[j] > 0.0) {
        let selected = Reservoir { point: inputs[j].point, ucw: sum / target[j], confidence: total };
        selected_shaded += chosen[j] * selected.ucw * light[j];
        reservoirs.push((chosen[j], selected));
    }
    if reservoirs.is_empty() {
        reservoirs.push((1.0, Reservoir { point: None, ucw: 0.0, confidence: total }));
    }
    let all_shaded = shares.iter().zip(&light).map(|(share, l)| share * l).sum();
    Resampled { reservoirs, all_shaded, selected_shaded }
}
