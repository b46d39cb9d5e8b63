//! The sections that all programs share.

use bevy::{camera::Exposure, core_pipeline::tonemapping::Tonemapping, prelude::*, reflect::PartialReflect};
use bevy_egui::egui;
use bevy_restir::prelude::*;
use bevy_restir_support::fields;

use super::{
    docs::Docs,
    form::{Form, explain, words_of},
    group,
};
use crate::look::{Look, legend};

/// Presets, exposure, effects, technique and debug view.
pub fn picture(
    InMut(ui): InMut<egui::Ui>,
    docs: Res<Docs>,
    mut cameras: Query<(&mut Restir, &mut Look, &mut Exposure)>,
) {
    for (mut restir, mut look, mut exposure) in &mut cameras {
        presets(ui, &docs, &mut restir);
        tone(ui, &mut look, &mut exposure);
        effects(ui, &mut look);
        shown(ui, &docs, &mut restir);
    }
}

fn presets(ui: &mut egui::Ui, docs: &Docs, restir: &mut Mut<Restir>) {
    ui.horizontal_wrapped(|ui| {
        for preset in fields::values::<Preset>() {
            let mut wanted = Restir::clone(restir);
            fields::apply_preset(&mut wanted, preset);
            let is_taken = wanted == **restir;
            let name = format!("{preset:?}");
            let label = ui.selectable_label(is_taken, &name);
            if label.clicked() {
                restir.set_if_neq(wanted);
            }
            explain(label, docs.of("Preset", &name), None);
        }
    });
}

fn tone(ui: &mut egui::Ui, look: &mut Look, exposure: &mut Exposure) {
    ui.horizontal(|ui| {
        ui.label("EV100");
        ui.add(egui::DragValue::new(&mut exposure.ev100).range(-40.0..=60.0).speed(0.05).max_decimals(2));
        let fit = ui.selectable_label(look.measure_next, "Fit");
        if fit.on_hover_text("Choose the exposure that fits the picture").clicked() {
            look.measure_next = !look.measure_next;
        }
        let list = egui::ComboBox::from_id_salt("curve").width(110.0).truncate();
        list.selected_text(format!("{:?}", look.tonemapping)).show_ui(ui, |ui| {
            for choice in fields::values::<Tonemapping>() {
                ui.selectable_value(&mut look.tonemapping, choice, format!("{choice:?}"));
            }
        });
    });
}

fn effects(ui: &mut egui::Ui, look: &mut Look) {
    ui.horizontal(|ui| {
        ui.toggle_value(&mut look.bloom, "Bloom").on_hover_text("Bright parts of the picture glow");
        ui.toggle_value(&mut look.taa, "TAA").on_hover_text(
            "Bevy's temporal anti-aliasing: less noise, some lag. It needs the whole window, so the panel covers a part of the \
             picture.",
        );
    });
}

fn shown(ui: &mut egui::Ui, docs: &Docs, restir: &mut Mut<Restir>) {
    ui.horizontal(|ui| {
        let mut wanted = Restir::clone(restir);
        let list =
            |name: &str, width| egui::ComboBox::from_id_salt(name.to_string()).width(width).height(420.0).truncate();
        list("technique", 80.0).selected_text(format!("{:?}", wanted.technique)).show_ui(ui, |ui| {
            for choice in fields::values::<Technique>() {
                let name = format!("{choice:?}");
                let line = ui.selectable_value(&mut wanted.technique, choice, &name);
                explain(line, docs.of("Technique", &name), None);
            }
        });
        let before = wanted.clone();
        list("view", 150.0).selected_text(name_of(wanted.debug_view)).show_ui(ui, |ui| {
            for choice in fields::values::<DebugView>().into_iter().filter(|view| view.shows(&before)) {
                let line = ui.selectable_value(&mut wanted.debug_view, choice, name_of(choice));
                explain(line, docs.of("DebugView", &format!("{choice:?}")), None);
            }
        });
        if !wanted.debug_view.shows(&wanted) {
            wanted.debug_view = DebugView::Off;
        }
        restir.set_if_neq(wanted);
    });
    if let Some(legend) = legend(restir) {
        ui.weak(legend);
    }
}

fn name_of(view: DebugView) -> String {
    if view == DebugView::Off { "Light".into() } else { words_of(&format!("{view:?}")) }
}

/// Every field of `Restir`.
pub fn settings(InMut(ui): InMut<egui::Ui>, docs: Res<Docs>, mut cameras: Query<&mut Restir>) {
    for mut restir in &mut cameras {
        group(ui, "Settings", false, |ui| {
            let before = Restir::clone(&restir);
            let mut wanted = before.clone();
            let defaults = Restir::default();
            let range = |path: &str| fields::range(&before, path);
            let mut form = Form::new(&docs, &range);
            form.default = Some(&defaults);
            form.show(ui, &mut wanted, "");
            restir.set_if_neq(wanted);
        });
    }
}

/// The sky of the camera.
pub fn environment(
    InMut(ui): InMut<egui::Ui>,
    mut commands: Commands,
    docs: Res<Docs>,
    mut cameras: Query<(Entity, Option<&mut RestirEnvironment>), With<Restir>>,
) {
    for (camera, environment) in &mut cameras {
        group(ui, "Environment", false, |ui| {
            let mut is_present = environment.is_some();
            if ui.checkbox(&mut is_present, "environment").changed() {
                let mut camera = commands.entity(camera);
                let color = LinearRgba::rgb(400.0, 450.0, 500.0);
                match is_present {
                    true => camera.insert(RestirEnvironment { color, ..default() }),
                    false => camera.remove::<RestirEnvironment>(),
                };
            } else if let Some(mut environment) = environment {
                edit_environment(ui, &docs, &mut environment);
            }
        });
    }
}

fn edit_environment(ui: &mut egui::Ui, docs: &Docs, environment: &mut Mut<RestirEnvironment>) {
    let range = |path: &str| (path == "intensity").then_some([0.0, 1e6]);
    let mut wanted = RestirEnvironment::clone(environment);
    let defaults = RestirEnvironment::default();
    let mut form = Form::new(docs, &range);
    form.default = Some(&defaults);
    form.show(ui, wanted.as_partial_reflect_mut(), "");
    ui.horizontal(|ui| match wanted.image {
        Some(_) => {
            ui.label("image");
            if ui.button("remove").clicked() {
                wanted.image = None;
            }
        }
        None => _ = ui.weak("a uniform sky"),
    });
    environment.set_if_neq(wanted);
}
