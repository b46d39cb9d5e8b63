//! Bands of a picture.  A pass that may trace many rays runs over one band after another, so that no dispatch takes long.

use bevy::{
    math::UVec2,
    render::{
        render_resource::{Buffer, BufferSize, BufferUsages},
        renderer::{RenderDevice, RenderQueue},
    },
};

use super::{RestirView, bind_groups::Bound, buffer};
use crate::{
    gpu_layout::GpuViewUniforms,
    technique::{domain::Domain, frame::Step, rays::rays_of_pixel},
};

/// Side of a workgroup, pixels.
pub(crate) const WORKGROUP: u32 = 8;
const SIZE: BufferSize = BufferSize::new(size_of::<GpuViewUniforms>() as u64).expect("uniforms have a size");
/// Stride between the uniforms of bands, bytes: a multiple of the alignment that every device accepts.
const STRIDE: u64 = (size_of::<GpuViewUniforms>() as u64).next_multiple_of(256);

/// The bands of a view.
pub(crate) struct Bands {
    /// The uniforms of the view, once for each band.
    uniforms: Buffer,
    /// Rows of pixels of a band; the last one may have fewer.
    rows: u32,
    height: u32,
}

impl Bands {
    fn new(rows: u32, height: u32, device: &RenderDevice) -> Self {
        let size = u64::from(height.div_ceil(rows)) * STRIDE;
        let uniforms = buffer(device, "uniforms of bands", size, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        Self { uniforms, rows, height }
    }

    pub(crate) fn count(&self) -> u32 {
        self.height.div_ceil(self.rows)
    }

    /// Rows of workgroups of a band.
    pub(crate) fn workgroups(&self, band: u32) -> u32 {
        self.rows.min(self.height - band * self.rows).div_ceil(WORKGROUP)
    }

    fn write(&self, uniforms: &GpuViewUniforms, queue: &RenderQueue) {
        let mut bytes = vec![0; self.uniforms.size() as usize];
        for (band, slot) in (0..self.count()).zip(bytes.chunks_exact_mut(STRIDE as usize)) {
            let of_band = GpuViewUniforms { band_rows: self.rows, first_pixel: [0, band * self.rows], ..*uniforms };
            slot[..size_of::<GpuViewUniforms>()].copy_from_slice(bytemuck::bytes_of(&of_band));
        }
        queue.write_buffer(&self.uniforms, 0, &bytes);
    }

    /// The uniforms of a band.
    pub(super) fn uniforms_of(&self, band: u32) -> Bound<'_> {
        Bound::Part(&self.uniforms, u64::from(band) * STRIDE, SIZE)
    }

    pub(super) fn bytes(&self) -> u64 {
        self.uniforms.size()
    }
}

/// Rows of pixels of a band in which at most `limit` rays are traced, if possible; `None` if the whole picture is one.
fn rows_of_band(size: UVec2, rays_of_pixel: u64, limit: u32) -> Option<u32> {
    let of_workgroups = u64::from(size.x) * u64::from(WORKGROUP) * rays_of_pixel;
    let rows = u64::from(limit).checked_div(of_workgroups)?.max(1) * u64::from(WORKGROUP);
    (rows < u64::from(size.y)).then_some(rows as u32)
}

impl RestirView {
    /// Rays that a step may trace in the whole picture ([`rays_of_pixel`]).
    pub(crate) fn rays_of(&self, step: &Step) -> u64 {
        super::pixels(self.size) * rays_of_pixel(step, &self.settings)
    }

    /// Divides the picture into bands if a pass of this frame needs them, and writes their uniforms.
    pub(super) fn update_bands(&mut self, uniforms: &GpuViewUniforms, device: &RenderDevice, queue: &RenderQueue) {
        let iterations = |domain: &Domain| (domain.schedule)(&self.settings).iteration_kinds();
        let steps = self.key.map(|key| key.frame.steps(iterations)).unwrap_or_default();
        let most = steps.iter().map(|step| rays_of_pixel(step, &self.settings)).max().unwrap_or(0);
        let rows = rows_of_band(self.size, most, self.settings.research.rays_per_dispatch);
        if self.bands.as_ref().map(|bands| bands.rows) != rows {
            // Bind groups would keep the old uniforms alive.
            self.view_groups.clear();
            self.bands = rows.map(|rows| Bands::new(rows, self.size.y, device));
        }
        if let Some(bands) = &self.bands {
            bands.write(uniforms, queue);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_hold_as_many_rays_as_the_limit_allows() {
        let size = UVec2::new(3840, 2160);
        assert_eq!(rows_of_band(size, 4, u32::MAX), None);
        assert_eq!(rows_of_band(size, 0, 1), None);
        for rays in [5, 16, 54, 200] {
            let rows = rows_of_band(size, rays, 1 << 25).expect("too many rays for one band");
            let of_rows = |rows| u64::from(size.x) * u64::from(rows) * rays;
            assert!(rows % WORKGROUP == 0 && of_rows(rows) <= 1 << 25 && of_rows(rows + WORKGROUP) > 1 << 25, "{rows}");
        }
        // A row of workgroups is the least that a dispatch can trace.
        assert_eq!(rows_of_band(size, 16, 1), Some(WORKGROUP));
        assert_eq!(rows_of_band(UVec2::new(40, 8), 16, 1), None);
    }
}
