//! The environment of one camera.

use bevy::{
    asset::Handle,
    color::LinearRgba,
    ecs::{component::Component, reflect::ReflectComponent},
    image::Image,
    math::Quat,
    reflect::{Reflect, std_traits::ReflectDefault},
};

/// Environment of the scene for one camera: light from every direction, shown behind the scene.  A camera without this component has its
/// `Skybox`, which lights as it looks (Bevy's rasterizer does not let it light anything), or else its `EnvironmentMapLight`: the sharpest
/// level of its specular map lights the scene and is not shown.  Directions are sampled by the luminance of the image, in cells of a third of
/// a degree: finer light is noisier, never biased.
#[derive(Component, Clone, Debug, PartialEq, Reflect)]
#[reflect(Component, Default)]
pub struct RestirEnvironment {
    /// Uniform radiance, cd/m²; multiplies the image if there is one.  Negative channels count as 0.  Default: white, 1 cd/m², which is
    /// nearly black at the exposure of Bevy's default camera.
    pub color: LinearRgba,
    /// Equirectangular image of radiance, cd/m² before `color` and `intensity` multiply it: u = 0.5 + atan2(d.x, -d.z)/2π, v = acos(d.y)/π.
    /// A camera keeps its last environment until a new image is loaded, and then restarts the history.  Default: none, a uniform environment.
    pub image: Option<Handle<Image>>,
    /// Multiplies color and image.  Negative values count as 0.  Default 1.
    pub intensity: f32,
    /// Rotates the environment: takes its directions to world space.  Changing it keeps the history.  Default: identity.
    pub rotation: Quat,
}

impl Default for RestirEnvironment {
    fn default() -> Self {
        Self { color: LinearRgba::WHITE, image: None, intensity: 1.0, rotation: Quat::IDENTITY }
    }
}
