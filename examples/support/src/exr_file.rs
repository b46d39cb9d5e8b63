//! Pictures as .exr files.

use bevy::math::UVec2;
use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage, read_first_rgba_layer_from_file};
use std::path::Path;

use crate::files::complete;

/// Reads the size and linear RGBA, rows from the top. The error names the file.
pub fn read(path: &Path) -> Result<(UVec2, Vec<[f32; 4]>), String> {
    let read = read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0.0f32; 4]; size.width() * size.height()]),
        |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
    )
    .map_err(|e| format!("{}: {e}", path.display()))?;
    let size = read.layer_data.size;
    let (_, pixels) = read.layer_data.channel_data.pixels;
    Ok((UVec2::new(size.width() as u32, size.height() as u32), pixels))
}

/// Writes linear radiance as 32-bit float RGB.
pub fn write(path: &Path, size: UVec2, pixels: &[[f32; 3]]) -> Result<(), String> {
    let (width, height) = (size.x as usize, size.y as usize);
    complete(path, |part| {
        let channels = SpecificChannels::rgb(|Vec2(x, y)| {
            let [r, g, b] = pixels[y * width + x];
            (r, g, b)
        });
        // Parallel compression writes the tiles in any order, but equal pictures must be equal files.
        let image = Image::from_channels((width, height), channels);
        image.write().non_parallel().to_file(part).map_err(|e| e.to_string())
    })
}
