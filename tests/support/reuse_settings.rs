//! Settings of direct light and of paths that the tests share.

use bevy_restir::{BiasCorrection, Direct, Mis, Paths, Reuse, SubsurfaceSampling};

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
            reuse: Reuse {
                spatial_samples: 2,
                radius: pixels(6.0, 32),
                confidence_cap: 20.0,
                mis: Mis::DefensivePairwise,
                ..Reuse::SPATIOTEMPORAL
            },
            candidates: 8,
            subset_count: 32,
            subset_size: 256,
            ..Default::default()
        }
    }

    pub fn candidates_only() -> Direct {
        Direct { reuse: Reuse { temporal: false, spatial_samples: 0, ..all_reuse().reuse }, ..all_reuse() }
    }

    pub fn temporal() -> Direct {
        Direct { reuse: Reuse { spatial_samples: 0, ..all_reuse().reuse }, ..all_reuse() }
    }

    pub fn spatial() -> Direct {
        Direct { reuse: Reuse { temporal: false, spatial_samples: 3, ..all_reuse().reuse }, ..all_reuse() }
    }

    /// One neighbor in a circle, and a long history, as in Wyman and Panteleev 2021.
    pub fn one_neighbor(radius: f32) -> Reuse {
        Reuse { spatial_samples: 1, radius, confidence_cap: 20.0, ..Reuse::SPATIOTEMPORAL }
    }

    /// Accepts neighbors across edges, so that only the MIS weights keep the picture right.  The history is short: a long one would
    /// produce rare bright pixels, and the mean of a few restarts would no longer be normally distributed.
    pub fn across_edges(mis: Mis) -> Direct {
        Direct {
            reuse: Reuse {
                mis,
                spatial_samples: 3,
                radius: pixels(10.0, 32),
                confidence_cap: 4.0,
                ..all_reuse().reuse
            },
            bias_correction: BiasCorrection::UnbiasedMis,
            ..all_reuse()
        }
    }
}

/// Settings of light that enters translucent bodies.
pub mod subsurface {
    use super::*;

    /// Every kind of reuse, also across edges, and so few candidates that a wrong weight shows.
    pub fn all_reuse() -> SubsurfaceSampling {
        let default = SubsurfaceSampling::default();
        SubsurfaceSampling {
            // Two iterations, because the sequential shift has one shift in each.
            reuse: Reuse {
                radius: pixels(6.0, 32),
                spatial_samples: 1,
                disocclusion_samples: 2,
                spatial_iterations: 2,
                confidence_cap: 8.0,
                ..default.reuse
            },
            candidates: 4,
            heuristics: false,
            ..default
        }
    }

    pub fn candidates_only() -> SubsurfaceSampling {
        SubsurfaceSampling { reuse: Reuse { temporal: false, spatial_samples: 0, ..all_reuse().reuse }, ..all_reuse() }
    }

    pub fn temporal() -> SubsurfaceSampling {
        SubsurfaceSampling { reuse: Reuse { spatial_samples: 0, ..all_reuse().reuse }, ..all_reuse() }
    }

    pub fn spatial() -> SubsurfaceSampling {
        SubsurfaceSampling { reuse: Reuse { temporal: false, ..all_reuse().reuse }, ..all_reuse() }
    }
}

/// Settings of paths, for ReSTIR PT and ReSTIR GI.
pub mod paths {
    use super::*;

    /// The defaults, with direct light as a part of the paths.
    pub fn unified() -> Paths {
        Paths { separate_direct_light: false, ..Paths::default() }
    }

    /// Every kind of reuse, also across edges, and so few candidates that a wrong weight shows.
    pub fn all_reuse() -> Paths {
        Paths {
            // `techniques::pairs` tests pairs.
            reuse: Reuse {
                radius: pixels(6.0, 32),
                spatial_samples: 2,
                // More would need another variant of the shaders.
                disocclusion_samples: 2,
                paired: false,
                confidence_cap: 8.0,
                ..Reuse::PATHS
            },
            candidates: 4,
            heuristics: false,
            ..unified()
        }
    }

    pub fn candidates_only() -> Paths {
        Paths { reuse: Reuse { temporal: false, spatial_samples: 0, ..all_reuse().reuse }, ..all_reuse() }
    }

    pub fn temporal() -> Paths {
        Paths { reuse: Reuse { spatial_samples: 0, ..all_reuse().reuse }, ..all_reuse() }
    }

    pub fn spatial() -> Paths {
        Paths { reuse: Reuse { temporal: false, ..all_reuse().reuse }, ..all_reuse() }
    }
}
