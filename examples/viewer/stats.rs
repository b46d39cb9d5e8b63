//! What a frame costs and what the plugin holds, in the panel.

use bevy::{diagnostic::DiagnosticsStore, math::UVec2, render::renderer::RenderAdapterInfo};
use bevy_egui::egui;
use bevy_restir::{Restir, RestirReport};

use super::numbers::{frame_ms, grouped, mib, passes, scene};

/// Logical pixels of its letters.
const SMALL: f32 = 11.5;

pub fn show(
    ui: &mut egui::Ui,
    report: &RestirReport,
    store: &DiagnosticsStore,
    settings: &Restir,
    pixels: UVec2,
    adapter: Option<&RenderAdapterInfo>,
) {
    if let Some(adapter) = adapter {
        ui.add(egui::Label::new(format!("{}, {} rays", adapter.name, report.backend)).truncate());
    }
    let ms = frame_ms(store);
    let fps = 1000.0 / ms.max(1e-3);
    let mut lines = vec![
        ("picture".to_string(), format!("{} x {}", pixels.x, pixels.y)),
        ("frame".into(), format!("{ms:.1} ms, {fps:.1} fps")),
    ];
    let times =
        passes(store, settings).into_iter().map(|(name, ms, unit)| (format!("    {name}"), format!("{ms:.2} {unit}")));
    lines.extend(times);
    lines.push(("samples".into(), grouped(u64::from(report.samples))));
    lines.push(("rays a frame".into(), grouped(report.rays)));
    lines.extend(scene(report, pixels).map(|(name, value)| (name.to_string(), value)));
    table(ui, "numbers", lines);
    let state = match (report.ready, report.overflow_flags, report.non_finite_pixels) {
        (false, ..) => "loading and compiling ...".to_string(),
        (true, 0, 0) => "features in use: ".to_string() + &report.features.names().join(", ").to_lowercase(),
        (true, flags, pixels) => format!("overflow flags {flags}, {pixels} pixels not finite"),
    };
    ui.add(egui::Label::new(egui::RichText::new(state).size(SMALL)).wrap());
    egui::CollapsingHeader::new("memory").show(ui, |ui| {
        let bytes = report.memory.iter().map(|(name, bytes)| (name.to_string(), format!("{} MiB", mib(*bytes))));
        table(ui, "memory", bytes.collect());
    });
    egui::CollapsingHeader::new("pipelines").show(ui, |ui| {
        let ms = report.pipelines.iter().map(|p| (p.name.to_string(), format!("{:.0} ms", p.compile_ms)));
        table(ui, "pipelines", ms.collect());
    });
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
