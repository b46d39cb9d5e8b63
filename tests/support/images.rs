//! Images for materials, skies and cameras.

use bevy::{
    asset::RenderAssetUsages,
    prelude::*,
    render::render_resource::{
        Extent3d, TextureDimension, TextureFormat, TextureUsages, TextureViewDescriptor, TextureViewDimension,
    },
};

/// An image of 8-bit sRGB texels with nearest filtering.
pub fn texture(width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> Image {
    let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).flat_map(|(x, y)| texel(x, y)).collect();
    let mut image = Image::new(
        Extent3d { width, height, depth_or_array_layers: 1 },
        TextureDimension::D2,
        data,
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::all(),
    );
    image.sampler = bevy::image::ImageSampler::nearest();
    image
}

/// A cube map of one gray value.
pub fn cube_texture(value: u8) -> Image {
    let mut image = texture(2, 12, |_, _| [value, value, value, 255]);
    image.reinterpret_stacked_2d_as_array(6).expect("six faces");
    image.texture_view_descriptor =
        Some(TextureViewDescriptor { dimension: Some(TextureViewDimension::Cube), ..default() });
    image
}

/// An image with mip levels of its own: the bytes of each level, from the finest on.
pub fn image_with_levels(format: TextureFormat, width: u32, height: u32, levels: &[Vec<u8>]) -> Image {
    let mut image = texture(width, height, |_, _| [0; 4]);
    image.texture_descriptor.format = format;
    image.texture_descriptor.mip_level_count = levels.len() as u32;
    image.data = Some(levels.concat());
    // If the usage allowed writes, Bevy would upload the finest level only.
    image.texture_descriptor.usage = TextureUsages::TEXTURE_BINDING;
    image.sampler = bevy::image::ImageSampler::linear();
    image
}

/// An image that a camera can render to and that can be read back.
pub fn target_image(size: UVec2) -> Image {
    target_of(TextureFormat::Rgba8UnormSrgb, size)
}

/// Like [`target_image`], with linear values in full precision; cameras write those of their half-float pictures.
pub fn float_target(size: UVec2) -> Image {
    target_of(TextureFormat::Rgba32Float, size)
}

fn target_of(format: TextureFormat, size: UVec2) -> Image {
    let mut image = Image::new_target_texture(size.x, size.y, format, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    image.asset_usage = RenderAssetUsages::all();
    image
}
