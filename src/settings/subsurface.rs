//! Subsurface scattering of one object.

use bevy::{
    ecs::{component::Component, reflect::ReflectComponent},
    math::Vec3,
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// Lets light that enters an object with a `StandardMaterial` leave it elsewhere: skin, wax, marble, milk.  It stands beside the mesh and
/// takes a share of the diffuse reflection; specular reflection, clearcoat and transmission stay as they are.
///
/// Light spreads by the diffusion profile of Burley (2015), with the lengths of Christensen and Burley (2015) for the base color of the point
/// where it leaves, and only within one object.  Lengths are meters in world space, whatever the scale of the object.  The profile is that of
/// a plane: thin parts gain light, and small bodies lose some.  Seen from behind, a surface is diffuse, so meshes must face outward; open
/// meshes are allowed.  Objects with `NotShadowCaster` are diffuse, because rays do not find them.
///
/// [`Technique::Reference`](crate::Technique::Reference) renders it; other techniques render the object as diffuse, with one warning.
/// It costs one ray per path and hit of such an object, and a shadow ray; scenes without it pay nothing.
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
    /// below about a hundredth of a pixel, is diffuse.  At most [`Self::MAX_MEAN_FREE_PATH`]; where it exceeds the size of the object, most
    /// light is lost.
    pub mean_free_path: Vec3,
    /// Share of diffuse reflection that scatters below the surface, from 0 to 1.
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
                warnings.push(format!("its mean free path for {channel} is {length} m; {used} m is used"));
            }
            *length = if used < Self::MIN_MEAN_FREE_PATH { 0.0 } else { used };
        }
        let weight = if self.weight.is_nan() { 0.0 } else { self.weight.clamp(0.0, 1.0) };
        if weight != self.weight {
            warnings.push(format!("its weight is {}; {weight} is used", self.weight));
            self.weight = weight;
        }
        warnings
    }
}

impl Default for Subsurface {
    /// A millimeter in all channels, with full weight.
    fn default() -> Self {
        Self { mean_free_path: Vec3::splat(0.001), weight: 1.0 }
    }
}
