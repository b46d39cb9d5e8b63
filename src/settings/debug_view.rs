//! What a camera shows: light, or a debug view.

use bevy::reflect::Reflect;

/// Image of a camera instead of light.  [`RadianceCapture`](crate::RadianceCapture) receives the values as they are; the view target
/// receives them times [`Restir::debug_scale`](super::Restir::debug_scale), without exposure.  Only the parts of the light
/// ([`Self::DiffuseLight`] and [`Self::SpecularLight`]) have the camera's exposure instead.  Where frames are accumulated (`Rays` and
/// `Bounces` of the reference tracer, and everything with [`Restir::accumulate`](super::Restir::accumulate)) values are means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
#[repr(u32)]
pub enum DebugView {
    /// Light.
    #[default]
    Off,
    /// Instances of the visibility buffer, in false colors.
    Instances,
    /// Triangles of the visibility buffer, in false colors.
    Triangles,
    /// Instances that a traced primary ray hits, in the same colors.  Objects that cast no shadow are missing: traced rays pass them.
    TracedInstances,
    /// Triangles that a traced primary ray hits, in the same colors.
    TracedTriangles,
    /// Distance from the camera, m.
    Depth,
    /// Motion since the last frame, pixels: x to the right in red, y down in green.  Adding it leads to the surface in the last frame.
    Motion,
    /// Shading normals, world space, from -1..1 to 0..1.
    Normals,
    /// Base color.
    Albedo,
    /// Lights of the stored samples, in false colors; black: no sample.  This view and the next four need
    /// [`Technique::Di`](super::Technique::Di), [`Technique::Gi`](super::Technique::Gi), or [`Technique::Pt`](super::Technique::Pt) with
    /// [`Paths::separate_direct_light`](super::Paths::separate_direct_light).
    ReservoirLights,
    /// Position of the stored sample on its light: two coordinates from 0 to 1, in red and green.
    ReservoirPoints,
    /// Unbiased contribution weights of the stored samples, in the measure of their lights.
    ReservoirWeights,
    /// Confidence of the reservoirs, in frames' worth of candidates.
    ReservoirConfidence,
    /// Visibility of the stored sample when it was shaded: green, or red where it was occluded; black: no sample.
    ReservoirVisibility,
    /// Ends of the stored paths: next-event estimation in red, an emitter that was hit in green, the environment in blue.  This view and
    /// the next seven need [`Technique::Pt`](super::Technique::Pt), [`Technique::Gi`](super::Technique::Gi) or
    /// [`Technique::Bdpt`](super::Technique::Bdpt).
    PathEnds,
    /// Scattering events of the stored paths.
    PathLengths,
    /// Index of the reconnection vertex, from 2; 0: the whole path is replayed.
    PathReconnections,
    /// Unbiased contribution weights of the stored paths, in their own measure.
    PathWeights,
    /// Confidence of the reservoirs, in frames' worth of candidates.
    PathConfidence,
    /// Frames since the stored paths were sampled.
    PathAges,
    /// Reason why a stored path cannot be shifted 8 pixels to the right, in false colors; white: it can.
    PathShifts,
    /// Jacobian of that shift; 0 where it is undefined; 1 for `Gi`, whose measure needs none.
    PathJacobians,
    /// Rays that the technique traced for a pixel in this frame.
    Rays,
    /// Scattering events of a path of the reference tracer after the first surface, whatever the technique: 0 where there is no surface or
    /// all light is absorbed, at most [`Restir::bounces`](super::Restir::bounces).  Russian roulette ends paths from the third event on.
    Bounces,
    /// Techniques (s, t) that found the stored paths: s vertices from the light in red, t from the camera in green.  This view and the next
    /// four need [`Technique::Bdpt`](super::Technique::Bdpt).
    PathTechniques,
    /// Scattering events of the stored light paths, which the camera sees (t = 1).
    LightPathLengths,
    /// Unbiased contribution weights of the stored light paths, in their own measure.
    LightPathWeights,
    /// Confidence of the reservoirs of light paths, in frames' worth of candidates.
    LightPathConfidence,
    /// Frames since the stored light paths were sampled.
    LightPathAges,
    /// The diffuse part of the light, cd/m²: what the surface of a pixel reflects or transmits diffusely, and light that leaves a body with
    /// [`Subsurface`](crate::Subsurface).  This view and the next one run whole frames of the technique, with its history, and have the
    /// camera's exposure.  Both views plus the light that surfaces and the sky emit towards the camera sum to the picture, if seed,
    /// settings and number of frames since a reset are the same and the picture has no
    /// [`Restir::firefly_limit`](super::Restir::firefly_limit), which these views ignore.  They add no bias.  They cost no memory, and one
    /// more evaluation of the surface's lobes for each sample that is shaded; with [`Technique::Bdpt`](super::Technique::Bdpt) light paths
    /// that the camera sees are traced again.
    DiffuseLight,
    /// The specular part of the light, cd/m²: all other light that the surface of a pixel reflects or transmits, by clearcoats, too.
    SpecularLight,
    /// Pixels that raised a guard in this frame alone, in false colors by the set of guards; black: none, as everywhere if all is well.
    /// [`RestirReport::guards`](crate::RestirReport::guards) has the names.
    Guards,
}

impl DebugView {
    /// Whether it shows light, all or a part, which is exposed.
    pub fn shows_light(self) -> bool {
        self == Self::Off || self.is_part_of_light()
    }

    /// Whether it shows a part of the light.
    pub fn is_part_of_light(self) -> bool {
        matches!(self, Self::DiffuseLight | Self::SpecularLight)
    }

    /// Whether it shows reservoirs of direct light.
    pub fn is_of_reservoirs(self) -> bool {
        (Self::ReservoirLights as u32..=Self::ReservoirVisibility as u32).contains(&(self as u32))
    }

    /// Whether it shows reservoirs of paths.
    pub fn is_of_paths(self) -> bool {
        (Self::PathEnds as u32..=Self::PathJacobians as u32).contains(&(self as u32))
    }

    /// Whether it shows reservoirs of light paths.
    pub fn is_of_light_paths(self) -> bool {
        (Self::LightPathLengths as u32..=Self::LightPathAges as u32).contains(&(self as u32))
    }

    /// Whether it shows reservoirs of paths that are weighted against light paths.
    pub fn is_of_bidirectional_paths(self) -> bool {
        self.is_of_paths() || self == Self::PathTechniques
    }
}
