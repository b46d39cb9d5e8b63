//! The trade of time for error: which of many measured settings are worth choosing.

/// Errors and times that differ by less than this share count as equal: they are measured, and noise would decide.
const NOISE: f64 = 0.02;

/// Whether a figure is less than another one, by more than noise.
fn is_less(a: f64, b: f64) -> bool {
    a < (1.0 - NOISE) * b
}

/// Time and error of something that was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Milliseconds.
    pub time: f64,
    pub error: f64,
}

impl Point {
    fn is_finite(self) -> bool {
        self.time.is_finite() && self.error.is_finite()
    }
}

/// Indices of the points that no other point beats in both time and error, by time (the Pareto front).  An error counts as less only if it
/// is 2 % less.  Of points whose times and errors both differ by less than that, the first of the list is taken.
pub fn front(points: &[Point]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| points[i].is_finite()).collect();
    order.sort_by(|&a, &b| points[a].time.total_cmp(&points[b].time).then(points[a].error.total_cmp(&points[b].error)));
    let mut front: Vec<usize> = Vec::new();
    for i in order {
        match front.last_mut() {
            Some(last) if !is_less(points[i].error, points[*last].error) => {
                let is_equal =
                    !is_less(points[*last].time, points[i].time) && !is_less(points[*last].error, points[i].error);
                if is_equal && i < *last {
                    *last = i;
                }
            }
            _ => front.push(i),
        }
    }
    front
}

/// The fastest point whose error is at most `budget`.
pub fn fastest_within(points: &[Point], budget: f64) -> Option<usize> {
    let fits = (0..points.len()).filter(|&i| points[i].error <= budget && points[i].time.is_finite());
    fits.min_by(|&a, &b| points[a].time.total_cmp(&points[b].time))
}

/// The most accurate point whose time is at most `budget`.
pub fn best_within(points: &[Point], budget: f64) -> Option<usize> {
    front(points).into_iter().rev().find(|&i| points[i].time <= budget)
}

/// A limit that a frame must keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Budget {
    Error(f64),
    /// Milliseconds.
    Time(f64),
}

impl Budget {
    /// Three errors, the greatest first, and three times, the least first, between both ends of the front of some points.
    pub fn between(points: &[Point]) -> Vec<Self> {
        let front = front(points);
        let (Some(&fastest), Some(&best)) = (front.first(), front.last()) else { return Vec::new() };
        let errors = budgets(points[best].error, points[fastest].error).into_iter().rev().map(Self::Error);
        errors.chain(budgets(points[fastest].time, points[best].time).map(Self::Time)).collect()
    }

    /// The point to recommend.
    pub fn pick(self, points: &[Point]) -> Option<usize> {
        match self {
            Self::Error(error) => fastest_within(points, error),
            Self::Time(time) => best_within(points, time),
        }
    }

    /// The best point by the measured figures, however small its lead.
    pub fn best(self, points: &[Point]) -> Option<usize> {
        let is_within = |point: &Point| match self {
            Self::Error(error) => point.error <= error,
            Self::Time(time) => point.time <= time,
        };
        let within = (0..points.len()).filter(|&i| points[i].is_finite() && is_within(&points[i]));
        within.min_by(|&a, &b| self.cost(points[a]).total_cmp(&self.cost(points[b])))
    }

    /// The figure that should be small within this limit: the time where the error is limited, and the error where the time is.
    pub fn cost(self, point: Point) -> f64 {
        match self {
            Self::Error(_) => point.time,
            Self::Time(_) => point.error,
        }
    }
}

/// Three values that divide the range from `least` to `greatest` evenly on a logarithmic scale, rounded up to two digits.
pub fn budgets(least: f64, greatest: f64) -> [f64; 3] {
    let least = least.max(f64::MIN_POSITIVE);
    [0.25, 0.5, 0.75].map(|share| round_up(least * (greatest / least).max(1.0).powf(share)))
}

/// The least number of two digits that is not below a positive one.
fn round_up(value: f64) -> f64 {
    let unit = 10f64.powf(value.log10().floor() - 1.0);
    // A number that has two digits already must stay, in spite of rounding.
    (value / unit - 1e-9).ceil() * unit
}

/// The error of a curve of points at a time: a power law between neighboring points, and beyond the ends that of the whole curve, because
/// the slope between two neighbors is mostly noise.  `None` for fewer than two points.
pub fn at_time(curve: &[Point], time: f64) -> Option<f64> {
    let mut points: Vec<Point> =
        curve.iter().copied().filter(|p| p.is_finite() && p.time > 0.0 && p.error > 0.0).collect();
    points.sort_by(|a, b| a.time.total_cmp(&b.time).then(a.error.total_cmp(&b.error)));
    // Of points with equal times only the best counts, because the power law between them would be infinitely steep.
    points.dedup_by(|next, kept| next.time == kept.time);
    let [first, .., last] = points.as_slice() else { return None };
    let (start, [a, b]) = match points.iter().position(|p| p.time >= time) {
        Some(0) => (first, [first, last]),
        Some(after) => (&points[after - 1], [&points[after - 1], &points[after]]),
        None => (last, [first, last]),
    };
    let slope = (b.error / a.error).ln() / (b.time / a.time).ln();
    Some(start.error * (time / start.time).powf(slope))
}
