//! The panel on the right of the picture, the keys, and the room that it leaves.

use bevy::{
    anti_alias::taa::TemporalAntiAliasing,
    camera::{Exposure, Viewport},
    core_pipeline::tonemapping::Tonemapping,
    diagnostic::DiagnosticsStore,
    ecs::system::SystemParam,
    input::keyboard::{Key, KeyboardInput},
    prelude::*,
    reflect::PartialReflect,
    render::renderer::RenderAdapterInfo,
    window::PrimaryWindow,
};
use bevy_egui::{
    EguiContexts,
    egui::{
        self,
        text::{CCursor, CCursorRange},
    },
    input::egui_wants_any_keyboard_input,
};
use bevy_restir::{RestirStatistics, prelude::*};
use std::path::PathBuf;

use super::{
    animation::Clips,
    camera::{Eye, Mode},
    docs::Docs,
    fields,
    form::{Form, words_of},
    light::LastResort,
    load::{Open, Stage},
    look::{Look, legend},
    stats,
};

/// Logical pixels of its width, at first and at least.
const WIDTH: f32 = 310.0;
const LEAST: f32 = 220.0;
const KEYS: &str = "drag: turn   right drag: move   wheel: nearer\nF: fly (WASD, E, Q; right drag looks)   Home: all\n\
                    Space: play   T, shift T: technique   V, shift V: view\nR: reset   H: hide this   drop a .glb, .gltf, .hdr or .exr";

/// The panel itself.
#[derive(Resource)]
pub struct Panel {
    pub visible: bool,
    /// Logical pixels that it took in the last frame.
    width: f32,
    file: String,
    docs: Docs,
}

impl Default for Panel {
    fn default() -> Self {
        Self { visible: true, width: WIDTH, file: String::new(), docs: Docs::default() }
    }
}

/// What the panel shows besides the camera.
#[derive(SystemParam)]
pub struct Shown<'w> {
    stage: Res<'w, Stage>,
    clips: ResMut<'w, Clips>,
    statistics: Res<'w, RestirStatistics>,
    store: Res<'w, DiagnosticsStore>,
    adapter: Option<Res<'w, RenderAdapterInfo>>,
    open: MessageWriter<'w, Open>,
}

type Cameras<'a> = (
    Entity,
    &'a Camera,
    &'a mut Restir,
    &'a mut Look,
    &'a mut Exposure,
    &'a mut Eye,
    Option<&'a mut RestirEnvironment>,
    Has<LastResort>,
);

pub fn show(
    mut commands: Commands,
    mut contexts: EguiContexts,
    mut panel: ResMut<Panel>,
    mut shown: Shown,
    mut cameras: Query<Cameras>,
) -> Result {
    let Ok(mut camera) = cameras.single_mut() else { return Ok(()) };
    let context = contexts.ctx_mut()?;
    if !panel.visible {
        panel.width = 0.0;
        return Ok(());
    }
    let whole = egui::UiBuilder::new().layer_id(egui::LayerId::background()).max_rect(context.viewport_rect());
    let mut ui = egui::Ui::new(context.clone(), "panel".into(), whole);
    let side = egui::Panel::right("side").default_size(WIDTH).min_size(LEAST);
    let drawn = side.show(&mut ui, |ui| {
        file(ui, &mut panel, &mut shown, camera.7);
        egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
            // Beside its bar.
            ui.set_max_width(ui.available_width() - 12.0);
            view(ui, &shown.stage, &mut camera.5);
            animation(ui, &mut shown.clips);
            picture(ui, &mut camera.2, &mut camera.3, &mut camera.4);
            group(ui, "Settings", false, |ui| settings(ui, &panel.docs, &mut camera.2));
            group(ui, "Environment", false, |ui| {
                environment(ui, &panel.docs, &mut commands, camera.0, camera.6.as_deref_mut());
            });
            let pixels = camera.1.physical_viewport_size().unwrap_or(UVec2::ONE);
            let report = shown.statistics.report();
            group(ui, "Cost", true, |ui| {
                stats::show(ui, &report, &shown.store, &camera.2, pixels, shown.adapter.as_deref());
            });
            ui.add_space(4.0);
            ui.weak(KEYS);
        });
    });
    panel.width = drawn.response.rect.width();
    Ok(())
}

fn group(ui: &mut egui::Ui, name: &str, open: bool, inside: impl FnOnce(&mut egui::Ui)) {
    egui::CollapsingHeader::new(egui::RichText::new(name).strong()).default_open(open).show(ui, inside);
}

/// Which file, and what there is to say about it.
fn file(ui: &mut egui::Ui, panel: &mut Panel, shown: &mut Shown, is_lent: bool) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        let opens = ui.button("Open").clicked();
        let hint = egui::TextEdit::singleline(&mut panel.file).hint_text("path of a .glb, .gltf, .hdr or .exr");
        let mut text = hint.desired_width(f32::INFINITY).show(ui);
        let line = text.response.response;
        if line.gained_focus() {
            // What is typed replaces what was there.
            let whole = CCursorRange::two(CCursor::new(0), CCursor::new(panel.file.chars().count()));
            text.state.cursor.set_char_range(Some(whole));
            text.state.store(ui.ctx(), line.id);
        }
        let entered = line.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
        if (opens || entered) && !panel.file.is_empty() {
            shown.open.write(Open(PathBuf::from(panel.file.trim())));
        }
    });
    let note = egui::Color32::from_rgb(255, 205, 105);
    match (&shown.stage.shown, shown.stage.line.as_str()) {
        (None, "") => _ = ui.label("Drop a glTF file here."),
        (Some(scene), "") => {
            let name = scene.path.file_name().unwrap_or_default().to_string_lossy();
            ui.strong(name).on_hover_text(scene.path.display().to_string());
        }
        (_, line) => _ = ui.add(egui::Label::new(egui::RichText::new(line).color(note)).wrap()),
    }
    if shown.stage.shown.is_some() && !shown.statistics.report().ready {
        ui.weak("building and compiling ...");
    }
    if is_lent {
        let text = "This file has no light to show it by: it is under a sky of the viewer's.";
        ui.add(egui::Label::new(egui::RichText::new(text).color(note)).wrap());
    }
    ui.separator();
}

/// What moves the camera.
fn view(ui: &mut egui::Ui, stage: &Stage, eye: &mut Eye) {
    ui.horizontal(|ui| {
        let names: &[(String, Entity)] = stage.shown.as_ref().map_or(&[], |shown| &shown.cameras);
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
        let frames = ui.button("All").on_hover_text("Look at the whole scene (Home)").clicked();
        if mode != eye.mode {
            eye.mode = mode;
        }
        if frames {
            look_at_all(eye);
        }
    });
}

fn look_at_all(eye: &mut Eye) {
    eye.frames = true;
    if matches!(eye.mode, Mode::File(_)) {
        eye.mode = Mode::Orbit;
    }
}

/// Clip, play and time.
fn animation(ui: &mut egui::Ui, clips: &mut Clips) {
    let Some((name, length, _)) = clips.all.get(clips.chosen).cloned() else { return };
    ui.horizontal(|ui| {
        if ui.button(if clips.plays { "Pause" } else { "Play" }).clicked() {
            clips.plays = !clips.plays;
        }
        let mut chosen = clips.chosen;
        egui::ComboBox::from_id_salt("clip").width(150.0).truncate().selected_text(name).show_ui(ui, |ui| {
            for (i, (name, ..)) in clips.all.iter().enumerate() {
                ui.selectable_value(&mut chosen, i, name);
            }
        });
        if chosen != clips.chosen {
            (clips.chosen, clips.time, clips.sought) = (chosen, 0.0, true);
        }
    });
    let mut time = clips.time;
    ui.spacing_mut().slider_width = (ui.available_width() - 60.0).max(40.0);
    if ui.add(egui::Slider::new(&mut time, 0.0..=length.max(1e-3)).suffix(" s").max_decimals(2)).changed() {
        (clips.time, clips.sought) = (time, true);
    }
    ui.reset_style();
}

/// What is asked for most often.
fn picture(ui: &mut egui::Ui, restir: &mut Mut<Restir>, look: &mut Look, exposure: &mut Exposure) {
    ui.horizontal_wrapped(|ui| {
        for preset in fields::values::<Preset>() {
            let mut wanted = Restir::clone(restir);
            fields::take(&mut wanted, preset);
            let is_taken = wanted == **restir;
            if ui.selectable_label(is_taken, format!("{preset:?}")).clicked() {
                restir.set_if_neq(wanted);
            }
        }
    });
    ui.horizontal(|ui| {
        ui.label("EV100");
        ui.add(egui::DragValue::new(&mut exposure.ev100).range(-40.0..=60.0).speed(0.05).max_decimals(2));
        if ui.selectable_label(look.measures, "Fit").on_hover_text("Expose for what is seen").clicked() {
            look.measures = !look.measures;
        }
        let mut curve = look.tonemapping;
        let list = egui::ComboBox::from_id_salt("curve").width(110.0).truncate();
        list.selected_text(format!("{curve:?}")).show_ui(ui, |ui| {
            for choice in fields::values::<Tonemapping>() {
                ui.selectable_value(&mut curve, choice, format!("{choice:?}"));
            }
        });
        if curve != look.tonemapping {
            look.tonemapping = curve;
        }
    });
    ui.horizontal(|ui| {
        ui.toggle_value(&mut look.glows, "Bloom").on_hover_text("Bright things glow, as in a lens");
        ui.toggle_value(&mut look.smooths, "TAA").on_hover_text(
            "Bevy's temporal anti-aliasing: less noise, and some lag. It draws to whole windows only: the picture goes on \
             behind the panel.",
        );
    });
    ui.horizontal(|ui| {
        let mut wanted = Restir::clone(restir);
        let list =
            |name: &str, width| egui::ComboBox::from_id_salt(name.to_string()).width(width).height(420.0).truncate();
        list("technique", 80.0).selected_text(format!("{:?}", wanted.technique)).show_ui(ui, |ui| {
            for choice in fields::values::<Technique>() {
                ui.selectable_value(&mut wanted.technique, choice, format!("{choice:?}"));
            }
        });
        let shown = if wanted.debug_view == DebugView::Off { "Light".into() } else { name_of(wanted.debug_view) };
        list("view", 150.0).selected_text(shown).show_ui(ui, |ui| {
            for choice in fields::values::<DebugView>().into_iter().filter(|view| view.shows(wanted.technique)) {
                let name = if choice == DebugView::Off { "Light".into() } else { name_of(choice) };
                ui.selectable_value(&mut wanted.debug_view, choice, name);
            }
        });
        if !wanted.debug_view.shows(wanted.technique) {
            wanted.debug_view = DebugView::Off;
        }
        restir.set_if_neq(wanted);
    });
    if let Some(legend) = legend(restir) {
        ui.weak(legend);
    }
}

fn name_of(view: DebugView) -> String {
    words_of(&format!("{view:?}"))
}

/// Every field of `Restir`.
fn settings(ui: &mut egui::Ui, docs: &Docs, restir: &mut Mut<Restir>) {
    let before = Restir::clone(restir);
    let mut wanted = before.clone();
    let defaults = Restir::default();
    let range = |path: &str| fields::range(&before, path);
    let mut form = Form::new(docs, &range);
    form.default = Some(&defaults);
    form.show(ui, &mut wanted, "");
    restir.set_if_neq(wanted);
}

/// The sky of the camera.
fn environment(
    ui: &mut egui::Ui,
    docs: &Docs,
    commands: &mut Commands,
    camera: Entity,
    environment: Option<&mut RestirEnvironment>,
) {
    let mut is_there = environment.is_some();
    if ui.checkbox(&mut is_there, "environment").changed() {
        match is_there {
            true => {
                let color = LinearRgba::rgb(400.0, 450.0, 500.0);
                commands.entity(camera).insert(RestirEnvironment { color, ..default() });
            }
            false => _ = commands.entity(camera).remove::<(RestirEnvironment, LastResort)>(),
        }
        return;
    }
    let Some(environment) = environment else { return };
    let range = |path: &str| (path == "intensity").then_some([0.0, 1e6]);
    let mut wanted = environment.clone();
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
        None => _ = ui.weak("drop or open a .hdr or .exr for an image"),
    });
    if *environment != wanted {
        *environment = wanted;
    }
}

/// Keys, while no text is typed.
pub fn act_on_keys(
    typing: Option<Res<bevy_egui::input::EguiWantsInput>>,
    mut pressed: MessageReader<KeyboardInput>,
    mut panel: ResMut<Panel>,
    mut clips: ResMut<Clips>,
    mut cameras: Query<(&mut Restir, &mut Eye)>,
) {
    if typing.is_some_and(egui_wants_any_keyboard_input) {
        pressed.clear();
        return;
    }
    // Every press counts, also where several come in one long frame.
    for event in pressed.read().filter(|event| event.state.is_pressed() && !event.repeat) {
        match event.key_code {
            KeyCode::KeyH => panel.visible = !panel.visible,
            KeyCode::Space => clips.plays = !clips.plays,
            _ => {}
        }
        // With shift.
        let back = matches!(&event.logical_key, Key::Character(c) if c.chars().all(char::is_uppercase));
        for (mut restir, mut eye) in &mut cameras {
            match event.key_code {
                KeyCode::KeyF => eye.mode = if eye.mode == Mode::Fly { Mode::Orbit } else { Mode::Fly },
                KeyCode::Home => look_at_all(&mut eye),
                KeyCode::KeyT => {
                    fields::change(&mut restir, "technique", !back);
                    if !restir.debug_view.shows(restir.technique) {
                        restir.debug_view = DebugView::Off;
                    }
                }
                KeyCode::KeyV => fields::next_view(&mut restir, !back),
                KeyCode::KeyR => restir.reset = true,
                _ => {}
            }
        }
    }
}

/// The picture takes what the panel leaves of the window; under temporal anti-aliasing, which in Bevy knows no viewports
/// (bevyengine/bevy#16290), all of it.
pub fn leave_room(
    panel: Res<Panel>,
    windows: Query<&Window, With<PrimaryWindow>>,
    mut cameras: Query<(&mut Camera, Has<TemporalAntiAliasing>), With<Eye>>,
) {
    let Ok(window) = windows.single() else { return };
    let size = window.physical_size();
    if size.x == 0 || size.y == 0 {
        return;
    }
    let taken = (panel.width * window.scale_factor()).round() as u32;
    for (mut camera, fills) in &mut cameras {
        let taken = if fills { 0 } else { taken };
        let physical_size = UVec2::new(size.x.saturating_sub(taken).max(1), size.y);
        if camera.viewport.as_ref().is_none_or(|viewport| viewport.physical_size != physical_size) {
            camera.viewport = Some(Viewport { physical_size, ..default() });
        }
    }
}
