//! Presets: sets of settings for a purpose.

use bevy::reflect::Reflect;

use super::{BiasCorrection, Denoiser, Direct, Paths, Restir, Reuse, SuffixRetrace, VisibilityReuse};

/// A trade of speed for accuracy: see [`Restir::preset`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Preset {
    /// Fewest rays: one neighbor for paths, and one reservoir for direct and bounced light in [`Technique::Pt`](super::Technique::Pt) (more
    /// noise).  Five bounces: later light is missing (darker).  In
    /// [`Technique::Di`](super::Technique::Di) and [`Technique::Gi`](super::Technique::Gi) direct light is resampled as by Wyman and
    /// Panteleev 2021, with visibility reused within 30 pixels: shadows are blurred and lag (brighter in them, darker beside them).  Under
    /// motion, paths miss light that was hidden from their later vertices in the last frame (darker; [`SuffixRetrace::ForwardOnly`]).
    /// Single bright pixels are limited (darker; [`Restir::firefly_limit`]), and the denoiser blurs fine shadows ([`Restir::denoiser`]).
    Performance,
    /// The default.  Eight bounces: later light is missing (darker).  Single bright pixels are limited (darker; [`Restir::firefly_limit`]),
    /// and the denoiser blurs fine shadows ([`Restir::denoiser`]).  No other bias.
    #[default]
    Balanced,
    /// As `Balanced`, with sixteen bounces, and only brighter pixels are limited (10 times the brightest pixel around, instead of 2.5).
    Quality,
    /// For pictures that are averaged or filtered elsewhere: 32 bounces, no limit and no denoiser.  Only later light is missing (darker).
    /// Single frames are noisy.
    Unbiased,
}

impl Preset {
    /// All presets, the fastest first.
    pub const ALL: [Self; 4] = [Self::Performance, Self::Balanced, Self::Quality, Self::Unbiased];

    fn bounces(self) -> u32 {
        match self {
            Self::Performance => 5,
            Self::Balanced => 8,
            Self::Quality => 16,
            Self::Unbiased => 32,
        }
    }

    fn firefly_limit(self) -> f32 {
        match self {
            Self::Performance | Self::Balanced => 2.5,
            Self::Quality => 10.0,
            Self::Unbiased => 0.0,
        }
    }

    fn denoiser(self) -> Denoiser {
        match self {
            Self::Performance | Self::Balanced | Self::Quality => Denoiser::ON,
            Self::Unbiased => Denoiser::OFF,
        }
    }

    fn direct(self) -> Direct {
        match self {
            Self::Performance => Direct {
                bias_correction: BiasCorrection::HeuristicsAndMis,
                visibility: VisibilityReuse::Decoupled,
                visibility_radius: 30.0,
                // The geometry heuristics limit the bias.
                reuse: Reuse {
                    spatial_samples: 1,
                    neighbor_attempts: 1,
                    normal_threshold: 0.9,
                    ..Reuse::SPATIOTEMPORAL
                },
                ..Direct::default()
            },
            Self::Balanced | Self::Quality | Self::Unbiased => Direct::default(),
        }
    }

    fn paths(self) -> Paths {
        match self {
            Self::Performance => Paths {
                suffix_retrace: SuffixRetrace::ForwardOnly,
                separate_direct_light: false,
                reuse: Reuse { spatial_samples: 1, disocclusion_samples: 2, ..Reuse::PATHS },
                ..Paths::default()
            },
            Self::Balanced | Self::Quality | Self::Unbiased => Paths::default(),
        }
    }
}

impl Restir {
    /// The settings of a preset, for [`Technique::Pt`](super::Technique::Pt); another technique uses its part of them.
    pub fn preset(preset: Preset) -> Self {
        Self::default().with_preset(preset)
    }

    /// These settings with the bounces, the limit of fireflies, the denoiser, the direct light and the paths of a preset.  All other fields
    /// stay as they are.
    #[must_use]
    pub fn with_preset(self, preset: Preset) -> Self {
        Self {
            bounces: preset.bounces(),
            firefly_limit: preset.firefly_limit(),
            denoiser: preset.denoiser(),
            direct: preset.direct(),
            paths: preset.paths(),
            ..self
        }
    }
}
