//! Pictures as files.

use bevy::math::UVec2;
use exr::prelude::write_rgb_file;
use std::path::Path;

use crate::headless::files::complete;

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
