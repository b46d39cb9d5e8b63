//! Times of passes, from the time spans that the plugin records.

use bevy::{
    diagnostic::{DiagnosticMeasurement, DiagnosticPath, DiagnosticsStore},
    platform::{collections::HashMap, time::Instant},
    prelude::*,
};
use bevy_restir::{Restir, SPAN_PREFIX, pass_names};

/// Times of the counted frames, ms.
#[derive(Default)]
pub struct Times {
    passes: HashMap<&'static str, Vec<f64>>,
    seen: HashMap<&'static str, Instant>,
}

impl Times {
    /// Takes the newest time of every pass, where it is a new one.  GPU times where the device has timestamps, CPU times elsewhere.
    pub fn sample(&mut self, world: &World, settings: &Restir) {
        let store = world.resource::<DiagnosticsStore>();
        for name in pass_names(settings) {
            let newest: Option<&DiagnosticMeasurement> = ["elapsed_gpu", "elapsed_cpu"].iter().find_map(|kind| {
                let path = DiagnosticPath::new(format!("render/{SPAN_PREFIX}{name}/{kind}"));
                store.get(&path).and_then(|d| d.measurement())
            });
            let Some(&DiagnosticMeasurement { time, value }) = newest else { continue };
            if self.seen.insert(name, time) != Some(time) {
                self.passes.entry(name).or_default().push(value);
            }
        }
    }

    /// Forgets what came before the counted frames.
    pub fn clear(&mut self) {
        self.passes.clear();
    }

    /// Times of a pass; none where it did not run.
    pub fn of(&self, pass: &str) -> &[f64] {
        self.passes.get(pass).map_or(&[], Vec::as_slice)
    }
}

/// The middle of some values; 0 of none.
pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}
