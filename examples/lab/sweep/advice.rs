//! The advice of a sweep: the setting to pick for a budget, and how near it is to the best one.

use bevy_restir_support::front::{Budget, Point};

use super::{
    Entry, Sweep,
    eligibility::{is_mostly_bias, share_of_bias},
    report,
};
use crate::table::digits;

/// The setting to pick for some budgets.
pub struct Advice {
    /// The budgets, in words.
    pub budget: String,
    pub pick: String,
    /// Time, error and bias of the pick, and the part of the squared error that is the bias of blocks.
    pub figures: String,
    pub code: String,
}

/// The advice of the first report for a budget, beside the best of all measured settings.
pub struct Judged {
    /// The budget, in words.
    pub budget: String,
    pub pick: String,
    pub best: String,
    /// Time of the pick relative to the best one where the error is limited; where the time is, the same for the error.
    pub ratio: f64,
}

impl Entry {
    /// The part of the squared error that is bias.
    fn share_of_bias(&self) -> f64 {
        share_of_bias(self.record.block_bias, self.errors().rel_mse_trimmed)
    }

    fn is_mostly_bias(&self) -> bool {
        is_mostly_bias([self.record.bias, self.record.bias_error], self.share_of_bias())
    }
}

/// The configurations that can be recommended.
fn eligible(sweep: &Sweep) -> Vec<&Entry> {
    let mut all: Vec<&Entry> = sweep.competitors().collect();
    let has_bounced_light = |m: &&Entry| m.configuration.has_bounced_light(&sweep.shared);
    // Direct light alone is fast and incomplete, and would decide which times and errors are asked for.
    if all.iter().any(has_bounced_light) {
        all.retain(has_bounced_light);
    }
    // They are fast, because they leave light out, and stay wrong however many frames are averaged.
    let is_right = |m: &&Entry| !m.is_mostly_bias();
    if all.iter().any(is_right) {
        all.retain(is_right);
    }
    all
}

fn points(sweep: &Sweep, all: &[&Entry]) -> Vec<Point> {
    all.iter().map(|m| m.point(sweep.by)).collect()
}

/// A budget in words.
fn words(budget: Budget) -> String {
    match budget {
        Budget::Error(error) => format!("error of at most {}", digits(error)),
        Budget::Time(ms) => format!("at most {} ms a frame", digits(ms)),
    }
}

/// The recommended settings: the fastest ones within three errors, and the most accurate ones within three times.
pub fn advice(sweep: &Sweep) -> Vec<Advice> {
    let all = eligible(sweep);
    let points = points(sweep, &all);
    let mut merged: Vec<Advice> = Vec::new();
    for budget in Budget::between(&points) {
        let Some(i) = budget.pick(&points) else { continue };
        let Entry { configuration, record } = all[i];
        let share = 100.0 * all[i].share_of_bias();
        let (budget, pick) = (words(budget), report::name(configuration));
        match merged.iter_mut().find(|known| known.pick == pick) {
            Some(known) if known.budget.ends_with(&budget) => {}
            Some(known) => known.budget += &format!("; {budget}"),
            None => merged.push(Advice {
                budget,
                pick,
                figures: format!(
                    "{} ms, {}, bias {}; the bias of blocks is {share:.0} % of the squared error",
                    digits(points[i].time),
                    digits(points[i].error),
                    report::bias(record)
                ),
                code: configuration.code(&sweep.shared).unwrap_or_default(),
            }),
        }
    }
    merged
}

/// The advice of the first report, judged by all measured settings.  Empty if there are no others.
pub fn judged(sweep: &Sweep) -> Vec<Judged> {
    let all = eligible(sweep);
    let first: Vec<&Entry> = all.iter().copied().filter(|m| m.configuration.is_first).collect();
    if first.len() == all.len() {
        return Vec::new();
    }
    let (every, chosen) = (points(sweep, &all), points(sweep, &first));
    let judge = |budget: Budget| {
        let (pick, best) = (budget.pick(&chosen)?, budget.best(&every)?);
        Some(Judged {
            budget: words(budget),
            pick: report::name(&first[pick].configuration),
            best: report::name(&all[best].configuration),
            ratio: budget.cost(chosen[pick]) / budget.cost(every[best]),
        })
    };
    Budget::between(&chosen).into_iter().filter_map(judge).collect()
}

impl Judged {
    /// A line for the terminal.
    pub fn line(&self) -> String {
        let Self { budget, pick, best, ratio } = self;
        format!("{budget}: {pick} is at {} x the best, {best}", digits(*ratio))
    }
}
