//! Table for energy compensation: the fraction of light that GGX microfacets reflect with a single bounce (Turquin 2019; Lanz 2025, 2.1.3).
//! The rest bounces between microfacets, and a single-scattering lobe loses it.

use bevy::render::{
    render_resource::{
        Extent3d, TextureDataOrder, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
        TextureViewDescriptor,
    },
    renderer::{RenderDevice, RenderQueue},
};
use std::sync::LazyLock;

/// Entries per side.  Columns go by the cosine of wo and rows by perceptual roughness, both from 0 to 1.
pub const SIZE: usize = 32;

/// Directional albedo of GGX reflection with F = 1: the mean of G2/G1 over visible normals, integrated by the midpoint rule on `n` x `n`
/// cells.
pub fn directional_albedo(alpha: f64, cos_o: f64, n: usize) -> f64 {
    let sin_o = (1.0 - cos_o * cos_o).max(0.0).sqrt();
    let smith = |cos: f64, sin: f64| 0.5 * ((1.0 + (alpha * sin / cos).powi(2)).sqrt() - 1.0);
    let lambda_o = smith(cos_o, sin_o);
    // Maps each cell to a visible normal by spherical caps (Dupuy and Benyoub 2023).
    let length = ((alpha * sin_o).powi(2) + cos_o * cos_o).sqrt();
    let stretched = [alpha * sin_o / length, cos_o / length];
    let mut sum = 0.0;
    for i in 0..n {
        let z = (1.0 - (i as f64 + 0.5) / n as f64) * (1.0 + stretched[1]) - stretched[1];
        let r = (1.0 - z * z).max(0.0).sqrt();
        for j in 0..n {
            let phi = core::f64::consts::TAU * (j as f64 + 0.5) / n as f64;
            let cap = [r * phi.cos() + stretched[0], r * phi.sin(), z + stretched[1]];
            let h = [alpha * cap[0], alpha * cap[1], cap[2]];
            let h_length = h.iter().map(|x| x * x).sum::<f64>().sqrt();
            let h = h.map(|x| x / h_length);
            let cos_oh = sin_o * h[0] + cos_o * h[2];
            let cos_i = 2.0 * cos_oh * h[2] - cos_o;
            if cos_i > 0.0 {
                let lambda_i = smith(cos_i, (1.0 - cos_i * cos_i).max(0.0).sqrt());
                sum += (1.0 + lambda_o) / (1.0 + lambda_o + lambda_i);
            }
        }
    }
    sum / (n * n) as f64
}

/// The table, row by row.
pub fn table() -> Vec<f32> {
    let at = |i: usize| i as f64 / (SIZE - 1) as f64;
    (0..SIZE * SIZE)
        .map(|k| {
            // A mirror loses nothing.  The albedo at cos = 0 is a limit, so it is evaluated slightly above 0.
            let (roughness, cos_o) = (at(k / SIZE), at(k % SIZE).max(1e-4));
            if roughness == 0.0 { 1.0 } else { directional_albedo(roughness * roughness, cos_o, 48) as f32 }
        })
        .collect()
}

/// The table as a texture.
pub(crate) fn texture(device: &RenderDevice, queue: &RenderQueue) -> TextureView {
    // Kept, because a device without memory asks for it in every frame.
    static TABLE: LazyLock<Vec<f32>> = LazyLock::new(table);
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
            bytemuck::cast_slice(TABLE.as_slice()),
        )
        .create_view(&TextureViewDescriptor::default())
}
