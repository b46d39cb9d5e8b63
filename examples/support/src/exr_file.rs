//! Pictures as .exr files.

use bevy::math::UVec2;
use exr::prelude::{read_first_rgba_layer_from_file, write_rgb_file};
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
        write_rgb_file(part, width, height, |x, y| {
            let [r, g, b] = pixels[y * width + x];
            (r, g, b)
        })
        .map_err(|e| e.to_string())
    })
}
