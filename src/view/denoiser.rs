//! Textures and uniforms of the denoiser.  They exist only while it runs.

use bevy::{
    math::UVec2,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{
    bind_groups::Bound,
    buffer,
    history::{LIGHT_FORMAT, SETTINGS_STRIDE, settings_of, write_settings},
    texture,
};
use crate::{gpu_layout::GpuDenoiserSettings, settings::Denoiser, technique::denoiser::FIRST_FILTER};

/// Format of the guide and of the means over frames.
pub(crate) const PACKED_FORMAT: TextureFormat = TextureFormat::Rgba32Uint;
/// Kinds of light: diffuse and specular (`shaders/denoiser/types.wgsl`), each in a layer of its own.
const KINDS: u32 = 2;
/// Greatest number of iterations, those before the filter included.
const MAX_ITERATIONS: usize = FIRST_FILTER + Denoiser::MAX_ITERATIONS as usize;

/// Textures for surfaces that smooth mirrors and clear glass show.
pub(super) struct ImageTextures {
    /// Guides of the optical images of this frame and of the last one; the textures change roles with those of the guide.
    guides: [TextureView; 2],
    /// Places of the optical images in the last frame.
    places: TextureView,
}

/// The textures of the denoiser.
pub(crate) struct DenoiserTextures {
    settings: Buffer,
    /// Light without albedo; the textures change roles with each iteration.
    signals: [TextureView; 2],
    /// Guides of this frame and of the last one; the textures change roles from frame to frame, as those of the means do.
    guides: [TextureView; 2],
    /// Means over frames.
    means: [TextureView; 2],
    images: Option<ImageTextures>,
    /// A texel without an optical image.
    no_image: TextureView,
    /// Index of the guide and the means of this frame.
    current: usize,
    /// The last frame left means.
    has_means: bool,
}

fn texture_view(
    label: &'static str,
    size: UVec2,
    layers: u32,
    format: TextureFormat,
    device: &RenderDevice,
) -> TextureView {
    let usage = TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
    let dimension = if layers > 1 { TextureViewDimension::D2Array } else { TextureViewDimension::D2 };
    let descriptor = TextureViewDescriptor { dimension: Some(dimension), ..Default::default() };
    texture(device, label, size, layers, format, usage).create_view(&descriptor)
}

impl ImageTextures {
    pub(super) fn new(size: UVec2, device: &RenderDevice) -> Self {
        let view = |label, format| texture_view(label, size, 1, format, device);
        Self {
            guides: ["optical images", "last optical images"].map(|label| view(label, PACKED_FORMAT)),
            places: view("places of optical images", LIGHT_FORMAT),
        }
    }
}

impl DenoiserTextures {
    pub(super) fn new(size: UVec2, has_images: bool, device: &RenderDevice) -> Self {
        let view = |label, layers, format| texture_view(label, size, layers, format, device);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Self {
            settings: buffer(device, "denoiser settings", MAX_ITERATIONS as u64 * SETTINGS_STRIDE, usage),
            signals: ["light to denoise", "denoised light"].map(|label| view(label, KINDS, LIGHT_FORMAT)),
            guides: ["denoiser guide", "last denoiser guide"].map(|label| view(label, 1, PACKED_FORMAT)),
            means: ["denoiser means", "last denoiser means"].map(|label| view(label, KINDS, PACKED_FORMAT)),
            images: has_images.then(|| ImageTextures::new(size, device)),
            no_image: texture_view("no optical image", UVec2::ONE, 1, PACKED_FORMAT, device),
            current: 0,
            has_means: false,
        }
    }

    /// Begins a frame.  `has_history`: the last frame showed the same scene.
    pub(super) fn begin(&mut self, settings: &Denoiser, has_history: bool, queue: &RenderQueue) {
        self.current = 1 - self.current;
        let has_history = u32::from(has_history && self.has_means);
        write_settings(&self.settings, MAX_ITERATIONS, queue, |iteration| {
            let step = 1 << iteration.saturating_sub(FIRST_FILTER);
            GpuDenoiserSettings { step, history: settings.history, has_history, pad: 0 }
        });
        self.has_means = true;
    }

    /// Uniforms of an iteration.
    pub(crate) fn settings_of(&self, iteration: usize) -> Option<Bound<'_>> {
        settings_of::<GpuDenoiserSettings>(&self.settings, iteration)
    }

    /// Light that an iteration reads.
    pub(crate) fn signals_before(&self, iteration: usize) -> &TextureView {
        &self.signals[(iteration + 1) % 2]
    }

    /// Light that an iteration writes.
    pub(crate) fn signals_after(&self, iteration: usize) -> &TextureView {
        &self.signals[iteration % 2]
    }

    /// The guides of this frame and of the last one.
    pub(crate) fn guides(&self) -> [&TextureView; 2] {
        [&self.guides[self.current], &self.guides[1 - self.current]]
    }

    pub(super) fn has_images(&self) -> bool {
        self.images.is_some()
    }

    /// Adds or removes the textures for optical images.  The means over frames stay.
    pub(super) fn set_images(&mut self, images: Option<ImageTextures>) {
        self.images = images;
    }

    /// The optical images of this frame and of the last one.
    pub(crate) fn optical_images(&self) -> [&TextureView; 2] {
        match &self.images {
            Some(images) => [&images.guides[self.current], &images.guides[1 - self.current]],
            None => [&self.no_image; 2],
        }
    }

    /// Places of the optical images in the last frame.
    pub(crate) fn image_places(&self) -> Option<&TextureView> {
        self.images.as_ref().map(|images| &images.places)
    }

    /// The means of this frame and of the last one.
    pub(crate) fn means(&self) -> [&TextureView; 2] {
        [&self.means[self.current], &self.means[1 - self.current]]
    }

    /// Names and bytes.
    pub(super) fn memory(&self, pixels: u64) -> Vec<(&'static str, u64)> {
        let kinds = u64::from(KINDS);
        let mut memory = vec![
            ("denoiser settings", MAX_ITERATIONS as u64 * SETTINGS_STRIDE),
            ("denoiser light", 2 * kinds * pixels * 16),
            ("denoiser guides", 2 * pixels * 16),
            ("denoiser means", 2 * kinds * pixels * 16),
        ];
        memory.extend(self.images.iter().map(|_| ("optical images", 3 * pixels * 16)));
        memory
    }
}
