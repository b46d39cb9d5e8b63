//! Pictures beside each other in one file.

use bevy::{
    asset::RenderAssetUsages,
    image::Image,
    math::UVec2,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_restir_support::exposure::measure;

use crate::error::Picture;

/// Width of the lines between the panels in pixels.
const LINE: usize = 4;

/// The factor that shows the logarithmic mean of a picture's luminance as middle gray.
pub fn exposure_for(size: UVec2, picture: &Picture) -> f64 {
    let pixels = picture.iter().map(|p| p.map(|c| c as f32));
    measure(size, pixels).luminance.map_or(1.0, |luminance| 0.18 / f64::from(luminance))
}

/// Panels in rows from left to right.  Small ones are enlarged without smoothing, until the whole picture has `least_width` pixels.
pub fn grid(size: UVec2, columns: usize, panels: &[&Picture], exposure: f64, least_width: usize) -> Image {
    let (width, height) = (size.x as usize, size.y as usize);
    let zoom = least_width.div_ceil(columns * width);
    let panel = [zoom * width, zoom * height];
    let whole = [(panel[0], columns), (panel[1], panels.len().div_ceil(columns))]
        .map(|(size, count)| count * size + (count - 1) * LINE);
    let mut bytes = vec![255u8; 4 * whole[0] * whole[1]];
    for (i, pixels) in panels.iter().enumerate() {
        let corner = [i % columns * (panel[0] + LINE), i / columns * (panel[1] + LINE)];
        for (x, y) in (0..panel[1]).flat_map(|y| (0..panel[0]).map(move |x| (x, y))) {
            let pixel = pixels[y / zoom * width + x / zoom];
            let first = 4 * ((corner[1] + y) * whole[0] + corner[0] + x);
            bytes[first..first + 3].copy_from_slice(&pixel.map(|c| tonemapped(c * exposure)));
        }
    }
    let extent = Extent3d { width: whole[0] as u32, height: whole[1] as u32, depth_or_array_layers: 1 };
    Image::new(extent, TextureDimension::D2, bytes, TextureFormat::Rgba8UnormSrgb, RenderAssetUsages::MAIN_WORLD)
}

/// A picture beside four times its error, exposed by the converged picture.
pub fn with_error(size: UVec2, picture: &Picture, truth: &Picture) -> Image {
    let error: Picture =
        picture.iter().zip(truth).map(|(p, t)| core::array::from_fn(|i| 4.0 * (p[i] - t[i]).abs())).collect();
    grid(size, 2, &[picture, &error], exposure_for(size, truth), 1)
}

/// A channel of a pixel on an sRGB screen: linear in the dark, saturating smoothly.
fn tonemapped(channel: f64) -> u8 {
    let linear = 1.0 - (-1.2 * channel.max(0.0)).exp();
    let encoded = if linear <= 0.0031308 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}
