//! Resampling MIS weights by their formulas, for every input of a pixel at one of its samples.  `p[i]` is the target of domain i at the
//! sample, in the measure of the canonical domain 0; `c[i]` is its confidence.

use bevy_restir::testing::gpu_layout::*;

/// The weight of input `j`.
pub fn weight(kind: u32, c: &[f64], p: &[f64], j: usize) -> f64 {
    let k = c.len() - 1;
    let all: f64 = c.iter().sum();
    let of = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    match kind {
        MIS_UNIFORM => c[j] / all,
        MIS_ONE_OVER_Z => {
            let could = |i: usize| if p[i] > 0.0 { c[i] } else { 0.0 };
            of(could(j), (0..=k).map(could).sum())
        }
        MIS_BALANCE => of(c[j] * p[j], (0..=k).map(|i| c[i] * p[i]).sum()),
        _ if all == c[0] => f64::from(u8::from(j == 0)),
        _ => {
            // The outer weight of a pair, the factors of its two targets, and the share of the canonical input.
            let others = all - c[0];
            let (pair, neighbor, canonical, kept): (Box<dyn Fn(usize) -> f64>, Box<dyn Fn(usize) -> f64>, f64, f64) =
                match kind {
                    MIS_PAIRWISE => (Box::new(move |i| of(c[i], others)), Box::new(move |_| others), c[0], 0.0),
                    MIS_DEFENSIVE_PAIRWISE => {
                        (Box::new(move |i| c[i] / all), Box::new(move |_| others), c[0], c[0] / all)
                    }
                    _ => {
                        let n = (k + 1) as f64;
                        (Box::new(move |_| 1.0 / n), Box::new(|i| c[i]), c[0] / k as f64, 1.0 / n)
                    }
                };
            let share = |i: usize| {
                let (a, b) = (neighbor(i) * p[i], canonical * p[0]);
                if a + b > 0.0 { (a / (a + b), b / (a + b)) } else { (0.0, 1.0) }
            };
            if j > 0 {
                return pair(j) * share(j).0;
            }
            kept + (1..=k).map(|i| pair(i) * share(i).1).sum::<f64>()
        }
    }
}
