//! The fields of `Restir`, found by reflection: whatever is added to it can be seen and changed here.

use bevy::reflect::{FromReflect, GetPath, PartialReflect, ReflectMut, ReflectRef, TypeInfo, enums::DynamicEnum};
use bevy_restir::{Preset, Restir};

/// Paths of all values, in the order of the structs.
pub fn paths() -> Vec<String> {
    let mut paths = Vec::new();
    collect(&Restir::default(), String::new(), &mut paths);
    paths
}

fn collect(value: &dyn PartialReflect, path: String, paths: &mut Vec<String>) {
    let ReflectRef::Struct(fields) = value.reflect_ref() else {
        paths.push(path);
        return;
    };
    for (i, field) in fields.iter_fields().enumerate() {
        collect(field.1, join(&path, fields.name_at(i).unwrap_or_default()), paths);
    }
}

/// The path of a field of what is at `path`.
pub fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.into() } else { format!("{path}.{name}") }
}

/// The value at a path, as text.
pub fn shown(settings: &Restir, path: &str) -> String {
    settings.reflect_path(path).map_or_else(|error| error.to_string(), |field| format!("{field:?}"))
}

/// One step up or down; what is then out of range is brought back.
pub fn change(settings: &mut Restir, path: &str, up: bool) {
    if let Ok(field) = settings.reflect_path_mut(path) {
        step(field, up);
    }
    settings.validate();
}

/// The next view, or the one before, that shows something of the technique.
pub fn next_view(settings: &mut Restir, up: bool) {
    loop {
        step(&mut settings.debug_view, up);
        if settings.debug_view.shows(settings.technique) {
            return;
        }
    }
}

/// The value that `from` has.
pub fn copy(settings: &mut Restir, path: &str, from: &Restir) {
    if let (Ok(field), Ok(value)) = (settings.reflect_path_mut(path), from.reflect_path(path)) {
        // Of one type, so that it cannot fail.
        let _ = field.try_apply(value);
    }
}

/// A preset, with the technique and the view that are shown.
pub fn take(settings: &mut Restir, preset: Preset) {
    let Restir { technique, debug_view, debug_scale, .. } = *settings;
    *settings = Restir { technique, debug_view, debug_scale, ..Restir::preset(preset) };
}

/// Every value of an enum without data.
pub fn values<E: FromReflect + bevy::reflect::Typed>() -> Vec<E> {
    let TypeInfo::Enum(info) = E::type_info() else { return Vec::new() };
    info.variant_names().iter().filter_map(|name| E::from_reflect(&DynamicEnum::new(*name, ()))).collect()
}

/// Names that an enum can have, and the index of the one that it has.
pub fn choices(field: &dyn PartialReflect) -> Option<(&'static [&'static str], usize)> {
    let (ReflectRef::Enum(value), Some(TypeInfo::Enum(info))) =
        (field.reflect_ref(), field.get_represented_type_info())
    else {
        return None;
    };
    // What a choice with data would hold is not known.
    let units = info.iter().all(|variant| variant.as_unit_variant().is_ok());
    units.then(|| (info.variant_names(), value.variant_index()))
}

/// Makes an enum the choice of that name.
pub fn choose(field: &mut dyn PartialReflect, name: &str) {
    if let ReflectMut::Enum(_) = field.reflect_mut() {
        // Only enums without data are settings.
        let _ = field.try_apply(&DynamicEnum::new(name, ()));
    }
}

fn step(field: &mut dyn PartialReflect, up: bool) {
    if let Some(value) = field.try_downcast_mut::<bool>() {
        *value = !*value;
    } else if let Some(value) = field.try_downcast_mut::<u32>() {
        *value = step_whole(*value, up);
    } else if let Some(value) = field.try_downcast_mut::<f32>() {
        *value = step_number(*value, up);
    } else if let Some((names, i)) = choices(field) {
        let next = if up { i + 1 } else { i + names.len() - 1 } % names.len();
        choose(field, names[next]);
    }
}

/// By one up to 8, then by doubling.
fn step_whole(value: u32, up: bool) -> u32 {
    match (value, up) {
        (0..8, true) => value + 1,
        (0..=8, false) => value.saturating_sub(1),
        (_, true) => value.saturating_mul(2),
        (_, false) => (value / 2).max(8),
    }
}

/// By one of the leading digit: 0.8, 0.9, 1, 2 ... 9, 10, 20; what is less than a hundredth is 0.
fn step_number(value: f32, up: bool) -> f32 {
    const LEAST: f64 = 0.01;
    let (value, towards) = (f64::from(value), if up { 1.0 } else { -1.0 });
    if value.abs() < 0.5 * LEAST {
        return (LEAST * towards) as f32;
    }
    let unit = 10f64.powf((value.abs().log10() + 1e-6).floor());
    let digit = (value.abs() / unit).round();
    let stepped = match value.signum() == towards {
        true => (digit + 1.0) * unit,
        false if digit > 1.0 => (digit - 1.0) * unit,
        false if unit < 1.5 * LEAST => 0.0,
        false => 0.9 * unit,
    };
    stepped.copysign(value) as f32
}

/// Least and most of a number: what `Restir::validate` lets stand.
pub fn range(settings: &Restir, path: &str) -> Option<[f64; 2]> {
    let bound = |number: f64| {
        let mut settings = settings.clone();
        write(settings.reflect_path_mut(path).ok()?, number);
        settings.validate();
        read(settings.reflect_path(path).ok()?)
    };
    Some([bound(f64::MIN)?, bound(f64::MAX)?])
}

fn write(field: &mut dyn PartialReflect, number: f64) {
    if let Some(value) = field.try_downcast_mut::<u32>() {
        *value = number as u32;
    } else if let Some(value) = field.try_downcast_mut::<f32>() {
        *value = number.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
    }
}

fn read(field: &dyn PartialReflect) -> Option<f64> {
    let whole = field.try_downcast_ref::<u32>().map(|&value| f64::from(value));
    whole.or(field.try_downcast_ref::<f32>().map(|&value| f64::from(value)))
}
