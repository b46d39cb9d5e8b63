//! Bands of a picture.  A pass that may trace many rays runs over one band after another, so that no dispatch takes long.

use bevy::{
    math::UVec2,
    render::{
        render_resource::{Buffer, BufferSize, BufferUsages},
        renderer::{RenderDevice, RenderQueue},
    },
};
use wgpu_types::DeviceType;

use super::{RestirView, bind_groups::Bound, buffer, pixels};
use crate::{
    gpu_layout::GpuViewUniforms,
    technique::{domain::Domain, frame::Step, rays::rays_of_pixel},
};

/// Side of a workgroup, pixels.
pub(crate) const WORKGROUP: u32 = 8;
/// Bytes of the uniforms of a band.
const SIZE: BufferSize = BufferSize::new(size_of::<GpuViewUniforms>() as u64).expect("uniforms have a size");
/// Stride between the uniforms of bands, bytes: a multiple of the alignment that every device accepts.
const STRIDE: u64 = (size_of::<GpuViewUniforms>() as u64).next_multiple_of(256);

/// A division of a picture into bands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Division {
    /// Rows of pixels of a band; the last one may have fewer.
    rows: u32,
    height: u32,
}

impl Division {
    /// Bands in which a pass traces at most `limit` rays, if possible; `None` if the whole picture is one.
    fn new(size: UVec2, rays_of_pixel: u64, limit: u32) -> Option<Self> {
        let of_workgroups = u64::from(size.x) * u64::from(WORKGROUP) * rays_of_pixel;
        let rows = u64::from(limit).checked_div(of_workgroups)?.max(1) * u64::from(WORKGROUP);
        (rows < u64::from(size.y)).then_some(Self { rows: rows as u32, height: size.y })
    }

    fn count(self) -> u32 {
        self.height.div_ceil(self.rows)
    }

    /// How many successive bands a pass can take in one dispatch.  `rays`: those of the pass in the whole picture.
    pub(crate) fn together(self, rays: u64, limit: u32) -> u32 {
        let of_band = rays * u64::from(self.rows) / u64::from(self.height);
        let count = u64::from(limit).checked_div(of_band).unwrap_or(u64::MAX);
        count.clamp(1, self.count().into()) as u32
    }

    /// The first band of each dispatch, and its rows of workgroups, if a dispatch takes `together` bands.
    pub(crate) fn dispatches(self, together: u32) -> impl Iterator<Item = (u32, u32)> {
        let first_bands = (0..self.count()).step_by(together as usize);
        first_bands.map(move |band| {
            let rows = (self.rows * together).min(self.height - band * self.rows);
            (band, rows.div_ceil(WORKGROUP))
        })
    }
}

/// The bands of a view.
pub(crate) struct Bands {
    pub division: Division,
    /// The uniforms of the view, once for each band.
    uniforms: Buffer,
}

impl Bands {
    fn new(division: Division, device: &RenderDevice) -> Self {
        let size = u64::from(division.count()) * STRIDE;
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Self { division, uniforms: buffer(device, "uniforms of bands", size, usage) }
    }

    fn write(&self, uniforms: &GpuViewUniforms, queue: &RenderQueue) {
        let mut bytes = vec![0; self.uniforms.size() as usize];
        let band_rows = self.division.rows;
        for (band, slot) in (0..).zip(bytes.chunks_exact_mut(STRIDE as usize)) {
            let of_band = GpuViewUniforms { band_rows, first_pixel: [0, band * band_rows], ..*uniforms };
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

/// The limit where the settings leave it to the device.  With default settings, frames trace about a tenth of the estimate.  A GPU that shares
/// its memory with the CPU may trace a hundredth of the rays that a fast card traces, and no driver resets a CPU.  Browsers do not reveal the
/// kind of a device (`Other`).
pub(super) fn limit_on(device: DeviceType) -> u32 {
    match device {
        DeviceType::DiscreteGpu | DeviceType::VirtualGpu => 1 << 29,
        DeviceType::IntegratedGpu | DeviceType::Other => 1 << 26,
        DeviceType::Cpu => u32::MAX,
    }
}

impl RestirView {
    /// Rays that a step may trace in the whole picture ([`rays_of_pixel`]).
    pub(crate) fn rays_of(&self, step: &Step) -> u64 {
        pixels(self.size) * rays_of_pixel(step, &self.settings)
    }

    /// Divides the picture into bands if a pass of this frame needs them, and writes their uniforms.  `limit`: [`limit_on`] this device.
    pub(super) fn update_bands(
        &mut self,
        uniforms: &GpuViewUniforms,
        limit: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        self.rays_per_dispatch = match self.settings.research.rays_per_dispatch {
            0 => limit,
            of_settings => of_settings,
        };
        let iterations = |domain: &Domain| (domain.schedule)(&self.settings).iteration_kinds();
        let steps = self.key.map(|key| key.frame.steps(iterations)).unwrap_or_default();
        let most = steps.iter().map(|step| rays_of_pixel(step, &self.settings)).max().unwrap_or(0);
        let division = Division::new(self.size, most, self.rays_per_dispatch);
        if self.bands.as_ref().map(|bands| bands.division) != division {
            // Bind groups would keep the old uniforms alive.
            self.view_groups.clear();
            self.bands = division.map(|division| Bands::new(division, device));
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
        assert_eq!(Division::new(size, 4, u32::MAX), None);
        assert_eq!(Division::new(size, 0, 1), None);
        for rays in [5, 16, 54, 200] {
            let Division { rows, .. } = Division::new(size, rays, 1 << 25).expect("too many rays for one band");
            let of_rows = |rows| u64::from(size.x) * u64::from(rows) * rays;
            assert!(rows % WORKGROUP == 0 && of_rows(rows) <= 1 << 25 && of_rows(rows + WORKGROUP) > 1 << 25, "{rows}");
        }
        // A row of workgroups is the least that a dispatch can trace.
        assert_eq!(Division::new(size, 16, 1), Some(Division { rows: WORKGROUP, height: 2160 }));
        assert_eq!(Division::new(UVec2::new(40, 8), 16, 1), None);
    }

    #[test]
    fn dispatches_cover_the_picture_once_and_hold_no_more_rays_than_the_limit() {
        let (size, limit) = (UVec2::new(1920, 1080), 1 << 23);
        let division = Division::new(size, 54, limit).expect("too many rays for one band");
        assert_eq!((division.rows, division.count()), (80, 14));
        for (rays_of_pixel, expected) in [(54, 1), (19, 2), (16, 3), (6, 9), (0, 14)] {
            let together = division.together(pixels(size) * rays_of_pixel, limit);
            assert_eq!(together, expected);
            let mut next = 0;
            for (band, rows) in division.dispatches(together) {
                assert_eq!(band * division.rows, next * WORKGROUP);
                assert!(u64::from(rows * WORKGROUP * size.x) * rays_of_pixel <= u64::from(limit));
                next += rows;
            }
            assert_eq!(next, size.y.div_ceil(WORKGROUP));
        }
    }
}
