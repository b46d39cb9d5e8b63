//! What a frame costs, over the picture and at the end.

use bevy::{diagnostic::DiagnosticsStore, prelude::*, render::renderer::RenderAdapterInfo};
use bevy_restir::{Restir, RestirReport, RestirStatistics};
use std::fmt::Write;

use crate::numbers::{frame_ms, passes, scene};

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
    let ms = frame_ms(&store);
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

/// The same in two lines.
pub fn summary(store: &DiagnosticsStore, settings: &Restir, report: &RestirReport, pixels: UVec2) -> String {
    let passes: Vec<_> =
        passes(store, settings).into_iter().map(|(name, ms, unit)| format!("{name}: {ms:.2} {unit}")).collect();
    let scene = scene(report, pixels).map(|(name, value)| format!("{name}: {value}"));
    format!("{}\n{}", passes.join(", "), scene.join(", "))
}
