//! Subsurface scattering from the extras of a glTF material: `{"subsurface": {"mean_free_path": [r, g, b], "weight": w}}`, in meters.

use bevy::{gltf::GltfMaterialExtras, prelude::*};
use bevy_restir::Subsurface;
use serde_json::Value;

/// The component that the extras of a material describe; `None` if they describe none.  Without a weight it is 1.
pub fn from_extras(extras: &str) -> Result<Option<Subsurface>, String> {
    let value: Value =
        serde_json::from_str(extras).map_err(|error| format!("the extras of its material are not JSON: {error}"))?;
    let Some(described) = value.get("subsurface") else { return Ok(None) };
    let number = |value: &Value| value.as_f64().map(|number| number as f32);
    let lengths = described.get("mean_free_path").and_then(Value::as_array);
    let lengths = lengths.and_then(|lengths| lengths.iter().map(number).collect::<Option<Vec<f32>>>());
    let Some([r, g, b]) = lengths.as_deref() else {
        return Err("`subsurface.mean_free_path` in the extras of its material is not a list of three numbers".into());
    };
    let weight = match described.get("weight") {
        None => 1.0,
        Some(weight) => number(weight).ok_or("`subsurface.weight` in the extras of its material is not a number")?,
    };
    Ok(Some(Subsurface { mean_free_path: Vec3::new(*r, *g, *b), weight }))
}

/// Adds the component to meshes whose material describes it, and warns of a description that cannot be read.
pub fn read_extras(mut commands: Commands, added: Query<(Entity, &GltfMaterialExtras), Added<GltfMaterialExtras>>) {
    for (entity, extras) in &added {
        match from_extras(&extras.value) {
            Ok(Some(subsurface)) => {
                commands.entity(entity).insert(subsurface);
            }
            Ok(None) => {}
            Err(reason) => warn!("restir: entity {entity}: {reason}; it is rendered without subsurface scattering"),
        }
    }
}
