//! The surfaces that the picture shows where fewer pixels are traced than shown: the composite pass chooses among traced pixels by them, so that
//! edges stay sharp.

use bevy::{
    math::UVec2,
    render::{render_resource::*, renderer::RenderDevice},
};

use super::{DEPTH_FORMAT, pixels, texture, visibility_buffer};

/// A visibility buffer with its depth.
pub(crate) struct Surfaces {
    pub visibility: TextureView,
    pub depth: TextureView,
}

impl Surfaces {
    /// Those of all shown pixels; `None` if each of them is traced.
    pub(super) fn shown(traced: UVec2, shown: UVec2, device: &RenderDevice) -> Option<Self> {
        let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
        (traced != shown).then(|| Self {
            visibility: visibility_buffer(device, "shown visibility", shown),
            depth: texture(device, "shown depth", shown, 1, DEPTH_FORMAT, usage)
                .create_view(&TextureViewDescriptor::default()),
        })
    }

    /// Their bytes for a number of shown pixels.
    pub(super) fn bytes(shown: UVec2) -> u64 {
        pixels(shown) * 12
    }
}
