//! What direct lighting keeps of a view between frames: reservoirs of this frame and of the last, and the last visibility buffer.
//! It exists only while a camera runs the technique.

use bevy::{
    math::UVec2,
    render::{
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{VISIBILITY_FORMAT, buffer, pixels, texture};
use crate::{
    gpu_types::*,
    settings::{Direct, Mis},
};

/// Format of the light that passes hand on to the resolve.
pub(crate) const LIGHT_FORMAT: TextureFormat = TextureFormat::Rgba32Float;

/// The history of direct lighting.
pub(crate) struct DirectHistory {
    pub(crate) settings: Buffer,
    pub(crate) subsets: Buffer,
    subset_entries: u64,
    reservoirs: [Buffer; 2],
    pub(crate) previous_visibility: Texture,
    pub(crate) previous_visibility_view: TextureView,
    pub(crate) unresampled: TextureView,
    pub(crate) resampled: TextureView,
    /// Which reservoirs are this frame's.
    parity: usize,
    size: UVec2,
}

impl DirectHistory {
    pub(crate) fn new(size: UVec2, direct: &Direct, device: &RenderDevice) -> Self {
        let buffer = |label, size, usage| buffer(device, label, size, usage);
        let texture = |label, format, usage| texture(device, label, size, format, usage);
        let light = |label| {
            texture(label, LIGHT_FORMAT, TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING)
                .create_view(&TextureViewDescriptor::default())
        };
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let entries = subset_entries(direct);
        let previous_visibility =
            texture("last visibility", VISIBILITY_FORMAT, TextureUsages::COPY_DST | TextureUsages::TEXTURE_BINDING);
        Self {
            settings: buffer(
                "direct settings",
                size_of::<GpuDirectSettings>() as u64,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            ),
            subsets: buffer("light subsets", entries * 16, storage),
            subset_entries: entries,
            reservoirs: ["reservoirs", "last reservoirs"]
                .map(|label| buffer(label, pixels(size) * DIRECT_RESERVOIR_SIZE, storage)),
            previous_visibility_view: previous_visibility.create_view(&TextureViewDescriptor::default()),
            previous_visibility,
            unresampled: light("unresampled light"),
            resampled: light("resampled light"),
            parity: 0,
            size,
        }
    }

    /// Whether the buffers serve these settings.
    pub(crate) fn fits(&self, size: UVec2, direct: &Direct) -> bool {
        self.size == size && self.subset_entries == subset_entries(direct)
    }

    /// Begins a frame: last frame's reservoirs become the previous ones.
    pub(crate) fn begin(&mut self, direct: &Direct, has_history: bool, queue: &RenderQueue) {
        self.parity = 1 - self.parity;
        let mut flags = 0;
        let mut set = |condition: bool, flag: u32| flags |= if condition { flag } else { 0 };
        set(direct.mis_rays, DIRECT_MIS_RAYS);
        set(direct.reject, DIRECT_REJECT);
        set(has_history, DIRECT_HISTORY);
        let settings = GpuDirectSettings {
            candidates: direct.candidates,
            subset_count: direct.subset_count,
            subset_size: direct.subset_size,
            tile: direct.tile,
            temporal_taps: direct.temporal as u32,
            spatial_taps: direct.spatial_taps,
            radius: direct.radius,
            confidence_cap: direct.confidence_cap,
            mis: mis_constant(direct.mis),
            flags,
            normal_threshold: direct.normal_threshold,
            depth_threshold: direct.depth_threshold,
        };
        queue.write_buffer(&self.settings, 0, bytemuck::bytes_of(&settings));
    }

    pub(crate) fn reservoirs(&self) -> &Buffer {
        &self.reservoirs[self.parity]
    }

    pub(crate) fn previous_reservoirs(&self) -> &Buffer {
        &self.reservoirs[1 - self.parity]
    }

    /// Names and bytes.
    pub(crate) fn memory(&self) -> Vec<(&'static str, u64)> {
        let pixels = pixels(self.size);
        vec![
            ("direct settings", size_of::<GpuDirectSettings>() as u64),
            ("light subsets", self.subset_entries * 16),
            ("reservoirs", 2 * pixels * DIRECT_RESERVOIR_SIZE),
            ("last visibility", pixels * 8),
            ("light", 2 * pixels * 16),
        ]
    }
}

/// Entries of the subsets; one where there are none, since a binding is never empty.
fn subset_entries(direct: &Direct) -> u64 {
    (direct.subset_count as u64 * direct.subset_size as u64).max(1)
}

/// Workgroups of the pass that fills the subsets.
pub(crate) fn presample_workgroups(direct: &Direct) -> u32 {
    (direct.subset_count * direct.subset_size).div_ceil(64)
}

fn mis_constant(mis: Mis) -> u32 {
    match mis {
        Mis::Uniform => MIS_UNIFORM,
        Mis::Valid => MIS_VALID,
        Mis::Balance => MIS_BALANCE,
        Mis::Pairwise => MIS_PAIRWISE,
        Mis::DefensivePairwise => MIS_DEFENSIVE_PAIRWISE,
        Mis::DefensivePairwiseGris => MIS_DEFENSIVE_PAIRWISE_GRIS,
    }
}
