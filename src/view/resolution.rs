//! The traced resolution.  It and the light subsets are reduced to what the device can bind, so that a small device limits quality instead of
//! failing.

use bevy::math::UVec2;

use super::{history::reservoir_bytes, pixels};
use crate::{
    gpu_layout::PRESAMPLED_LIGHT_SIZE,
    settings::{Direct, Restir},
    technique::domain::Domain,
};

/// Size of the largest buffer of a view, bytes: its radiance or the reservoirs of a domain.
fn largest_buffer(size: UVec2, domains: &[&Domain], settings: &Restir) -> u64 {
    let reservoirs = domains.iter().map(|domain| reservoir_bytes(size, domain, settings));
    reservoirs.fold(pixels(size) * 16, u64::max)
}

/// The resolution that [`Restir::resolution_scale`] asks for.
pub fn wanted_size(viewport: UVec2, scale: f32) -> UVec2 {
    (viewport.as_vec2() * scale).round().as_uvec2().clamp(UVec2::ONE, viewport)
}

/// Traced resolution where this one is wanted: itself, or the largest one of nearly the same aspect ratio that the device can bind.
pub(crate) fn traced_size(wanted: UVec2, domains: &[&Domain], settings: &Restir, limit: u64) -> UVec2 {
    let mut size = wanted;
    let mut scale = 1.0f64;
    while size != UVec2::ONE && largest_buffer(size, domains, settings) > limit {
        // Tiles at the edge of the image are complete, so the first guess may be slightly too large.
        let share = limit as f64 / largest_buffer(size, domains, settings) as f64;
        scale *= share.sqrt().min(0.999);
        size = (wanted.as_dvec2() * scale).as_uvec2().max(UVec2::ONE);
    }
    size
}

/// Reduces number and size of the light subsets to the limit.  Returns whether they have changed.
pub(crate) fn fit_subsets(direct: &mut Direct, limit: u64) -> bool {
    let max_entries = (limit / PRESAMPLED_LIGHT_SIZE).max(1);
    if direct.subset_count as u64 * direct.subset_size as u64 <= max_entries {
        return false;
    }
    direct.subset_count = (direct.subset_count as u64).min(max_entries) as u32;
    direct.subset_size = (max_entries / direct.subset_count as u64) as u32;
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        settings::Technique,
        technique::{RowChoice, row},
    };

    fn domains(technique: Technique) -> &'static [&'static Domain] {
        row(technique, RowChoice::default()).domains
    }

    const LIMIT: u64 = 128 << 20;

    #[test]
    fn a_view_that_fits_is_not_scaled() {
        let settings = Restir::default();
        for size in [UVec2::new(1920, 1080), UVec2::new(2048, 1024), UVec2::ONE] {
            assert_eq!(traced_size(size, domains(Technique::Pt), &settings, LIMIT), size);
        }
        let large = UVec2::new(3840, 2160);
        assert_eq!(traced_size(large, domains(Technique::Di), &settings, LIMIT), large);
        assert_eq!(traced_size(large, &[], &settings, LIMIT), large);
    }

    #[test]
    fn the_resolution_scale_is_that_of_width_and_height() {
        let viewport = UVec2::new(1280, 721);
        let sizes = [1.0, 0.5, 0.25].map(|scale| wanted_size(viewport, scale).to_array());
        assert_eq!(sizes, [[1280, 721], [640, 361], [320, 180]]);
        assert_eq!(wanted_size(UVec2::ONE, 0.25), UVec2::ONE);
    }

    #[test]
    fn a_scaled_view_keeps_its_aspect_ratio_and_wastes_little() {
        let settings = Restir::default();
        for (size, domains) in [
            (UVec2::new(3840, 2160), domains(Technique::Pt)),
            (UVec2::new(2560, 1440), domains(Technique::Gi)),
            (UVec2::new(7680, 4320), domains(Technique::Reference)),
            (UVec2::new(16384, 700), domains(Technique::Pt)),
        ] {
            let traced = traced_size(size, domains, &settings, LIMIT);
            let bytes = largest_buffer(traced, domains, &settings);
            assert!(bytes <= LIMIT && bytes as f64 > 0.97 * LIMIT as f64, "{size} as {traced}: {bytes} bytes");
            let shape = (traced.x as f64 / traced.y as f64) / (size.x as f64 / size.y as f64);
            assert!((shape - 1.0).abs() < 0.01, "{size} as {traced}");
        }
        assert_eq!(traced_size(UVec2::new(500, 3), domains(Technique::Pt), &settings, 16), UVec2::ONE);
    }

    #[test]
    fn subsets_are_reduced_to_the_limit() {
        for limit in [16, 48, 4096, 1 << 20, LIMIT] {
            let mut direct = Direct { subset_count: 128, subset_size: 16384, ..Direct::default() };
            let changed = fit_subsets(&mut direct, limit);
            let entries = direct.subset_count as u64 * direct.subset_size as u64;
            assert!(direct.subset_size > 0 && entries * PRESAMPLED_LIGHT_SIZE <= limit.max(48), "{direct:?}");
            assert_eq!(changed, limit != LIMIT);
        }
    }
}
