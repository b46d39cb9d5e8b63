//! Subsurface scattering of one object, and settings of its resampling.

use super::{
    Reuse, ReuseOrder,
    validate::{Problem, Ranges},
};
use bevy::{
    ecs::{component::Component, reflect::ReflectComponent},
    math::Vec3,
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// Lets light that enters an object with a `StandardMaterial` leave it elsewhere: skin, wax, marble, milk.  Put it on the entity of the mesh.
/// It replaces a share of the diffuse reflection; specular reflection, clearcoat and transmission stay as they are.
///
/// Light spreads by the diffusion profile of Burley (2015), with the lengths of Christensen and Burley (2015) for the base color of the point
/// where it leaves, and only within one object.  Lengths are meters in world space, whatever the scale of the object.  The profile is that of
/// a plane: thin parts are too bright, and small objects too dark.  Seen from behind, a surface is diffuse, so meshes must face outward; open
/// meshes are allowed.  Objects with `NotShadowCaster` are diffuse, because rays do not find them.
///
/// Every technique renders it.  A path that hits such an object chooses at random between the surface and the scattering below it.
/// Direct light that enters objects has reservoirs of its own in [`Technique::Di`](crate::Technique::Di),
/// [`Technique::Gi`](crate::Technique::Gi), and [`Technique::Pt`](crate::Technique::Pt) with
/// [`Paths::separate_direct_light`](crate::Paths::separate_direct_light); [`SubsurfaceSampling`] has their settings.  Light paths of
/// [`Technique::Bdpt`](crate::Technique::Bdpt) end where they enter an object.  It costs one ray per path and hit of such an object, and a
/// shadow ray; scenes without such objects pay nothing.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// # fn setup(mut commands: Commands, mesh: Handle<Mesh>, material: Handle<StandardMaterial>) {
/// commands.spawn((Mesh3d(mesh), MeshMaterial3d(material), Subsurface { mean_free_path: Vec3::new(0.004, 0.001, 0.0005), weight: 1.0 }));
/// # }
/// ```
#[derive(Component, Clone, Copy, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Component, Default)]
pub struct Subsurface {
    /// Mean free path of light in the red, green and blue channel, meters: the longer, the softer.  A channel with 0, and one whose path is
    /// below about a hundredth of a pixel, is diffuse.  If it exceeds the size of the object, the object is much too dark.  0 to
    /// [`Self::MAX_MEAN_FREE_PATH`]; default 0.001 in all channels.
    pub mean_free_path: Vec3,
    /// Share of diffuse reflection that scatters below the surface.  0 to 1; default 1.
    pub weight: f32,
}

impl Subsurface {
    /// Greatest mean free path, meters.
    pub const MAX_MEAN_FREE_PATH: f32 = 1e6;
    /// A shorter mean free path counts as 0, meters.
    const MIN_MEAN_FREE_PATH: f32 = 1e-15;

    /// Brings every field into its range.  Returns a warning for each field that it changed.
    pub(crate) fn validate(&mut self) -> Vec<String> {
        let mut warnings = Vec::new();
        for (length, channel) in self.mean_free_path.as_mut().iter_mut().zip(["red", "green", "blue"]) {
            let used = match *length {
                l if l.is_nan() || l < 0.0 => 0.0,
                l if l > Self::MAX_MEAN_FREE_PATH => Self::MAX_MEAN_FREE_PATH,
                l => l,
            };
            if *length != used {
                warnings.push(format!("its mean free path for {channel} is {length} m ({used} m is used)"));
            }
            *length = if used < Self::MIN_MEAN_FREE_PATH { 0.0 } else { used };
        }
        let weight = if self.weight.is_nan() { 0.0 } else { self.weight.clamp(0.0, 1.0) };
        if weight != self.weight {
            warnings.push(format!("its weight is {} ({weight} is used)", self.weight));
            self.weight = weight;
        }
        warnings
    }
}

/// Materials with measured coefficients, per millimeter: reduced scattering and absorption.
macro_rules! measured {
    ($($name:ident: $what:literal, $scattering:expr, $absorption:expr;)*) => {
        /// Measured materials (Jensen et al. 2001, Fig. 5).  The lengths are 1/(σs' + σa); each constant names the base color that was
        /// measured with them, in linear Rec. 709.
        impl Subsurface {
            $(
                #[doc = $what]
                pub const $name: Self = Self::measured($scattering, $absorption);
            )*
        }
    };
}

measured! {
    APPLE: "Apple; base color 0.85, 0.84, 0.53.", [2.29, 2.39, 1.97], [0.003, 0.0034, 0.046];
    CHICKEN: "Chicken; base color 0.31, 0.15, 0.10.", [0.15, 0.21, 0.38], [0.015, 0.077, 0.19];
    CREAM: "Cream; base color 0.98, 0.90, 0.73.", [7.38, 5.47, 3.15], [0.0002, 0.0028, 0.0163];
    KETCHUP: "Ketchup; base color 0.16, 0.01, 0.00.", [0.18, 0.07, 0.03], [0.061, 0.97, 1.45];
    MARBLE: "Marble; base color 0.83, 0.79, 0.75.", [2.19, 2.62, 3.0], [0.0021, 0.0041, 0.0071];
    POTATO: "Potato; base color 0.77, 0.62, 0.21.", [0.68, 0.7, 0.55], [0.0024, 0.009, 0.12];
    SKIM_MILK: "Skim milk; base color 0.81, 0.81, 0.69.", [0.7, 1.22, 1.9], [0.0014, 0.0025, 0.0142];
    SKIN: "Skin; base color 0.44, 0.22, 0.13.", [0.74, 0.88, 1.01], [0.032, 0.17, 0.48];
    PALE_SKIN: "Pale skin; base color 0.63, 0.44, 0.34.", [1.09, 1.59, 1.79], [0.013, 0.07, 0.145];
    WHOLE_MILK: "Whole milk; base color 0.91, 0.88, 0.76.", [2.55, 3.21, 3.77], [0.0011, 0.0024, 0.014];
}

impl Subsurface {
    /// A material with these coefficients per millimeter.
    const fn measured(scattering: [f32; 3], absorption: [f32; 3]) -> Self {
        let [r, g, b] = scattering;
        let [s, t, u] = absorption;
        Self { mean_free_path: Vec3::new(0.001 / (r + s), 0.001 / (g + t), 0.001 / (b + u)), weight: 1.0 }
    }
}

impl Default for Subsurface {
    /// A millimeter in all channels, with full weight.
    fn default() -> Self {
        Self { mean_free_path: Vec3::splat(0.001), weight: 1.0 }
    }
}

/// Shift mapping that takes a sample of light that enters an object from pixel to pixel (Werner et al. 2024).  No bias; noise and cost differ.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[reflect(Default)]
#[non_exhaustive]
pub enum SubsurfaceShift {
    /// The point where light enters is kept.  Cheapest.  Good where light crosses the object; blotches where its surface is lit, because
    /// near points matter most there.
    Reconnection,
    /// Delayed reconnection: the point is sampled again around the new pixel's surface, with the same random numbers.  One more ray for each
    /// shift.  Good on lit surfaces.
    Delayed,
    /// One of the two, chosen for each sample by distance and normals.
    #[default]
    Hybrid,
    /// Reconnection in all iterations of reuse but the last, and delayed reconnection in that one.  With a single iteration it is
    /// [`Self::Delayed`].  Werner et al. 2024 have two spatial iterations of two neighbors ([`Reuse::spatial_iterations`],
    /// [`Reuse::spatial_samples`]).
    Sequential,
}

/// Resampling of direct light that enters objects with [`Subsurface`], for [`Technique::Di`](super::Technique::Di),
/// [`Technique::Gi`](super::Technique::Gi), and [`Technique::Pt`](super::Technique::Pt) with
/// [`Paths::separate_direct_light`](super::Paths::separate_direct_light).
#[derive(Clone, Debug, PartialEq, Reflect)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
#[reflect(Default)]
pub struct SubsurfaceSampling {
    /// Light candidates at each point where a pixel's probe ray finds the object.  They come from the subsets of
    /// [`Direct`](super::Direct).  More give less noise at higher cost.  No bias.  1 to 64; default 8.
    pub candidates: u32,
    /// Shift mapping that takes samples to other pixels.  Default: [`SubsurfaceShift::Hybrid`].
    pub shift: SubsurfaceShift,
    /// Skips neighbors of dissimilar geometry: less noise at edges.  No bias.  Default: on.
    pub heuristics: bool,
    /// Reuse of samples.  The radius of a pixel's neighbors is two lengths of the profile, projected into the image, at most
    /// [`Reuse::radius`] and at least a sixth of it.  [`Reuse::mis`] applies to iterations with spatial reuse; purely temporal ones always
    /// use the balance heuristic.
    pub reuse: Reuse,
}

impl Default for SubsurfaceSampling {
    /// Temporal reuse, then four neighbors within 30 pixels of a picture of 1080 lines (Werner et al. 2024): less than half the error of two
    /// iterations of one neighbor, in a fifth more time (`docs/experiments.md`).
    fn default() -> Self {
        let reuse = Reuse {
            order: ReuseOrder::TemporalThenSpatial,
            spatial_samples: 4,
            disocclusion_samples: 5,
            paired: false,
            bilinear: true,
            radius: 30.0,
            confidence_cap: 20.0,
            ..Reuse::PATHS
        };
        Self { candidates: 8, shift: SubsurfaceShift::default(), heuristics: true, reuse }
    }
}

impl SubsurfaceSampling {
    /// Brings every field into its range.
    pub(super) fn clamp(&mut self, report: &mut dyn FnMut(Problem)) {
        Ranges { path: "subsurface.", report }.count("candidates", &mut self.candidates, 1, 64);
        self.reuse.clamp("subsurface.reuse.", 30.0, report);
    }
}
