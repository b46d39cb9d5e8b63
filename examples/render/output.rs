//! Pictures: read environments, written results.

use bevy::{
    asset::{Assets, RenderAssetUsages},
    color::LinearRgba,
    ecs::world::World,
    image::{CompressedImageFormats, Image, ImageSampler, ImageType},
    math::UVec2,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_restir::RestirEnvironment;
use exr::prelude::{read_first_rgba_layer_from_file, write_rgb_file};
use std::path::Path;

use crate::{args::Environment, headless::files::complete};

/// What surrounds the scene.
pub fn environment(world: &mut World, wanted: Option<&Environment>) -> Result<Option<RestirEnvironment>, String> {
    Ok(match wanted {
        None => None,
        Some(Environment::Uniform([r, g, b])) => {
            Some(RestirEnvironment { color: LinearRgba::rgb(*r, *g, *b), ..Default::default() })
        }
        Some(Environment::File(path)) => {
            let image = world.resource_mut::<Assets<Image>>().add(read_environment(path)?);
            Some(RestirEnvironment { image: Some(image), ..Default::default() })
        }
    })
}

/// An equirectangular image from a .hdr or .exr file.
fn read_environment(path: &Path) -> Result<Image, String> {
    let fail = |what: String| format!("{}: {what}", path.display());
    if path.extension().is_some_and(|e| e == "exr") {
        let read = read_first_rgba_layer_from_file(
            path,
            |size, _| (size.width(), vec![[0.0f32; 4]; size.width() * size.height()]),
            |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
        )
        .map_err(|e| fail(e.to_string()))?;
        let size = read.layer_data.size;
        let (_, pixels) = read.layer_data.channel_data.pixels;
        return Ok(Image::new(
            Extent3d { width: size.width() as u32, height: size.height() as u32, depth_or_array_layers: 1 },
            TextureDimension::D2,
            bytemuck::cast_slice(&pixels).to_vec(),
            TextureFormat::Rgba32Float,
            RenderAssetUsages::RENDER_WORLD,
        ));
    }
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

/// Linear radiance as 32-bit float RGB.
pub fn write_exr(path: &Path, size: UVec2, pixels: &[[f32; 3]]) -> Result<(), String> {
    let (width, height) = (size.x as usize, size.y as usize);
    complete(path, |part| {
        write_rgb_file(part, width, height, |x, y| {
            let [r, g, b] = pixels[y * width + x];
            (r, g, b)
        })
        .map_err(|e| e.to_string())
    })
}

/// What the view target shows.
pub fn write_png(path: &Path, image: Image) -> Result<(), String> {
    let dynamic = image.try_into_dynamic().map_err(|e| e.to_string())?;
    complete(path, |part| dynamic.to_rgb8().save_with_format(part, image::ImageFormat::Png).map_err(|e| e.to_string()))
}
