//! What `--stats` writes: measured times, counted rays, bytes of every buffer and texture.

use bevy::{
    diagnostic::{DiagnosticPath, DiagnosticsStore},
    platform::{collections::HashMap, time::Instant},
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_restir::{Restir, RestirStatistics, SPAN_PREFIX, pass_names};
use serde_json::{Value, json};

use crate::args::Args;

/// Times of the counted frames.
#[derive(Default)]
pub struct Times {
    passes: HashMap<&'static str, Vec<f64>>,
    seen: HashMap<&'static str, Instant>,
    pub frames_ms: Vec<f64>,
    pub cpu_ms: Vec<f64>,
}

impl Times {
    /// Takes the newest time of every pass, where it is a new one.  GPU times where the device has timestamps, CPU times elsewhere.
    pub fn sample(&mut self, world: &World, settings: &Restir) {
        let store = world.resource::<DiagnosticsStore>();
        for name in pass_names(settings) {
            let newest = ["elapsed_gpu", "elapsed_cpu"].iter().find_map(|kind| {
                let path = DiagnosticPath::new(format!("render/{SPAN_PREFIX}{name}/{kind}"));
                store.get(&path).and_then(|d| d.measurement().copied_pair())
            });
            let Some((time, value)) = newest else { continue };
            if self.seen.insert(name, time) != Some(time) {
                self.passes.entry(name).or_default().push(value);
            }
        }
    }

    /// Forgets what came before the counted frames.
    pub fn clear(&mut self) {
        *self = Self { seen: core::mem::take(&mut self.seen), ..Default::default() };
    }
}

trait CopiedPair {
    fn copied_pair(self) -> Option<(Instant, f64)>;
}

impl CopiedPair for Option<&bevy::diagnostic::DiagnosticMeasurement> {
    fn copied_pair(self) -> Option<(Instant, f64)> {
        self.map(|m| (m.time, m.value))
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    match sorted.len() {
        0 => 0.0,
        n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
    }
}

/// The contents of the file.
pub fn json(world: &World, args: &Args, settings: &Restir, times: &Times, non_finite: u64) -> Value {
    let report = world.resource::<RestirStatistics>().report();
    let passes: Vec<Value> = pass_names(settings)
        .into_iter()
        .filter_map(|name| {
            let values = times.passes.get(name)?;
            Some(json!({
                "name": name,
                "ms_median": median(values),
                "ms_min": values.iter().copied().fold(f64::INFINITY, f64::min),
                "ms_max": values.iter().copied().fold(0.0, f64::max),
            }))
        })
        .collect();
    let total: u64 = report.memory.iter().map(|(_, bytes)| bytes).sum();
    json!({
        "adapter": world.resource::<RenderAdapterInfo>().name,
        "backend": report.backend,
        "technique": format!("{:?}", settings.technique).to_lowercase(),
        "preset": format!("{:?}", args.preset).to_lowercase(),
        "size": [args.size.x, args.size.y],
        "frames": args.frames,
        "features": report.features.names(),
        "passes": passes,
        "frame_ms_median": median(&times.frames_ms),
        "cpu_ms_median": median(&times.cpu_ms),
        "rays_per_frame": report.rays,
        "memory": {
            "total_bytes": total,
            "reservoir_bytes_per_pixel": report.reservoir_bytes_per_pixel,
            "items": report.memory.iter().map(|(name, bytes)| json!({"name": name, "bytes": bytes})).collect::<Vec<_>>(),
        },
        "pipelines": report.pipelines.iter().map(|p| json!({
            "name": p.name, "defs": p.defs, "compile_ms": p.compile_ms,
        })).collect::<Vec<_>>(),
        "uploaded_bytes_last_frame": report.uploaded_bytes,
        "non_finite_pixels": non_finite + report.non_finite_pixels,
        "overflow_flags": report.overflow_flags,
        "triangles": report.triangles,
        "instances": report.instances,
        "lights": report.lights,
    })
}
