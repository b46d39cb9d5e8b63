//! The fields of `Restir` by name. Reflection finds them, so a new field needs no code here.

use bevy::reflect::{FromReflect, GetPath, PartialReflect, ReflectMut, ReflectRef, TypeInfo, enums::DynamicEnum};
use bevy_restir::{DebugView, Preset, Restir};

/// Paths of all leaf fields, in the order of the structs.
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

/// The path of the field `name` of the struct at `path`.
pub fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.into() } else { format!("{path}.{name}") }
}

/// The value at a path, as text.
pub fn shown(settings: &Restir, path: &str) -> String {
    settings.reflect_path(path).map_or_else(|error| error.to_string(), |field| format!("{field:?}"))
}

/// The value at a path as an expression of Rust.
pub fn expression(settings: &Restir, path: &str) -> String {
    let Ok(field) = settings.reflect_path(path) else { return String::new() };
    match field.get_represented_type_info() {
        Some(TypeInfo::Enum(info)) => format!("{}::{field:?}", info.type_path_table().short_path()),
        _ => format!("{field:?}"),
    }
}

/// Steps a field up or down and clamps it to its valid range.
pub fn change(settings: &mut Restir, path: &str, up: bool) {
    if let Ok(field) = settings.reflect_path_mut(path) {
        step(field, up);
    }
    settings.validate();
}

/// Steps the debug view up or down to the next one that the technique supports.
pub fn next_view(settings: &mut Restir, up: bool) {
    loop {
        step(&mut settings.debug_view, up);
        if settings.debug_view.shows(settings) {
            return;
        }
    }
}

/// Steps the technique up or down, and leaves a debug view that the new technique does not support.
pub fn next_technique(settings: &mut Restir, up: bool) {
    step(&mut settings.technique, up);
    if !settings.debug_view.shows(settings) {
        settings.debug_view = DebugView::Off;
    }
}

/// Applies a preset, and keeps the fields that presets do not set.
pub fn apply_preset(settings: &mut Restir, preset: Preset) {
    *settings = settings.clone().with_preset(preset);
}

/// Every value of an enum without data.
pub fn values<E: FromReflect + bevy::reflect::Typed>() -> Vec<E> {
    let TypeInfo::Enum(info) = E::type_info() else { return Vec::new() };
    info.variant_names().iter().filter_map(|name| E::from_reflect(&DynamicEnum::new(*name, ()))).collect()
}

/// Names of all variants of an enum, and the index of the current one. `None` for anything else, and for enums with data.
pub fn choices(field: &dyn PartialReflect) -> Option<(&'static [&'static str], usize)> {
    let (ReflectRef::Enum(value), Some(TypeInfo::Enum(info))) =
        (field.reflect_ref(), field.get_represented_type_info())
    else {
        return None;
    };
    let units = info.iter().all(|variant| variant.as_unit_variant().is_ok());
    units.then(|| (info.variant_names(), value.variant_index()))
}

/// Sets an enum to the variant of that name.
pub fn choose(field: &mut dyn PartialReflect, name: &str) {
    if let ReflectMut::Enum(_) = field.reflect_mut() {
        // Settings have no enums with data, so this cannot fail.
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

/// Steps by one up to 8, then doubles.
fn step_whole(value: u32, up: bool) -> u32 {
    match (value, up) {
        (0..8, true) => value + 1,
        (0..=8, false) => value.saturating_sub(1),
        (_, true) => value.saturating_mul(2),
        (_, false) => (value / 2).max(8),
    }
}

/// Steps the leading digit by one: 0.8, 0.9, 1, 2 ... 9, 10, 20. Below a hundredth it steps to 0.
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

/// The least and the greatest value of a number that `Restir::validate` leaves unchanged.
pub fn range(settings: &Restir, path: &str) -> Option<[f64; 2]> {
    let bound = |number: f64| {
        let mut settings = settings.clone();
        write(settings.reflect_path_mut(path).ok()?, number);
        settings.validate();
        read(settings.reflect_path(path).ok()?)
    };
    Some([bound(f64::MIN)?, bound(f64::MAX)?])
}

/// Sets a field to a value of its valid range: `at` is from 0 to 1.  Numbers stay near the least value, so that tests remain fast.
pub fn draw(settings: &mut Restir, path: &str, at: f32) {
    /// How far numbers go above their least value.
    const SPAN: f64 = 24.0;
    let range = range(settings, path);
    let Ok(field) = settings.reflect_path_mut(path) else { return };
    if let Some(value) = field.try_downcast_mut::<bool>() {
        *value = at < 0.5;
    } else if let Some((names, _)) = choices(field) {
        choose(field, names[((at * names.len() as f32) as usize).min(names.len() - 1)]);
    } else if let Some([low, high]) = range {
        write(field, low + f64::from(at) * (high - low).min(SPAN));
    }
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

/// Sets a field from `PATH=VALUE`, where the path is its reflection path. The error names the path and what was expected.
pub fn set(settings: &mut Restir, assignment: &str) -> Result<(), String> {
    let (path, value) = assignment.split_once('=').ok_or(format!("{assignment}: expected PATH=VALUE"))?;
    let field = settings.reflect_path_mut(path).map_err(|_| format!("{path}: Restir has no such field"))?;
    assign(field, value).map_err(|expected| format!("{path}={value}: expected {expected}"))
}

/// The path of an assignment `PATH=VALUE`.
pub fn path_of(assignment: &str) -> &str {
    assignment.split_once('=').map_or(assignment, |(path, _)| path)
}

/// Sets fields as [`set`] does.  A number out of its range is an error, because a measurement would have another value than its label.
pub fn set_in_range<'a>(
    settings: &mut Restir,
    assignments: impl IntoIterator<Item = &'a str> + Clone,
) -> Result<(), String> {
    for assignment in assignments.clone() {
        set(settings, assignment)?;
    }
    // Ranges can depend on other fields, so they are known only now.
    assignments.into_iter().try_for_each(|assignment| check_range(settings, path_of(assignment)))
}

/// Fails if [`Restir::validate`] changes the number at a path.
fn check_range(settings: &Restir, path: &str) -> Result<(), String> {
    let Some([low, high]) = range(settings, path) else { return Ok(()) };
    let mut valid = settings.clone();
    valid.validate();
    let [given, used] = [settings, &valid].map(|settings| shown(settings, path));
    if given == used {
        return Ok(());
    }
    let bound = |number: f64| if number.abs() < 1e7 { number.to_string() } else { format!("{number:.2e}") };
    Err(format!("{path}={given} is out of range ({} to {}; the nearest value is {used})", bound(low), bound(high)))
}

/// The name of a type of number in messages.
fn kind_of(name: &str) -> &'static str {
    match name {
        "bool" => "true or false",
        "f32" => "a number",
        _ => "a whole number",
    }
}

/// Parses a value into a reflected field. The error is the expected kind of value.
fn assign(field: &mut dyn PartialReflect, value: &str) -> Result<(), String> {
    macro_rules! number {
        ($($type:ty),*) => {
            $(if let Some(field) = field.try_downcast_mut::<$type>() {
                *field = value.parse().map_err(|_| kind_of(stringify!($type)).to_string())?;
                return Ok(());
            })*
        };
    }
    number!(bool, u32, i32, f32, u64, usize, u8);
    if let ReflectMut::Enum(_) = field.reflect_mut()
        && let Some(TypeInfo::Enum(info)) = field.get_represented_type_info()
    {
        let names = info.variant_names();
        let name = names.iter().find(|name| name.eq_ignore_ascii_case(value)).ok_or(names.join("|"))?;
        return field.try_apply(&DynamicEnum::new(*name, ())).map_err(|e| e.to_string());
    }
    Err("a field that holds one value".into())
}
