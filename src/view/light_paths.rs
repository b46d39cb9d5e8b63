//! Resources of the light sub-paths of a view: the light vertex cache and the light map.  They exist only while the camera runs a technique
//! that traces light sub-paths.

use bevy::{
    math::UVec2,
    render::{
        render_resource::{Buffer, BufferUsages, TextureUsages, TextureView, TextureViewDescriptor},
        renderer::RenderDevice,
    },
};

use super::{buffer, denoiser::PACKED_FORMAT, pixels, texture};
use crate::{
    gpu_layout::{SPLAT_WORDS, SPLATS_OF_A_PATH, VERTEX_TEXELS, VERTICES_PER_ROW},
    settings::{Bdpt, LightTechniques},
};

/// Bytes of a light sub-path's entries in the light map.
const SPLATS_SIZE: u64 = 4 * (SPLATS_OF_A_PATH * SPLAT_WORDS) as u64;

/// Greatest number of light sub-paths of a frame.  The random number that chooses one of them has 24 bits, and a texture of WebGPU's least
/// size holds the vertices of as many.
pub const MAX_LIGHT_PATHS: u64 = 1 << 24;

/// Light sub-paths of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct LightPathCounts {
    pub light_paths: u32,
    /// Number of sub-paths whose vertices the camera sees: all of them, or 0.
    pub splats: u32,
    /// Camera sub-paths are connected with them.
    pub connects: bool,
}

impl LightPathCounts {
    /// The counts for a picture of this size, as far as the device can bind them.
    pub(crate) fn new(settings: &Bdpt, size: UVec2, limit: u64, camera_sees_them: bool) -> Self {
        let is_seen = camera_sees_them && settings.techniques != LightTechniques::NoLightTracing;
        let connects = settings.connects();
        if !is_seen && !connects {
            return Self::default();
        }
        let for_map = if is_seen { limit.saturating_sub(heads_bytes(size)) / SPLATS_SIZE } else { u64::MAX };
        let light_paths = wanted(settings, size).min(for_map) as u32;
        Self { light_paths, splats: if is_seen { light_paths } else { 0 }, connects }
    }

    /// Whether the device cannot bind as many as the settings ask for.
    pub(crate) fn is_reduced(&self, settings: &Bdpt, size: UVec2) -> bool {
        (self.splats > 0 || self.connects) && u64::from(self.light_paths) < wanted(settings, size)
    }
}

/// Number of light sub-paths that the settings ask for.
fn wanted(settings: &Bdpt, size: UVec2) -> u64 {
    let count = (f64::from(settings.light_paths) * pixels(size) as f64).round() as u64;
    count.min(MAX_LIGHT_PATHS)
}

/// Bytes of the heads of lists, with which the light map begins.
fn heads_bytes(size: UVec2) -> u64 {
    pixels(size) * 4
}

/// Resources of the light sub-paths.
pub(crate) struct LightPaths {
    pub(crate) vertices: TextureView,
    pub(crate) map: Buffer,
    /// Bytes of the light map that are cleared before each frame.
    pub(crate) heads: u64,
    /// The counts that the buffers are made for.
    counts: LightPathCounts,
    /// Sub-paths that the light map holds.
    mapped: u64,
    /// Texels of the light vertex cache.
    texels: u64,
}

impl LightPaths {
    /// `has_splats`: a domain reads the light map.
    pub(super) fn new(size: UVec2, counts: LightPathCounts, has_splats: bool, device: &RenderDevice) -> Self {
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let rows = counts.light_paths.div_ceil(VERTICES_PER_ROW).max(1);
        let cache = if counts.connects { UVec2::new(VERTICES_PER_ROW * VERTEX_TEXELS, rows) } else { UVec2::ONE };
        let usage = TextureUsages::STORAGE_BINDING | TextureUsages::TEXTURE_BINDING;
        let vertices = texture(device, "light vertices", cache, 1, PACKED_FORMAT, usage);
        let (heads, mapped) = if has_splats { (heads_bytes(size), u64::from(counts.splats)) } else { (4, 0) };
        Self {
            vertices: vertices.create_view(&TextureViewDescriptor::default()),
            map: buffer(device, "light map", heads + mapped * SPLATS_SIZE, storage),
            heads,
            counts,
            mapped,
            texels: pixels(cache),
        }
    }

    /// Whether the buffers and the history of splats belong to these counts.  The counts include splats, because frames without splats count
    /// as frames without light: in a history that is kept they would darken later frames.
    pub(super) fn fits(&self, counts: LightPathCounts) -> bool {
        self.counts == counts
    }

    /// Number of sub-paths of a frame.
    pub(super) fn count(&self) -> u64 {
        u64::from(self.counts.light_paths)
    }

    /// Names and bytes.
    pub(super) fn memory(&self) -> [(&'static str, u64); 2] {
        [("light vertices", self.texels * 16), ("light map", self.heads + self.mapped * SPLATS_SIZE)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_light_paths_fits_the_device() {
        let of = |light_paths, size, limit| {
            let settings = Bdpt { light_paths, techniques: LightTechniques::Full, ..Bdpt::default() };
            let counts = LightPathCounts::new(&settings, size, limit, true);
            (counts.light_paths, counts.is_reduced(&settings, size))
        };
        let hd = UVec2::new(1920, 1080);
        assert_eq!(of(1.0, hd, 128 << 20), (1920 * 1080, false));
        assert_eq!(of(0.5, UVec2::new(3, 3), 128 << 20), (5, false));
        assert_eq!(of(0.0, hd, 128 << 20), (0, false));
        let (count, is_reduced) = of(8.0, hd, 128 << 20);
        assert!(is_reduced && count > 2_000_000 && u64::from(count) * SPLATS_SIZE <= 128 << 20);
        assert_eq!(of(1.0, hd, 1 << 20), (0, true));
    }

    #[test]
    fn without_splats_only_connections_need_sub_paths() {
        let counts = |techniques, is_seen| {
            LightPathCounts::new(&Bdpt { techniques, ..Bdpt::default() }, UVec2::new(10, 10), 1 << 20, is_seen)
        };
        let connections = LightPathCounts { light_paths: 100, splats: 0, connects: true };
        assert_eq!(counts(LightTechniques::Full, false), connections);
        assert_eq!(counts(LightTechniques::NoLightTracing, true), connections);
        assert_eq!(counts(LightTechniques::Lightweight, false), LightPathCounts::default());
    }
}
