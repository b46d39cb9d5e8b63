//! The cost of a frame: times of the passes, rays and memory.

use bevy::{
    diagnostic::{DiagnosticsStore, FrameTimeDiagnosticsPlugin},
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use bevy_egui::egui;
use bevy_restir::{Restir, RestirReport, RestirStatistics, pass_names};
use bevy_restir_support::times;

use super::group;

/// Size of the letters in logical pixels.
const SMALL: f32 = 11.5;

/// Shows the cost of the last frame.
pub fn section(
    InMut(ui): InMut<egui::Ui>,
    statistics: Res<RestirStatistics>,
    store: Res<DiagnosticsStore>,
    adapter: Option<Res<RenderAdapterInfo>>,
    cameras: Query<(&Camera, &Restir)>,
) {
    for (camera, settings) in &cameras {
        let pixels = camera.physical_viewport_size().unwrap_or(UVec2::ONE);
        let report = statistics.report();
        group(ui, "Cost", true, |ui| {
            if let Some(adapter) = &adapter {
                ui.add(egui::Label::new(format!("{}, {} rays", adapter.name, report.backend)).truncate());
            }
            table(ui, "numbers", figures(&store, settings, &report, pixels));
            ui.add(egui::Label::new(egui::RichText::new(state(&report)).size(SMALL)).wrap());
            egui::CollapsingHeader::new("memory").show(ui, |ui| {
                let bytes =
                    report.memory.iter().map(|(name, bytes)| (name.to_string(), format!("{} MiB", mib(*bytes))));
                table(ui, "memory", bytes.collect());
            });
            egui::CollapsingHeader::new("pipelines").show(ui, |ui| {
                let ms = report.pipelines.iter().map(|p| (p.name.to_string(), format!("{:.0} ms", p.compile_ms)));
                table(ui, "pipelines", ms.collect());
            });
        });
    }
}

/// The figures of the section in one line, for a terminal.
pub fn summary(store: &DiagnosticsStore, settings: &Restir, report: &RestirReport, pixels: UVec2) -> String {
    let figures = figures(store, settings, report, pixels);
    figures.iter().map(|(name, value)| format!("{}: {value}", name.trim())).collect::<Vec<_>>().join(", ")
}

fn figures(store: &DiagnosticsStore, settings: &Restir, report: &RestirReport, pixels: UVec2) -> Vec<(String, String)> {
    let frame = store.get(&FrameTimeDiagnosticsPlugin::FRAME_TIME).and_then(|d| d.smoothed()).unwrap_or(0.0);
    let fps = 1000.0 / frame.max(1e-3);
    let rays = report.rays as f64 / f64::from(pixels.x * pixels.y);
    let bytes: u64 = report.memory.iter().map(|(_, bytes)| bytes).sum();
    let mut figures = vec![
        ("picture".to_string(), format!("{} x {}", pixels.x, pixels.y)),
        ("frame".into(), format!("{frame:.1} ms, {fps:.1} fps")),
    ];
    let passes = passes(store, settings, report).into_iter();
    figures.extend(passes.map(|(name, ms, unit)| (format!("    {name}"), format!("{ms:.2} {unit}"))));
    figures.extend([
        ("samples".into(), grouped(u64::from(report.samples))),
        ("rays per frame".into(), grouped(report.rays)),
        ("rays per pixel".into(), format!("{rays:.2}")),
        ("lights".into(), grouped(report.lights)),
        ("triangles".into(), grouped(report.triangles)),
        ("instances".into(), grouped(report.instances)),
        ("memory".into(), format!("{} MiB", mib(bytes))),
        ("upload per frame".into(), format!("{} MiB", mib(report.uploaded_bytes))),
        ("reservoirs".into(), format!("{} bytes per pixel", report.reservoir_bytes_per_pixel)),
    ]);
    figures
}

fn state(report: &RestirReport) -> String {
    match (report.ready, report.overflow_flags, report.non_finite_pixels) {
        (false, ..) => "loading and compiling ...".to_string(),
        (true, 0, 0) => "features in use: ".to_string() + &report.features.names().join(", ").to_lowercase(),
        (true, flags, pixels) => format!("overflow flags: {flags}, pixels that are not finite: {pixels}"),
    }
}

/// Names, times and units of the passes: GPU times where the device has timestamps, else CPU times.
fn passes(
    store: &DiagnosticsStore,
    settings: &Restir,
    report: &RestirReport,
) -> Vec<(&'static str, f64, &'static str)> {
    let time = |name: &'static str| {
        let (diagnostic, is_gpu) = times::measured(store, name)?;
        Some((name, diagnostic.smoothed()?, if is_gpu { "ms" } else { "ms (CPU)" }))
    };
    pass_names(settings, report.features).into_iter().filter_map(time).collect()
}

fn mib(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / f64::from(1 << 20))
}

/// Digits in groups of three.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<_> = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy).collect();
    groups.join(" ")
}

fn table(ui: &mut egui::Ui, name: &str, lines: Vec<(String, String)>) {
    egui::Grid::new(name).num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
        for (name, value) in lines {
            ui.label(egui::RichText::new(name).size(SMALL));
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.label(egui::RichText::new(value).size(SMALL))
            });
            ui.end_row();
        }
    });
}
