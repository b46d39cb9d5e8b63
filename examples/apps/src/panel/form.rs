//! Widgets for any reflected struct: switches, numbers within their valid range, choices, colors and rotations. A nested struct is a
//! group.

use bevy::{
    prelude::*,
    reflect::{PartialReflect, ReflectMut},
};
use bevy_egui::egui;
use bevy_restir_support::fields;

use super::docs::Docs;

/// Width of the names in logical pixels.
const NAMES: f32 = 118.0;
/// Numbers with a range up to this width have a slider.
const SLIDER: f64 = 100.0;

/// Options of the widgets, and the widgets after drawing.
pub struct Form<'a> {
    pub docs: &'a Docs,
    /// The valid range of the number at a path.
    pub range: &'a dyn Fn(&str) -> Option<[f64; 2]>,
    /// Default values. Other values are highlighted; a right click on the name restores the default.
    pub default: Option<&'a dyn PartialReflect>,
    /// Whether groups are open at first.
    pub open: bool,
    /// Paths and responses of the widgets.
    pub widgets: Vec<(String, egui::Response)>,
}

impl<'a> Form<'a> {
    pub fn new(docs: &'a Docs, range: &'a dyn Fn(&str) -> Option<[f64; 2]>) -> Self {
        Self { docs, range, default: None, open: false, widgets: Vec::new() }
    }

    /// Draws widgets for all fields of a struct.
    pub fn show(&mut self, ui: &mut egui::Ui, value: &mut dyn PartialReflect, path: &str) {
        let ty = value.get_represented_type_info().and_then(|info| info.type_path_table().ident());
        let ReflectMut::Struct(group) = value.reflect_mut() else { return };
        for i in 0..group.field_len() {
            let name = group.name_at(i).unwrap_or_default().to_string();
            let path = fields::join(path, &name);
            let doc = ty.and_then(|ty| self.docs.of(ty, &name));
            let default = self.default.and_then(|default| field_of(default, &name));
            let Some(field) = group.field_at_mut(i) else { continue };
            if is_leaf(field) {
                self.row(ui, field, &path, &name, doc, default);
            } else if matches!(field.reflect_mut(), ReflectMut::Struct(_)) {
                let outer = std::mem::replace(&mut self.default, default);
                let header = egui::CollapsingHeader::new(words(&name)).id_salt(&path).default_open(self.open);
                let shown = header.show(ui, |ui| self.show(ui, field, &path));
                explain(shown.header_response, doc, None);
                self.default = outer;
            }
        }
    }

    /// Draws the name of a field and its widget.
    fn row(
        &mut self,
        ui: &mut egui::Ui,
        field: &mut dyn PartialReflect,
        path: &str,
        name: &str,
        doc: Option<&str>,
        default: Option<&dyn PartialReflect>,
    ) {
        let changed = default.is_some_and(|default| default.reflect_partial_eq(field) == Some(false));
        ui.horizontal(|ui| {
            let color = if changed { egui::Color32::from_rgb(255, 205, 105) } else { ui.visuals().text_color() };
            let text = egui::RichText::new(words(name)).color(color);
            let label = egui::Label::new(text).truncate().sense(egui::Sense::click());
            let place = egui::vec2(NAMES, ui.spacing().interact_size.y);
            let aligned = egui::Layout::left_to_right(egui::Align::Center);
            let label = ui.allocate_ui_with_layout(place, aligned, |ui| {
                ui.set_min_width(NAMES);
                ui.add(label)
            });
            let label = label.inner;
            let back = default.filter(|_| changed);
            if let Some(default) = back
                && label.secondary_clicked()
            {
                // Both have one type, so this cannot fail.
                let _ = field.try_apply(default);
            }
            explain(label, doc, back.map(|_| "Right click: the default."));
            let widget = self.widget(ui, field, path);
            self.widgets.push((path.into(), widget));
        });
    }

    fn widget(&self, ui: &mut egui::Ui, field: &mut dyn PartialReflect, path: &str) -> egui::Response {
        if let Some(value) = field.try_downcast_mut::<bool>() {
            return ui.checkbox(value, "");
        }
        let [low, high] = (self.range)(path).unwrap_or([f64::MIN, f64::MAX]);
        let slides = high - low <= SLIDER;
        ui.spacing_mut().slider_width = (ui.available_width() - 64.0).clamp(40.0, 200.0);
        if let Some(value) = field.try_downcast_mut::<u32>() {
            let range = low.max(0.0) as u32..=high as u32;
            let speed = (f64::from(*value) * 0.01).max(0.1);
            return match slides {
                true => ui.add(egui::Slider::new(value, range)),
                false => ui.add(egui::DragValue::new(value).range(range).speed(speed)),
            };
        }
        if let Some(value) = field.try_downcast_mut::<f32>() {
            let range = low as f32..=high as f32;
            return match slides {
                true => ui.add(egui::Slider::new(value, range)),
                false => {
                    let speed = (f64::from(value.abs()) * 0.01).max(1e-4);
                    ui.add(egui::DragValue::new(value).range(range).speed(speed).max_decimals(6))
                }
            };
        }
        if let Some(value) = field.try_downcast_mut::<LinearRgba>() {
            return radiance(ui, value);
        }
        if let Some(value) = field.try_downcast_mut::<Quat>() {
            return turn(ui, value);
        }
        self.choice(ui, field, path)
    }

    fn choice(&self, ui: &mut egui::Ui, field: &mut dyn PartialReflect, path: &str) -> egui::Response {
        let Some((names, chosen)) = fields::choices(field) else { return ui.label("") };
        let ty = field.get_represented_type_info().and_then(|info| info.type_path_table().ident()).unwrap_or_default();
        let mut wanted = chosen;
        let width = (ui.available_width() - 8.0).clamp(60.0, 190.0);
        let list = egui::ComboBox::from_id_salt(path).width(width).truncate().selected_text(words_of(names[chosen]));
        let shown = list.height(400.0).show_ui(ui, |ui| {
            for (i, name) in names.iter().enumerate() {
                let line = ui.selectable_value(&mut wanted, i, words_of(name));
                explain(line, self.docs.of(ty, name), None);
            }
        });
        if wanted != chosen {
            fields::choose(field, names[wanted]);
        }
        explain(shown.response.clone(), self.docs.of(ty, names[chosen]), None);
        shown.response
    }
}

/// Whether a value has a widget.
fn is_leaf(field: &dyn PartialReflect) -> bool {
    let known = |field: &dyn PartialReflect| {
        field.try_downcast_ref::<bool>().is_some()
            || field.try_downcast_ref::<u32>().is_some()
            || field.try_downcast_ref::<f32>().is_some()
            || field.try_downcast_ref::<LinearRgba>().is_some()
            || field.try_downcast_ref::<Quat>().is_some()
    };
    known(field) || fields::choices(field).is_some()
}

fn field_of<'v>(value: &'v dyn PartialReflect, name: &str) -> Option<&'v dyn PartialReflect> {
    value.reflect_ref().as_struct().ok()?.field(name)
}

/// A color and the radiance of its brightest channel.
fn radiance(ui: &mut egui::Ui, value: &mut LinearRgba) -> egui::Response {
    let mut most = value.red.max(value.green).max(value.blue).max(0.0);
    let hue = |c: f32| if most > 0.0 { c / most } else { 1.0 };
    let mut hues = [hue(value.red), hue(value.green), hue(value.blue)];
    let color = ui.color_edit_button_rgb(&mut hues);
    let speed = (f64::from(most) * 0.01).max(1e-3);
    let bright = ui.add(egui::DragValue::new(&mut most).range(0.0..=1e9).speed(speed).suffix(" cd/m²"));
    if color.changed() || bright.changed() {
        *value = LinearRgba::rgb(hues[0] * most, hues[1] * most, hues[2] * most);
    }
    color | bright
}

/// Angles about y, x and z in degrees.
fn turn(ui: &mut egui::Ui, value: &mut Quat) -> egui::Response {
    let (y, x, z) = value.to_euler(EulerRot::YXZ);
    let mut angles = [y, x, z];
    let response = angles.iter_mut().map(|angle| ui.drag_angle(angle)).reduce(|a, b| a | b);
    let response = response.unwrap_or_else(|| ui.label(""));
    if response.changed() {
        *value = Quat::from_euler(EulerRot::YXZ, angles[0], angles[1], angles[2]);
    }
    response
}

/// Shows documentation, and more text below it, while the pointer is over a widget.
pub(super) fn explain(response: egui::Response, doc: Option<&str>, more: Option<&str>) {
    let text: Vec<&str> = doc.into_iter().chain(more).collect();
    if !text.is_empty() {
        response.on_hover_text(text.join("\n"));
    }
}

/// `spatial_samples` becomes `spatial samples`.
fn words(name: &str) -> String {
    name.replace('_', " ")
}

/// `TemporalThenSpatial` becomes `Temporal then spatial`.
pub fn words_of(name: &str) -> String {
    let mut text = String::new();
    for (i, c) in name.char_indices() {
        if i > 0 && c.is_uppercase() {
            text.push(' ');
            text.extend(c.to_lowercase());
        } else {
            text.push(c);
        }
    }
    text
}
