//! What a frame costs, as text: measured times of the passes, counted rays, bytes.

use bevy::{
    diagnostic::{DiagnosticPath, DiagnosticsStore, FrameTimeDiagnosticsPlugin},
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_restir::{Restir, RestirReport, RestirStatistics, SPAN_PREFIX, pass_names};
use std::fmt::Write;

/// The text of the numbers.
#[derive(Component)]
pub struct Numbers;

pub fn show(
    store: Res<DiagnosticsStore>,
    statistics: Res<RestirStatistics>,
    adapter: Option<Res<RenderAdapterInfo>>,
    time: Res<Time<Virtual>>,
    cameras: Query<(&Camera, &Restir)>,
    mut texts: Query<&mut Text, With<Numbers>>,
    mut since: Local<f32>,
    real: Res<Time<Real>>,
) {
    // Digits that change in every frame cannot be read.
    *since += real.delta_secs();
    let (Ok((camera, settings)), Ok(mut text)) = (cameras.single(), texts.single_mut()) else { return };
    if *since < 0.25 {
        return;
    }
    *since = 0.0;
    let pixels = camera.physical_target_size().unwrap_or(UVec2::ONE);
    let report = statistics.report();

    let mut lines = format!("{:?}, {} x {}", settings.technique, pixels.x, pixels.y);
    if time.is_paused() {
        lines += ", paused";
    }
    let _ = writeln!(lines, "\n{}\n", adapter.map_or_else(String::new, |a| a.name.clone()));
    let frame = store.get(&FrameTimeDiagnosticsPlugin::FRAME_TIME).and_then(|d| d.smoothed());
    let ms = frame.unwrap_or(0.0);
    let _ = writeln!(lines, "{:<19}{ms:>8.2} ms  {:.1} fps", "frame", 1000.0 / ms.max(1e-3));
    for (name, ms, unit) in passes(&store, settings) {
        let _ = writeln!(lines, "  {name:<17}{ms:>8.2} {unit}");
    }
    lines.push('\n');
    for (name, value) in scene(&report, pixels) {
        let _ = writeln!(lines, "{name:<19}{value:>11}");
    }
    if !report.ready {
        lines += "\nloading and compiling ...\n";
    }
    text.0 = lines.trim_end().into();
}

/// Times of the passes: on the GPU where the device has timestamps, else on the CPU.
fn passes(store: &DiagnosticsStore, settings: &Restir) -> Vec<(&'static str, f64, &'static str)> {
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
fn scene(report: &RestirReport, pixels: UVec2) -> [(&'static str, String); 7] {
    let rays = report.rays as f64 / f64::from(pixels.x * pixels.y);
    let bytes: u64 = report.memory.iter().map(|(_, bytes)| bytes).sum();
    let mib = |bytes: u64| format!("{:.1}", bytes as f64 / f64::from(1 << 20));
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

/// The same in two lines.
pub fn summary(store: &DiagnosticsStore, settings: &Restir, report: &RestirReport, pixels: UVec2) -> String {
    let passes: Vec<_> =
        passes(store, settings).into_iter().map(|(name, ms, unit)| format!("{name}: {ms:.2} {unit}")).collect();
    let scene = scene(report, pixels).map(|(name, value)| format!("{name}: {value}"));
    format!("{}\n{}", passes.join(", "), scene.join(", "))
}

/// Thousands apart.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<_> = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy).collect();
    groups.join(" ")
}
