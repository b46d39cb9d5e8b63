//! Textures and buffers of paired spatial reuse, through which the two pixels of a pair exchange shifts within an iteration.  They exist
//! only while the settings ask for pairs.

use bevy::{
    math::UVec2,
    render::{render_resource::*, renderer::RenderDevice},
};

use super::{buffer, history::LIGHT_FORMAT, pixels, texture};

/// Format of the masks of similar partners.
pub(crate) const PAIR_MASK_FORMAT: TextureFormat = TextureFormat::R32Uint;

/// The resources through which the two pixels of a pair exchange shifts.
pub(crate) struct Pairs {
    /// Masks of similar partners.
    pub(crate) masks: TextureView,
    /// Shifts of partners' samples, one in each layer.
    pub(crate) shifts: TextureView,
    /// Pixels whose shifts replay paths, if a pass of their own does it.
    pub(crate) queue: Option<ReplayQueue>,
    kind: PairKind,
}

/// A queue of pixels whose shifts replay paths: a header with the arguments of the indirect dispatch, then 8 bytes for each pixel
/// (`shaders/pass/pair_shifts.wgsl`).
pub(crate) struct ReplayQueue(pub(crate) Buffer);

/// The parameters of these resources, apart from the size of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PairKind {
    pub layers: u32,
    pub has_queue: bool,
}

impl ReplayQueue {
    /// Size of the header, bytes: the number of workgroups in each dimension, and the number of entries.
    pub(crate) const HEADER: u64 = 16;

    fn new(size: UVec2, device: &RenderDevice) -> Self {
        let usage = BufferUsages::STORAGE | BufferUsages::INDIRECT | BufferUsages::COPY_DST;
        Self(buffer(device, "replay queue", Self::bytes(pixels(size)), usage))
    }

    fn bytes(pixels: u64) -> u64 {
        Self::HEADER + 8 * pixels
    }
}

impl Pairs {
    /// `None` without layers.
    pub(super) fn new(size: UVec2, kind: PairKind, device: &RenderDevice) -> Option<Self> {
        let layers = kind.layers;
        let usage = TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
        let view = |label, layers, format, dimension| {
            let descriptor = TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
            texture(device, label, size, layers, format, usage).create_view(&descriptor)
        };
        (layers > 0).then(|| Self {
            masks: view("pair masks", 1, PAIR_MASK_FORMAT, TextureViewDimension::D2),
            shifts: view("pair shifts", layers, LIGHT_FORMAT, TextureViewDimension::D2Array),
            queue: kind.has_queue.then(|| ReplayQueue::new(size, device)),
            kind,
        })
    }

    pub(super) fn kind_of(pairs: Option<&Self>) -> PairKind {
        pairs.map(|pairs| pairs.kind).unwrap_or_default()
    }

    /// Names and bytes.
    pub(super) fn memory(&self, pixels: u64) -> impl Iterator<Item = (&'static str, u64)> {
        let queue = self.queue.as_ref().map(|_| ("replay queue", ReplayQueue::bytes(pixels)));
        [("pair masks", pixels * 4), ("pair shifts", pixels * 16 * u64::from(self.kind.layers))]
            .into_iter()
            .chain(queue)
    }
}
