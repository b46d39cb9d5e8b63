//! Kinds of objects and lights that an app expects, for which pipelines are compiled ahead.

use bevy::{
    ecs::{reflect::ReflectResource, resource::Resource},
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// Kinds of lights, materials and meshes that will come into the scene.  Their pipelines are compiled ahead: the first of a kind is lit in the
/// frame in which it appears, and histories do not restart.  Without this, cameras keep the pipelines that they have until new ones are
/// compiled, which takes seconds; until then, the light or the effect of the new kind is missing.
///
/// Insert the resource while a level loads: [`RestirStatistics::is_ready`](crate::RestirStatistics::is_ready) waits for the pipelines.  If it
/// changes later, they compile in the background, and histories restart once, when they are ready.  A kind that is taken out again stays in
/// the shaders only while the scene has such objects.
///
/// Cost: shaders have the code of an expected kind even while the scene has no such objects, so that frames take as long as if some were out of
/// sight (`lab features` measures each kind in a scene).  Three kinds also take memory and passes: `subsurface` has reservoirs and passes of its
/// own, `smooth_materials` and `glass` have a pass and 48 bytes a pixel of the denoiser.  No bias: the light is the same, and pictures differ by
/// rounding at most.
///
/// Environments of cameras and the settings of cameras are not among the kinds: a camera that gets its first sky or another technique keeps
/// its last picture until new pipelines are compiled.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// # fn build(app: &mut App) {
/// // The flashlight is off at first, and the greenhouse is in the next room.
/// app.insert_resource(RestirExpected { spot_lights: true, glass: true, ..default() });
/// # }
/// ```
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq, Reflect)]
#[reflect(Resource, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct RestirExpected {
    /// Meshes with an emissive material.
    pub emissive_meshes: bool,
    /// `PointLight` with a radius of 0.
    pub point_lights: bool,
    /// `PointLight` with a radius.
    pub sphere_lights: bool,
    /// `SpotLight`.
    pub spot_lights: bool,
    /// `RectLight`.
    pub rect_lights: bool,
    /// `DirectionalLight` without a disk.
    pub directional_lights: bool,
    /// `DirectionalLight` with a `SunDisk`.
    pub sun_disks: bool,
    /// Textures of base color, metallic, roughness and emission.
    pub textures: bool,
    /// Normal maps; also [`Self::textures`].
    pub normal_maps: bool,
    /// Textures of transmission, specular, clearcoat and anisotropy; also [`Self::textures`].
    pub layer_textures: bool,
    /// Meshes with vertex colors.
    pub vertex_colors: bool,
    /// Alpha masks and blending.
    pub alpha: bool,
    /// Specular transmission, clear or rough, with or without a thickness and a tint; also [`Self::smooth_materials`].
    pub glass: bool,
    /// Diffuse transmission, such as leaves.
    pub diffuse_transmission: bool,
    /// Clearcoats.
    pub clearcoat: bool,
    /// Anisotropic reflections.
    pub anisotropy: bool,
    /// Materials of a perceptual roughness below 0.142, or with a texture of roughness; for the denoiser.
    pub smooth_materials: bool,
    /// Objects with [`Subsurface`](super::Subsurface).
    pub subsurface: bool,
    /// Skinned and morphed meshes.
    pub bending_meshes: bool,
    /// Objects or lights that some camera does not see because of its `RenderLayers`.
    pub render_layers: bool,
}
