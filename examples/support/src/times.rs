//! GPU and CPU times of the plugin's passes.

use bevy::{
    diagnostic::{Diagnostic, DiagnosticMeasurement, DiagnosticPath, DiagnosticsStore},
    platform::{collections::HashMap, time::Instant},
    prelude::*,
};
use bevy_restir::{Restir, RestirStatistics, SPAN_PREFIX, pass_names};

/// The measured times of a pass, and whether they are GPU times. They are CPU times where the device has no timestamps.
pub fn measured<'a>(store: &'a DiagnosticsStore, pass: &str) -> Option<(&'a Diagnostic, bool)> {
    [("elapsed_gpu", true), ("elapsed_cpu", false)].into_iter().find_map(|(kind, is_gpu)| {
        let diagnostic = store.get(&DiagnosticPath::new(format!("render/{SPAN_PREFIX}{pass}/{kind}")))?;
        diagnostic.measurement().map(|_| (diagnostic, is_gpu))
    })
}

/// Times in milliseconds.
#[derive(Default)]
pub struct Times {
    passes: HashMap<&'static str, Vec<f64>>,
    seen: HashMap<&'static str, Instant>,
    has_gpu_times: bool,
}

impl Times {
    /// Records the newest time of every pass unless it was recorded before: GPU times where the device has timestamps, else CPU times.
    pub fn sample(&mut self, world: &World, settings: &Restir) {
        let store = world.resource::<DiagnosticsStore>();
        let features = world.resource::<RestirStatistics>().report().features;
        for name in pass_names(settings, features) {
            let Some((diagnostic, is_gpu)) = measured(store, name) else { continue };
            let Some(&DiagnosticMeasurement { time, value }) = diagnostic.measurement() else { continue };
            self.has_gpu_times |= is_gpu;
            if self.seen.insert(name, time) != Some(time) {
                self.passes.entry(name).or_default().push(value);
            }
        }
    }

    /// Forgets all times recorded so far.
    pub fn clear(&mut self) {
        self.passes.clear();
    }

    /// Whether a GPU time was ever recorded; otherwise all times are CPU times.
    pub fn has_gpu_times(&self) -> bool {
        self.has_gpu_times
    }

    /// The sum of the medians of all passes: the time of a frame.
    pub fn frame(&self) -> f64 {
        self.passes.values().map(|times| median(times)).sum()
    }

    /// Times of a pass; empty where it did not run.
    pub fn of(&self, pass: &str) -> &[f64] {
        self.passes.get(pass).map_or(&[], Vec::as_slice)
    }
}

/// The median, or 0 if there are no values.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}
