//! Table for energy compensation: the fraction of light that GGX microfacets reflect with a single bounce (Turquin 2019; Lanz 2025, 2.1.3).
//! The rest bounces between microfacets, and a single-scattering lobe loses it.

use bevy::render::{
    render_resource::{
        Extent3d, TextureDataOrder, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
        TextureViewDescriptor,
    },
    renderer::{RenderDevice, RenderQueue},
};

/// Entries per side.  Columns go by the cosine of wo and rows by perceptual roughness, both from 0 to 1.
pub const SIZE: usize = 32;

/// The entries, row by row, as little-endian `f32`: the fraction of light that a rough mirror (F = 1) reflects, which is the mean of G2/G1
/// over visible normals.  They are accurate to 1e-5; `tests/support/oracle/directional_albedo.rs` integrates them.
pub const TABLE: &[u8; 4 * SIZE * SIZE] = include_bytes!("directional_albedo.f32");

/// The table as a texture.
pub(crate) fn texture(device: &RenderDevice, queue: &RenderQueue) -> TextureView {
    device
        .create_texture_with_data(
            queue,
            &TextureDescriptor {
                label: Some("specular albedo"),
                size: Extent3d { width: SIZE as u32, height: SIZE as u32, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format: TextureFormat::R32Float,
                usage: TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            },
            TextureDataOrder::LayerMajor,
            TABLE,
        )
        .create_view(&TextureViewDescriptor::default())
}
