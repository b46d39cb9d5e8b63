//! Environments from command lines and files.

use bevy::{
    asset::{Assets, RenderAssetUsages},
    color::LinearRgba,
    ecs::world::World,
    image::{CompressedImageFormats, Image, ImageSampler, ImageType},
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_restir::RestirEnvironment;
use serde_json::Value;
use std::path::{Path, PathBuf};

use crate::{exr_file, scene::View};

/// Uniform radiance, or an image file.
#[derive(Clone, Debug)]
pub enum Environment {
    Uniform([f32; 3]),
    File(PathBuf),
}

/// Parses R,G,B or the name of a .hdr or .exr file.
pub fn parse(text: &str) -> Result<Environment, String> {
    let numbers: Vec<f32> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    if let [r, g, b] = numbers[..]
        && text.split(',').count() == 3
    {
        return if numbers.iter().all(|n| n.is_finite() && *n >= 0.0) {
            Ok(Environment::Uniform([r, g, b]))
        } else {
            Err("radiance must be finite and not negative".into())
        };
    }
    let path = PathBuf::from(text);
    if is_image(&path) {
        Ok(Environment::File(path))
    } else {
        Err("expected R,G,B or a file that ends in .hdr or .exr".into())
    }
}

/// Whether the name of a file is that of an environment image.
pub fn is_image(path: &Path) -> bool {
    has_extension(path, &["hdr", "exr"])
}

/// Whether the name of a file ends in one of these, in lower or upper case.
pub fn has_extension(path: &Path, wanted: &[&str]) -> bool {
    let extension = path.extension().and_then(|e| e.to_str());
    extension.is_some_and(|extension| wanted.iter().any(|wanted| extension.eq_ignore_ascii_case(wanted)))
}

impl Environment {
    /// Reads its file, if it has one.
    pub fn image(&self) -> Result<Option<Image>, String> {
        match self {
            Self::Uniform(_) => Ok(None),
            Self::File(path) => read(path).map(Some),
        }
    }

    /// The component for the camera. `image`: that of its file.
    pub fn component(&self, world: &mut World, image: Option<Image>) -> RestirEnvironment {
        match self {
            Self::Uniform([r, g, b]) => RestirEnvironment { color: LinearRgba::rgb(*r, *g, *b), ..Default::default() },
            Self::File(_) => {
                let image = image.map(|image| world.resource_mut::<Assets<Image>>().add(image));
                RestirEnvironment { image, ..Default::default() }
            }
        }
    }
}

/// The environment of an entry in `references.json`, as `--env` takes it: three numbers, or the name of a file in the same folder.
pub fn argument_of_reference(entry: &Value, folder: &Path) -> Option<String> {
    match &entry["env"] {
        Value::Null => None,
        Value::String(file) => Some(folder.join(file).to_string_lossy().into_owned()),
        Value::Array(channels) => Some(channels.iter().map(Value::to_string).collect::<Vec<_>>().join(",")),
        other => Some(other.to_string()),
    }
}

/// The environment of an entry in `references.json`.
pub fn of_reference(entry: &Value, folder: &Path) -> Result<Option<Environment>, String> {
    let parsed = argument_of_reference(entry, folder).map(|text| parse(&text)).transpose();
    parsed.map_err(|why| format!("the env {}: {why}", entry["env"]))
}

/// Makes the component for the camera.
pub fn load(world: &mut World, wanted: &Environment) -> Result<RestirEnvironment, String> {
    let image = wanted.image()?;
    Ok(wanted.component(world, image))
}

/// Lights the picture of the camera that renders.
pub fn light(world: &mut World, wanted: &Environment) -> Result<(), String> {
    let environment = load(world, wanted)?;
    let camera = world.resource::<View>().camera;
    world.entity_mut(camera).insert(environment);
    Ok(())
}

/// Reads an equirectangular image from a .hdr or .exr file.
pub fn read(path: &Path) -> Result<Image, String> {
    if has_extension(path, &["exr"]) {
        let (size, pixels) = exr_file::read(path)?;
        return Ok(equirectangular(size.x, size.y, &pixels));
    }
    let fail = |what: String| format!("{}: {what}", path.display());
    let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
    Image::from_buffer(
        &bytes,
        ImageType::Extension("hdr"),
        CompressedImageFormats::NONE,
        false,
        ImageSampler::Default,
        RenderAssetUsages::RENDER_WORLD,
    )
    .map_err(|e| fail(e.to_string()))
}

/// Makes an image of 32-bit linear RGBA radiance, rows from the top.
pub fn equirectangular(width: u32, height: u32, pixels: &[[f32; 4]]) -> Image {
    Image::new(
        Extent3d { width, height, depth_or_array_layers: 1 },
        TextureDimension::D2,
        bytemuck::cast_slice(pixels).to_vec(),
        TextureFormat::Rgba32Float,
        RenderAssetUsages::RENDER_WORLD,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn references_name_three_numbers_or_a_file_beside_them() {
        let read = |env: Value| of_reference(&json!({ "env": env }), Path::new("scenes"));
        assert!(matches!(read(Value::Null), Ok(None)));
        assert!(matches!(read(json!([0.5, 1, 2])), Ok(Some(Environment::Uniform([0.5, 1.0, 2.0])))));
        let file = read(json!("sky.hdr"));
        assert!(matches!(&file, Ok(Some(Environment::File(path))) if path == Path::new("scenes/sky.hdr")), "{file:?}");
        for wrong in [json!([1, 2]), json!([1, 2, -3]), json!("sky.png"), json!(7)] {
            assert!(read(wrong.clone()).is_err(), "{wrong}");
        }
    }
}
