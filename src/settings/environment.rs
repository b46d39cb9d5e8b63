//! The environment of one camera.

use bevy::{
    asset::Handle,
    color::LinearRgba,
    ecs::{component::Component, reflect::ReflectComponent},
    image::Image,
    math::Quat,
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// Environment of the scene for one camera: light from every direction, shown behind the scene.  Without this component, the camera's
/// `Skybox` lights the scene with the radiance that it shows (in Bevy's rasterizer it lights nothing).  Without a `Skybox`, the sharpest level
/// of the specular map of the camera's `EnvironmentMapLight` lights the scene, and is not shown.
///
/// Directions are sampled by the luminance of the image, in cells as small as its pixels, between 0.09 and 0.35 degrees: finer light is
/// noisier, never biased.  The table of cells takes 2.8 MB for images up to 1024 pixels wide, and at most 45 MB.
///
/// ```
/// # use bevy::prelude::*;
/// # use bevy_restir::prelude::*;
/// fn setup(mut commands: Commands, assets: Res<AssetServer>) {
///     // Bevy loads .hdr files with its feature `hdr`, which is on by default, and .exr files with `exr`.
///     let sky = RestirEnvironment::from_image(assets.load("sky.hdr"), 2000.0);
///     commands.spawn((Camera3d::default(), Restir::default(), sky));
/// }
/// ```
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Default)]
pub struct RestirEnvironment {
    /// Uniform radiance, cd/m²; multiplies the image if there is one.  Negative channels count as 0.  Default: white, 1 cd/m², which is
    /// nearly black at the exposure of Bevy's default camera.
    pub color: LinearRgba,
    /// Equirectangular image of radiance, cd/m² before `color` and `intensity` multiply it: u = 0.5 + atan2(d.x, -d.z)/2π, v = acos(d.y)/π.
    /// A camera keeps its last environment until a new image is loaded.  The history then goes on, without the light of the old image.
    /// Default: none, a uniform environment.
    pub image: Option<Handle<Image>>,
    /// Multiplies color and image.  Negative values count as 0.  Default 1.
    pub intensity: f32,
    /// Rotates the environment: takes its directions to world space.  Changing it keeps the history.  Default: identity.
    pub rotation: Quat,
}

impl RestirEnvironment {
    /// The same radiance from every direction, cd/m².
    pub fn uniform(color: LinearRgba) -> Self {
        Self { color, ..Self::default() }
    }

    /// An equirectangular image, whose values are cd/m² after multiplication with `intensity`.
    pub fn from_image(image: Handle<Image>, intensity: f32) -> Self {
        Self { image: Some(image), intensity, ..Self::default() }
    }
}

impl Default for RestirEnvironment {
    fn default() -> Self {
        Self { color: LinearRgba::WHITE, image: None, intensity: 1.0, rotation: Quat::IDENTITY }
    }
}
