//! Choice of the frames whose primary rays are jittered.

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

/// When primary rays move within the pixel from frame to frame (box filter), so that means of frames have smooth edges.  Without jitter all
/// rays pass through the centers of pixels: edges alias, but keep their histories, so that single frames have less noise there.
///
/// On a camera with Bevy's `TemporalJitter`, which `TemporalAntiAliasing` and upscalers bring, that jitter is used instead.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum Jitter {
    /// Where frames are averaged: with [`Restir::accumulate`](super::Restir::accumulate), and by
    /// [`Technique::Reference`](super::Technique::Reference).  Not where pixels without a surface show what lies behind the image (no sky, and
    /// `ClearColorConfig::None` or a transparent clear color), because each pixel is either covered or not: moving edges would flicker.
    #[default]
    Auto,
    /// In every frame.  For apps that average frames themselves.  Single frames have more error at edges (`docs/experiments.md`).
    Always,
    /// In no frame.
    Never,
}
