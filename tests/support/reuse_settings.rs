//! Settings of direct light and of paths that the tests share.

use bevy_restir::{BiasCorrection, Direct, Mis, Paths};

/// A length of `count` pixels in a picture of this height, in the unit of the settings: pixels of a picture 1080 high.
pub fn pixels(count: f32, height: u32) -> f32 {
    count * 1080.0 / height as f32
}

/// Settings of direct light.
pub mod di {
    use super::*;

    /// Every kind of reuse, and so few candidates that a wrong weight shows.
    pub fn all_reuse() -> Direct {
        Direct {
            candidates: 8,
            subset_count: 32,
            subset_size: 256,
            spatial_taps: 2,
            radius: pixels(6.0, 32),
            mis: Mis::DefensivePairwise,
            ..Default::default()
        }
    }

    pub fn candidates_only() -> Direct {
        Direct { temporal: false, spatial_taps: 0, ..all_reuse() }
    }

    pub fn temporal() -> Direct {
        Direct { spatial_taps: 0, ..all_reuse() }
    }

    pub fn spatial() -> Direct {
        Direct { temporal: false, spatial_taps: 3, ..all_reuse() }
    }

    /// Accepts neighbors across edges, so that only the MIS weights keep the picture right.  The history is short: a long one would
    /// produce rare bright pixels, and the mean of a few restarts would no longer be normally distributed.
    pub fn across_edges(mis: Mis) -> Direct {
        Direct {
            mis,
            bias_correction: BiasCorrection::UnbiasedMis,
            spatial_taps: 3,
            radius: pixels(10.0, 32),
            confidence_cap: 4.0,
            ..all_reuse()
        }
    }
}

/// Settings of paths, for ReSTIR PT and ReSTIR GI.
pub mod paths {
    use super::*;

    /// Every kind of reuse, also across edges, and so few candidates that a wrong weight shows.
    pub fn all_reuse() -> Paths {
        Paths {
            candidates: 4,
            radius: pixels(6.0, 32),
            spatial_taps: 2,
            heuristics: false,
            confidence_cap: 8.0,
            ..Default::default()
        }
    }

    pub fn candidates_only() -> Paths {
        Paths { temporal: false, spatial_taps: 0, ..all_reuse() }
    }

    pub fn temporal() -> Paths {
        Paths { spatial_taps: 0, ..all_reuse() }
    }

    pub fn spatial() -> Paths {
        Paths { temporal: false, ..all_reuse() }
    }
}
