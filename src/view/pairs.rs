//! Textures of paired spatial reuse: what the pixels of pairs exchange within an iteration.  They exist only while the settings ask for pairs.

use bevy::{
    math::UVec2,
    render::{render_resource::*, renderer::RenderDevice},
};

use super::{history::LIGHT_FORMAT, texture};

/// Format of the masks of similar partners.
pub(crate) const PAIR_MASK_FORMAT: TextureFormat = TextureFormat::R32Uint;

/// What the pixels of pairs exchange.
pub(crate) struct Pairs {
    /// Masks of similar partners.
    pub(crate) masks: TextureView,
    /// Shifts of partners' samples, one in each layer.
    pub(crate) shifts: TextureView,
    layers: u32,
}

impl Pairs {
    /// `None` without layers.
    pub(super) fn new(size: UVec2, layers: u32, device: &RenderDevice) -> Option<Self> {
        let usage = TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
        let view = |label, layers, format, dimension| {
            let descriptor = TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
            texture(device, label, size, layers, format, usage).create_view(&descriptor)
        };
        (layers > 0).then(|| Self {
            masks: view("pair masks", 1, PAIR_MASK_FORMAT, TextureViewDimension::D2),
            shifts: view("pair shifts", layers, LIGHT_FORMAT, TextureViewDimension::D2Array),
            layers,
        })
    }

    pub(super) fn layers_of(pairs: Option<&Self>) -> u32 {
        pairs.map_or(0, |pairs| pairs.layers)
    }

    /// Names and bytes.
    pub(super) fn memory(&self, pixels: u64) -> [(&'static str, u64); 2] {
        [("pair masks", pixels * 4), ("pair shifts", pixels * 16 * u64::from(self.layers))]
    }
}
