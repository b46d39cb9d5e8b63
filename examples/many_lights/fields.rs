//! The fields of `Restir`, found by reflection: whatever is added to it can be seen and changed here.

use bevy::reflect::{GetPath, PartialReflect, ReflectMut, ReflectRef, TypeInfo, enums::DynamicEnum};
use bevy_restir::Restir;

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
        let name = fields.name_at(i).unwrap_or_default();
        collect(field.1, if path.is_empty() { name.into() } else { format!("{path}.{name}") }, paths);
    }
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

/// The value that `from` has.
pub fn copy(settings: &mut Restir, path: &str, from: &Restir) {
    if let (Ok(field), Ok(value)) = (settings.reflect_path_mut(path), from.reflect_path(path)) {
        // Of one type, so that it cannot fail.
        let _ = field.try_apply(value);
    }
}

fn step(field: &mut dyn PartialReflect, up: bool) {
    if let Some(value) = field.try_downcast_mut::<bool>() {
        *value = !*value;
    } else if let Some(value) = field.try_downcast_mut::<u32>() {
        *value = step_whole(*value, up);
    } else if let Some(value) = field.try_downcast_mut::<f32>() {
        *value = step_number(*value, up);
    } else if let Some(TypeInfo::Enum(info)) = field.get_represented_type_info()
        && let ReflectMut::Enum(value) = field.reflect_mut()
    {
        let (i, names) = (value.variant_index(), info.variant_names());
        let next = if up { i + 1 } else { i + names.len() - 1 } % names.len();
        // Only enums without data are settings.
        let _ = field.try_apply(&DynamicEnum::new(names[next], ()));
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
