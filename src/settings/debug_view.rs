//! The content of a camera's picture: light, or a debug view.

use bevy::reflect::{Reflect, std_traits::ReflectDefault};

/// The content of a camera's picture in place of light.  [`RadianceCapture`](crate::RadianceCapture) receives the values as they are; the view
/// target receives them times [`Restir::debug_scale`](super::Restir::debug_scale), without exposure.  Only the parts of the light
/// ([`Self::DiffuseLight`] and [`Self::SpecularLight`]) have the camera's exposure instead.  Where frames are accumulated, as with
/// [`Restir::accumulate`](super::Restir::accumulate), the values of [`Self::Rays`], [`Self::Bounces`] and the parts of the light are means;
/// those of all other views are of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
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
    /// Motion vector, pixels: from the pixel to the place of its surface in the last frame; x to the right in red, y down in green.  An
    /// object that moves to the right has negative red.
    Motion,
    /// Shading normals, world space, from -1..1 to 0..1.
    Normals,
    /// Base color.
    Albedo,
    /// Lights of the stored samples, in false colors; black: no sample.  Needs direct light in reservoirs of its
    /// own: [`Technique::Di`](super::Technique::Di), [`Technique::Gi`](super::Technique::Gi), or [`Technique::Pt`](super::Technique::Pt) with
    /// [`Paths::separate_direct_light`](super::Paths::separate_direct_light).
    ReservoirLights,
    /// Position of the stored sample on its light: two coordinates from 0 to 1, in red and green.  Needs the techniques of
    /// [`Self::ReservoirLights`].
    ReservoirPoints,
    /// Unbiased contribution weights of the stored samples, in the measure of their lights.  Needs the techniques of
    /// [`Self::ReservoirLights`].
    ReservoirWeights,
    /// Confidence of the reservoirs, in frames' worth of candidates.  Needs the techniques of [`Self::ReservoirLights`].
    ReservoirConfidence,
    /// Visibility of the stored sample when it was shaded: green, or red where it was occluded; black: no sample.  Needs the techniques of
    /// [`Self::ReservoirLights`].
    ReservoirVisibility,
    /// Ends of the stored paths: next-event estimation in red, an emitter that was hit in green, the environment in blue, a connection with
    /// a light path in yellow.  Needs [`Technique::Pt`](super::Technique::Pt), [`Technique::Gi`](super::Technique::Gi) or
    /// [`Technique::Bdpt`](super::Technique::Bdpt).
    PathEnds,
    /// Scattering events of the stored paths.  Needs the techniques of [`Self::PathEnds`].
    PathLengths,
    /// Index of the reconnection vertex, from 2; 0: the whole path is replayed.  Needs the techniques of [`Self::PathEnds`].
    PathReconnections,
    /// Unbiased contribution weights of the stored paths, in their own measure.  Needs the techniques of [`Self::PathEnds`].
    PathWeights,
    /// Confidence of the reservoirs, in frames' worth of candidates.  Needs the techniques of [`Self::PathEnds`].
    PathConfidence,
    /// Frames since the stored paths were sampled.  Needs the techniques of [`Self::PathEnds`].
    PathAges,
    /// Reason why a stored path cannot be shifted 8 pixels to the right, in false colors; white: it can.  Needs the techniques of
    /// [`Self::PathEnds`].
    PathShifts,
    /// Jacobian of that shift; 0 where it is undefined; 1 for `Gi`, whose measure needs none.  Needs the techniques of [`Self::PathEnds`].
    PathJacobians,
    /// Rays that the technique traced for a pixel in this frame.  All passes get other pipelines for this view and for [`Self::Guards`],
    /// unless rays are counted ([`RestirStatistics::count_rays`](crate::RestirStatistics::count_rays)).
    Rays,
    /// Scattering events of a path of the reference tracer after the first surface, whatever the technique: 0 where there is no surface or
    /// all light is absorbed, at most [`Restir::bounces`](super::Restir::bounces).  Russian roulette ends paths from the third event on.
    Bounces,
    /// Techniques (s, t) that found the stored paths: s vertices from the light in red, t from the camera in green.  Needs
    /// [`Technique::Bdpt`](super::Technique::Bdpt).
    PathTechniques,
    /// Scattering events of the stored light paths, which the camera sees (t = 1).  Needs [`Technique::Bdpt`](super::Technique::Bdpt) with
    /// other [`Bdpt::techniques`](super::Bdpt::techniques) than [`LightTechniques::NoLightTracing`](super::LightTechniques::NoLightTracing).
    LightPathLengths,
    /// Unbiased contribution weights of the stored light paths, in their own measure.  Needs the techniques of [`Self::LightPathLengths`].
    LightPathWeights,
    /// Confidence of the reservoirs of light paths, in frames' worth of candidates.  Needs the techniques of [`Self::LightPathLengths`].
    LightPathConfidence,
    /// Frames since the stored light paths were sampled.  Needs the techniques of [`Self::LightPathLengths`].
    LightPathAges,
    /// The diffuse part of the light, cd/m²: what the surface of a pixel reflects or transmits diffusely, and light that leaves a body with
    /// [`Subsurface`](crate::Subsurface).  This view and the next one run whole frames of the technique, with its history, and have the
    /// camera's exposure.  The sum of both views and of the light that surfaces and the sky emit towards the camera is the picture, if seed,
    /// settings and number of frames since a reset are the same and the picture has no
    /// [`Restir::firefly_limit`](super::Restir::firefly_limit), which these views ignore.  They use no memory and have no bias.  Cost: one more
    /// evaluation of the surface's lobes for each sample that is shaded; with [`Technique::Bdpt`](super::Technique::Bdpt), light paths
    /// that the camera sees are traced again.
    DiffuseLight,
    /// The specular part of the light, cd/m²: all other light that the surface of a pixel reflects or transmits, by clearcoats, too.
    SpecularLight,
    /// Pixels that raised a guard in this frame alone, in false colors by the set of guards; black: none, as everywhere if all is well.
    /// [`RestirReport::guards`](crate::RestirReport::guards) has the names.
    Guards,
    /// Light that enters objects with [`Subsurface`](crate::Subsurface): the distance from the surface of a pixel to the point where the light
    /// of its stored sample enters, up to 19.86; black: no sample.  The unit is the length d of the diffusion profile (Burley 2015) of the color
    /// that scatters farthest; d is the mean free path over 1.1 for a base color of 0.8.  The hybrid shift treats points from 2 d on as far.
    /// This view and the next four need [`Technique::Di`](super::Technique::Di),
    /// [`Technique::Gi`](super::Technique::Gi), or [`Technique::Pt`](super::Technique::Pt) with
    /// [`Paths::separate_direct_light`](super::Paths::separate_direct_light), and are black in a scene without such objects.  They run no other
    /// resampling than that of this light, and cost no memory.  This view and the next one evaluate the surface of each pixel once more.
    SubsurfaceDistances,
    /// Shift that [`SubsurfaceShift::Hybrid`](super::SubsurfaceShift::Hybrid) chooses for the stored sample, whatever
    /// [`SubsurfaceSampling::shift`](super::SubsurfaceSampling::shift) is: green, reconnection, because the light enters far away or on a face
    /// that looks elsewhere; red, delayed reconnection; black: no sample.
    SubsurfaceReconnections,
    /// Unbiased contribution weights of the stored samples, in the measure of the triangle where light enters (whose whole area counts as 1)
    /// times that of the light.
    SubsurfaceWeights,
    /// Confidence of the reservoirs of this light, in frames' worth of candidates; black: no light scatters below the surface.
    SubsurfaceConfidence,
    /// Shift of the stored sample to the pixel 8 pixels to the right, as the first iteration of reuse would do it:
    ///
    /// - white: the shift succeeds;
    /// - red: the shift is undefined.  That pixel shows another object or a surface without scattering below it, or the probe of the sample
    ///   hits nothing, or the light enters out of reach, or the hybrid shift chooses the other one of its two shifts;
    /// - blue: the light does not shine on the point where it would enter;
    /// - yellow: that point is in shadow;
    /// - black: there is no sample, or no surface 8 pixels to the right.
    ///
    /// Frames do not store which of their own shifts fail, so this one is computed for the view: one shift and up to two rays per pixel,
    /// which [`Self::Rays`] does not count.
    SubsurfaceShifts,
    /// Light paths that the camera sees in a pixel in this frame: the length of the pixel's list.  Bright pixels have long lists, which
    /// take long.  A light path has one entry for each of its vertices that the camera sees, but at most three; the third one stands for all
    /// further vertices.  0 in a scene with objects that only the camera or only other rays see.  Needs
    /// [`Technique::Bdpt`](super::Technique::Bdpt) with other [`Bdpt::techniques`](super::Bdpt::techniques) than
    /// [`LightTechniques::NoLightTracing`](super::LightTechniques::NoLightTracing).  Costs one more walk through each list.
    LightPathCounts,
    /// Numbers of vertices of light paths for connections.  Green: all vertices that can be connected.  Red: the stored ones, at most one for
    /// each light path, which stands for all of its vertices.  A pixel shows the numbers of the light paths that its invocation traces,
    /// [`Bdpt::light_paths`](super::Bdpt::light_paths) of them on average.  These paths may hit surfaces anywhere, so that only sums over the
    /// picture have a meaning.  0 without connections ([`LightTechniques::Lightweight`](super::LightTechniques::Lightweight)).
    /// Needs [`Technique::Bdpt`](super::Technique::Bdpt).  Costs one read of each stored vertex.
    LightVertices,
}

impl DebugView {
    /// Whether it shows light or a part of it.  Such views have the camera's exposure, and the others
    /// [`Restir::debug_scale`](super::Restir::debug_scale).
    pub fn shows_light(self) -> bool {
        self == Self::Off || self.is_part_of_light()
    }

    /// Whether it shows a part of the light.
    pub fn is_part_of_light(self) -> bool {
        matches!(self, Self::DiffuseLight | Self::SpecularLight)
    }

    /// Whether it shows numbers that passes count for each pixel.
    pub(crate) fn shows_counts(self) -> bool {
        matches!(self, Self::Rays | Self::Guards)
    }

    /// Whether it shows reservoirs of direct light on surfaces.
    pub(crate) fn is_of_direct_light(self) -> bool {
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

    /// Whether it shows reservoirs of light that enters objects with [`Subsurface`](crate::Subsurface).
    pub(crate) fn is_of_subsurface(self) -> bool {
        (Self::SubsurfaceDistances as u32..=Self::SubsurfaceShifts as u32).contains(&(self as u32))
    }

    /// Whether it shows reservoirs of paths that are weighted against light paths.
    pub(crate) fn is_of_bidirectional_paths(self) -> bool {
        self.is_of_paths() || self == Self::PathTechniques
    }
}
