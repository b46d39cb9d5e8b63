//! What a frame costs, as text: measured times of the passes, counted rays, bytes.

use bevy::{
    diagnostic::{DiagnosticPath, DiagnosticsStore, FrameTimeDiagnosticsPlugin},
    prelude::*,
};
use bevy_restir::{Restir, RestirReport, SPAN_PREFIX, pass_names};

/// Milliseconds of a frame, smoothed.
pub fn frame_ms(store: &DiagnosticsStore) -> f64 {
    store.get(&FrameTimeDiagnosticsPlugin::FRAME_TIME).and_then(|d| d.smoothed()).unwrap_or(0.0)
}

/// Bytes as mebibytes.
pub fn mib(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / f64::from(1 << 20))
}

/// Times of the passes: on the GPU where the device has timestamps, else on the CPU.
pub fn passes(store: &DiagnosticsStore, settings: &Restir) -> Vec<(&'static str, f64, &'static str)> {
    let kinds = [("elapsed_gpu", "ms"), ("elapsed_cpu", "ms (CPU)")];
    let time = |name| {
        kinds.iter().find_map(|(kind, unit)| {
            let path = DiagnosticPath::new(format!("render/{SPAN_PREFIX}{name}/{kind}"));
            Some((name, store.get(&path)?.smoothed()?, *unit))
        })
    };
    pass_names(settings).into_iter().filter_map(time).collect()
}

/// What the scene holds and a frame traces.
pub fn scene(report: &RestirReport, pixels: UVec2) -> [(&'static str, String); 7] {
    let rays = report.rays as f64 / f64::from(pixels.x * pixels.y);
    let bytes: u64 = report.memory.iter().map(|(_, bytes)| bytes).sum();
    [
        ("rays a pixel", format!("{rays:.2}")),
        ("lights", grouped(report.lights)),
        ("triangles", grouped(report.triangles)),
        ("instances", grouped(report.instances)),
        ("MiB in all", mib(bytes)),
        ("MiB sent a frame", mib(report.uploaded_bytes)),
        ("reservoirs, B/pixel", report.reservoir_bytes_per_pixel.to_string()),
    ]
}

/// Thousands apart.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<_> = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy).collect();
    groups.join(" ")
}
