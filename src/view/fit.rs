//! What a device cannot bind is made smaller, never an error: the picture that is traced, and the subsets of lights.

use bevy::{math::UVec2, render::renderer::RenderDevice};

use super::{history::reservoir_bytes, pixels, plan::Domain};
use crate::{
    gpu_types::PRESAMPLED_LIGHT_SIZE,
    settings::{Direct, Restir},
};

/// Bytes that one binding of this device can hold.
pub(crate) fn binding_limit(device: &RenderDevice) -> u64 {
    let limits = device.limits();
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

/// Bytes of the largest buffer of a view: its radiance, or a domain's reservoirs.
fn largest_buffer(size: UVec2, domains: &[Domain], settings: &Restir) -> u64 {
    let reservoirs = domains.iter().map(|&domain| reservoir_bytes(size, domain, settings));
    reservoirs.fold(pixels(size) * 16, u64::max)
}

/// The size of the picture that is traced for a viewport: as large, or less by one factor on both sides.
pub(crate) fn traced_size(viewport: UVec2, domains: &[Domain], settings: &Restir, limit: u64) -> UVec2 {
    let mut size = viewport;
    let mut scale = 1.0f64;
    while size != UVec2::ONE && largest_buffer(size, domains, settings) > limit {
        // Tiles are whole: the first guess may be a little too large.
        let share = limit as f64 / largest_buffer(size, domains, settings) as f64;
        scale *= share.sqrt().min(0.999);
        size = (viewport.as_dvec2() * scale).as_uvec2().max(UVec2::ONE);
    }
    size
}

/// Makes the subsets of lights as small as they must be.  True where it changed them.
pub(crate) fn fit_subsets(direct: &mut Direct, limit: u64) -> bool {
    let most = (limit / PRESAMPLED_LIGHT_SIZE).max(1);
    if direct.subset_count as u64 * direct.subset_size as u64 <= most {
        return false;
    }
    direct.subset_count = (direct.subset_count as u64).min(most) as u32;
    direct.subset_size = (most / direct.subset_count as u64) as u32;
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: u64 = 128 << 20;

    #[test]
    fn what_fits_stays_as_it_is() {
        let settings = Restir::default();
        for size in [UVec2::new(1920, 1080), UVec2::new(2048, 1024), UVec2::ONE] {
            assert_eq!(traced_size(size, &[Domain::Paths], &settings, LIMIT), size);
        }
        let large = UVec2::new(3840, 2160);
        assert_eq!(traced_size(large, &[Domain::Direct], &settings, LIMIT), large);
        assert_eq!(traced_size(large, &[], &settings, LIMIT), large);
    }

    #[test]
    fn what_does_not_fit_keeps_its_shape_and_wastes_little() {
        let settings = Restir::default();
        for (size, domains) in [
            (UVec2::new(3840, 2160), &[Domain::Paths][..]),
            (UVec2::new(2560, 1440), &[Domain::Direct, Domain::Indirect]),
            (UVec2::new(7680, 4320), &[]),
            (UVec2::new(16384, 700), &[Domain::Paths]),
        ] {
            let traced = traced_size(size, domains, &settings, LIMIT);
            let bytes = largest_buffer(traced, domains, &settings);
            assert!(bytes <= LIMIT && bytes as f64 > 0.97 * LIMIT as f64, "{size} as {traced}: {bytes} bytes");
            let shape = (traced.x as f64 / traced.y as f64) / (size.x as f64 / size.y as f64);
            assert!((shape - 1.0).abs() < 0.01, "{size} as {traced}");
        }
        assert_eq!(traced_size(UVec2::new(500, 3), &[Domain::Paths], &settings, 16), UVec2::ONE);
    }

    #[test]
    fn subsets_fit() {
        for limit in [16, 48, 4096, 1 << 20, LIMIT] {
            let mut direct = Direct { subset_count: 128, subset_size: 16384, ..Direct::default() };
            let changed = fit_subsets(&mut direct, limit);
            let entries = direct.subset_count as u64 * direct.subset_size as u64;
            assert!(direct.subset_size > 0 && entries * PRESAMPLED_LIGHT_SIZE <= limit.max(48), "{direct:?}");
            assert_eq!(changed, limit != LIMIT);
        }
    }
}
