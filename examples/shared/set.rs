//! Settings by name, as text.

use bevy::reflect::{GetPath, PartialReflect, ReflectMut, TypeInfo, enums::DynamicEnum};
use bevy_restir::Restir;

/// Sets the field that `PATH=VALUE` names by its reflection path; the error says what is wrong with it.
pub fn set(settings: &mut Restir, assignment: &str) -> Result<(), String> {
    let (path, value) = assignment.split_once('=').ok_or(format!("{assignment}: expected PATH=VALUE"))?;
    let field = settings.reflect_path_mut(path).map_err(|_| format!("{path}: Restir has no such field"))?;
    assign(field, value).map_err(|expected| format!("{path}={value}: expected {expected}"))
}

/// Parses a value into a reflected field; the error says what was expected.
fn assign(field: &mut dyn PartialReflect, value: &str) -> Result<(), String> {
    macro_rules! number {
        ($($type:ty),*) => {
            $(if let Some(field) = field.try_downcast_mut::<$type>() {
                *field = value.parse().map_err(|_| stringify!($type).to_string())?;
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
