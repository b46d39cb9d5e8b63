//! The viewer's sections of the panel, and its keys.

use bevy::prelude::*;
use bevy_egui::egui::{
    self,
    text::{CCursor, CCursorRange},
};
use bevy_restir::{RestirStatistics, RestirStatus};
use std::path::PathBuf;

use super::{
    animation::Clips,
    camera::{Eye, Mode},
    light::AddedSky,
    load::{Open, Stage},
};
use crate::panel::keys::PressedKeys;

const NOTE: egui::Color32 = egui::Color32::from_rgb(255, 205, 105);

/// The file, and messages about it.
pub fn file(
    InMut(ui): InMut<egui::Ui>,
    mut typed: Local<String>,
    stage: Res<Stage>,
    statistics: Res<RestirStatistics>,
    status: Res<RestirStatus>,
    added: Query<(), With<AddedSky>>,
    mut open: MessageWriter<Open>,
) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        let opens = ui.button("Open").clicked();
        let hint = egui::TextEdit::singleline(&mut *typed).hint_text("path of a .glb, .gltf, .hdr or .exr");
        let mut text = hint.desired_width(f32::INFINITY).show(ui);
        let line = text.response.response;
        if line.gained_focus() {
            // Typing replaces the old path.
            let whole = CCursorRange::two(CCursor::new(0), CCursor::new(typed.chars().count()));
            text.state.cursor.set_char_range(Some(whole));
            text.state.store(ui.ctx(), line.id);
        }
        let entered = line.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if (opens || entered) && !typed.is_empty() {
            open.write(Open(PathBuf::from(typed.trim())));
        }
    });
    let note = |text: &str| egui::Label::new(egui::RichText::new(text).color(NOTE)).wrap();
    if let Some(scene) = &stage.shown {
        let name = scene.path.file_name().unwrap_or_default().to_string_lossy();
        ui.strong(name).on_hover_text(scene.path.display().to_string());
    } else if stage.line.is_empty() {
        ui.label("Drop a glTF file here.");
    }
    if !stage.line.is_empty() {
        ui.add(note(&stage.line));
    }
    if let RestirStatus::Off(reason) = &*status {
        ui.add(note(&format!("Bevy lights the scene: {reason}")));
    } else if stage.shown.is_some() && !statistics.report().ready {
        ui.weak("building and compiling ...");
    }
    if !added.is_empty() {
        ui.add(note("This file contains little or no light. The viewer adds a sky."));
    }
    ui.separator();
}

/// The mode of the camera.
pub fn view(InMut(ui): InMut<egui::Ui>, stage: Res<Stage>, mut eyes: Query<&mut Eye>) {
    let names: &[(String, Entity)] = stage.shown.as_ref().map_or(&[], |shown| &shown.cameras);
    for mut eye in &mut eyes {
        ui.horizontal(|ui| {
            let chosen = match eye.mode {
                Mode::Orbit => "Orbit".into(),
                Mode::Fly => "Fly".into(),
                Mode::File(i) => names.get(i).map_or_else(String::new, |camera| camera.0.clone()),
            };
            let mut mode = eye.mode;
            egui::ComboBox::from_id_salt("camera").width(150.0).truncate().selected_text(chosen).show_ui(ui, |ui| {
                ui.selectable_value(&mut mode, Mode::Orbit, "Orbit");
                ui.selectable_value(&mut mode, Mode::Fly, "Fly");
                for (i, (name, _)) in names.iter().enumerate() {
                    ui.selectable_value(&mut mode, Mode::File(i), name);
                }
            });
            if mode != eye.mode {
                eye.mode = mode;
            }
            if ui.button("All").on_hover_text("Look at the whole scene (Home)").clicked() {
                look_at_all(&mut eye);
            }
        });
    }
}

fn look_at_all(eye: &mut Eye) {
    eye.frame_scene = true;
    if matches!(eye.mode, Mode::File(_)) {
        eye.mode = Mode::Orbit;
    }
}

/// Clip, play button and time.
pub fn animation(InMut(ui): InMut<egui::Ui>, mut clips: ResMut<Clips>) {
    let Some((name, length, _)) = clips.all.get(clips.chosen).cloned() else { return };
    ui.horizontal(|ui| {
        if ui.button(if clips.playing { "Pause" } else { "Play" }).clicked() {
            clips.playing = !clips.playing;
        }
        let mut chosen = clips.chosen;
        egui::ComboBox::from_id_salt("clip").width(150.0).truncate().selected_text(name).show_ui(ui, |ui| {
            for (i, (name, ..)) in clips.all.iter().enumerate() {
                ui.selectable_value(&mut chosen, i, name);
            }
        });
        if chosen != clips.chosen {
            (clips.chosen, clips.time, clips.seek_requested) = (chosen, 0.0, true);
        }
    });
    let mut time = clips.time;
    ui.scope(|ui| {
        ui.spacing_mut().slider_width = (ui.available_width() - 60.0).max(40.0);
        if ui.add(egui::Slider::new(&mut time, 0.0..=length.max(1e-3)).suffix(" s").max_decimals(2)).changed() {
            (clips.time, clips.seek_requested) = (time, true);
        }
    });
}

pub fn act_on_keys(mut keys: PressedKeys, mut clips: ResMut<Clips>, mut eyes: Query<&mut Eye>) {
    for (key, _) in keys.read() {
        if key == KeyCode::Space {
            clips.playing = !clips.playing;
        }
        for mut eye in &mut eyes {
            match key {
                KeyCode::KeyF => eye.mode = if eye.mode == Mode::Fly { Mode::Orbit } else { Mode::Fly },
                KeyCode::Home => look_at_all(&mut eye),
                _ => {}
            }
        }
    }
}
