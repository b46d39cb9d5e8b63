//! Properties of an image that are read while its pixels are still on the CPU: sampler, encoding in the atlas, and mean color.

use bevy::{
    color::{Color, LinearRgba},
    image::{Image, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    log::warn_once,
    math::{IVec2, UVec2},
    render::{render_resource::*, renderer::RenderDevice, texture::GpuImage},
};

use crate::scene::texture::atlas::Encoding;

/// Whether shaders can read an image as a two-dimensional texture of colors, or as an array of them.
pub(crate) fn is_color_texture(image: &GpuImage, device: &RenderDevice) -> bool {
    let descriptor = &image.texture_descriptor;
    let kind = descriptor.format.sample_type(None, Some(device.features()));
    descriptor.dimension == TextureDimension::D2
        && descriptor.sample_count == 1
        && descriptor.usage.contains(TextureUsages::TEXTURE_BINDING)
        && matches!(kind, Some(TextureSampleType::Float { .. }))
}

pub(super) fn whole_size(image: &GpuImage) -> UVec2 {
    UVec2::new(image.texture_descriptor.size.width, image.texture_descriptor.size.height)
}

/// Size of an image in the atlas.  An image that is larger than a page is divided by an integer, which keeps its aspect ratio; the copy
/// filters it.
pub(super) fn size_in_atlas(image: &GpuImage, page: u32) -> UVec2 {
    let whole = whole_size(image);
    (whole / whole.max_element().div_ceil(page).max(1)).max(UVec2::ONE)
}

/// Flags in bits 16 to 31 of the first word of a slot.  A test holds them equal to those in `shaders/scene/texture.wgsl`.
pub const CLAMP_U: u32 = 0x10000;
pub const MIRROR_U: u32 = 0x20000;
pub const CLAMP_V: u32 = 0x40000;
pub const MIRROR_V: u32 = 0x80000;
pub const NEAREST: u32 = 0x100000;
pub const SRGB: u32 = 0x200000;
pub const SHARED_EXPONENT: u32 = 0x400000;
/// Set by the material: the texture uses the second texture coordinates.
pub const SECOND_UV: u32 = 0x800000;
/// Bit position of the number of mip levels.
pub const LEVELS_SHIFT: u32 = 24;
pub const TWO_COMPONENTS: u32 = 0x2000_0000;
/// The texture is bindless; the low 16 bits are its index in the array.
pub const BINDLESS: u32 = 0x8000_0000;

/// Properties of an image, without its pixels.
#[derive(Clone, Copy)]
pub(super) struct ImageInfo {
    /// Sampler and format flags of a slot.
    pub flags: u32,
    pub encoding: Encoding,
    /// Mean color.  `None` if no material has needed it yet and the main world keeps the pixels.
    pub mean: Option<LinearRgba>,
    /// Changes whenever the pixels do.
    pub version: u64,
}

impl ImageInfo {
    /// `default_sampler`: that of the app's `ImagePlugin`.
    pub(super) fn new(image: &Image, default_sampler: &ImageSamplerDescriptor, has_mean: bool, version: u64) -> Self {
        let sampler = match &image.sampler {
            ImageSampler::Default => default_sampler,
            ImageSampler::Descriptor(descriptor) => descriptor,
        };
        // The format in which Bevy's materials read it.
        let view_format = image.texture_view_descriptor.as_ref().and_then(|view| view.format);
        let format = view_format.unwrap_or(image.texture_descriptor.format);
        let encoding = encoding_of(format);
        let flags = flags_of(sampler, format, encoding);
        Self { flags, encoding, mean: has_mean.then(|| mean_color(image)), version }
    }
}

/// Whether the GPU can write an image of this usage at any time, without notice.
pub(crate) fn is_live(usage: TextureUsages) -> bool {
    usage.intersects(TextureUsages::RENDER_ATTACHMENT | TextureUsages::STORAGE_BINDING)
}

fn encoding_of(format: TextureFormat) -> Encoding {
    use TextureFormat as F;
    match format {
        F::R16Float | F::Rg16Float | F::Rgba16Float | F::R32Float | F::Rg32Float | F::Rgba32Float => {
            Encoding::SharedExponent
        }
        F::Rgb9e5Ufloat | F::Rg11b10Ufloat | F::Bc6hRgbUfloat | F::Bc6hRgbFloat => Encoding::SharedExponent,
        F::Astc { channel: AstcChannel::Hdr, .. } => Encoding::SharedExponent,
        format if format.is_srgb() => Encoding::Srgb,
        _ => Encoding::Linear,
    }
}

/// Warns once about formats that lose precision in the atlas.
pub(super) fn warn_of_lost_bits(format: TextureFormat) {
    use TextureFormat as F;
    if matches!(format, F::R16Unorm | F::Rg16Unorm | F::Rgba16Unorm | F::R16Snorm | F::Rg16Snorm | F::Rgba16Snorm) {
        warn_once!("restir: images with 16-bit channels, such as {format:?}, are reduced to 8 bits per channel");
    }
}

fn flags_of(sampler: &ImageSamplerDescriptor, format: TextureFormat, encoding: Encoding) -> u32 {
    let axis = |mode, clamp, mirror| match mode {
        ImageAddressMode::Repeat => 0,
        ImageAddressMode::MirrorRepeat => mirror,
        ImageAddressMode::ClampToEdge | ImageAddressMode::ClampToBorder => clamp,
    };
    let nearest = if matches!(sampler.mag_filter, ImageFilterMode::Nearest) { NEAREST } else { 0 };
    let encoding = match encoding {
        Encoding::Linear => 0,
        Encoding::Srgb => SRGB,
        Encoding::SharedExponent => SHARED_EXPONENT,
    };
    use TextureFormat::{Bc5RgUnorm, EacRg11Unorm, Rg8Unorm, Rg16Unorm};
    let is_pair = matches!(format, Rg8Unorm | Rg16Unorm | Bc5RgUnorm | EacRg11Unorm);
    let pair = if is_pair { TWO_COMPONENTS } else { 0 };
    let wrap = axis(sampler.address_mode_u, CLAMP_U, MIRROR_U) | axis(sampler.address_mode_v, CLAMP_V, MIRROR_V);
    wrap | nearest | encoding | pair
}

/// Mean of up to 128 x 128 texels; white if the format cannot be read on the CPU or if the GPU writes the image.  The mean only weighs lights
/// against each other.  Any positive value is unbiased, so black is avoided in case only the sampled texels are black.
pub(super) fn mean_color(image: &Image) -> LinearRgba {
    if is_live(image.texture_descriptor.usage) {
        return LinearRgba::WHITE;
    }
    let size = UVec2::new(image.width(), image.height());
    let step = IVec2::max(IVec2::ONE, (size.as_ivec2() + 127) / 128).as_uvec2();
    let (mut sum, mut count) = ([0.0f64; 3], 0u32);
    for y in (0..size.y).step_by(step.y as usize) {
        for x in (0..size.x).step_by(step.x as usize) {
            let Ok(color) = image.get_color_at(x, y) else {
                return LinearRgba::WHITE;
            };
            let c = Color::to_linear(&color);
            for (s, c) in sum.iter_mut().zip([c.red, c.green, c.blue]) {
                *s += if c.is_finite() { c as f64 } else { 0.0 };
            }
            count += 1;
        }
    }
    let [r, g, b] = sum.map(|s| (s / count.max(1) as f64).max(1e-4) as f32);
    LinearRgba::rgb(r, g, b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::asset::RenderAssetUsages;

    #[test]
    fn an_image_without_a_sampler_has_that_of_the_app() {
        let size = Extent3d { width: 1, height: 1, depth_or_array_layers: 1 };
        let usages = RenderAssetUsages::all();
        let image = Image::new_fill(size, TextureDimension::D2, &[0; 4], TextureFormat::Rgba8Unorm, usages);
        let flags = |image: &Image, default: &ImageSamplerDescriptor| ImageInfo::new(image, default, false, 1).flags;
        let mut repeated = ImageSamplerDescriptor::nearest();
        repeated.set_address_mode(ImageAddressMode::Repeat);
        assert_eq!(flags(&image, &ImageSamplerDescriptor::linear()), CLAMP_U | CLAMP_V);
        assert_eq!(flags(&image, &repeated), NEAREST);
        let own = Image { sampler: ImageSampler::Descriptor(ImageSamplerDescriptor::linear()), ..image };
        assert_eq!(flags(&own, &repeated), CLAMP_U | CLAMP_V);
    }
}
