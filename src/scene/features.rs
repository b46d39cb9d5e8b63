//! Features that the scene, the camera or the device has.  Shaders are specialized for them, and buffers and passes exist only for them.

use core::ops::BitOr;

use bevy::shader::ShaderDefVal;

macro_rules! features {
    ($($name:ident = $bit:literal, $def:literal, $doc:literal;)*) => {
        bitflags::bitflags! {
            /// Features that shaders are specialized for: contents of the scene, settings of the camera and abilities of the device.
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
            pub struct SceneFeatures: u32 {
                $(#[doc = $doc] const $name = 1 << $bit;)*
            }
        }

        impl SceneFeatures {
            /// Each feature with its shader definition.
            pub const TABLE: &[(SceneFeatures, &str)] = &[$((SceneFeatures::$name, $def)),*];
        }
    };
}

features! {
    LIGHT_TRIANGLES = 0, "LIGHT_TRIANGLES", "Emissive meshes.";
    LIGHT_POINTS = 1, "LIGHT_POINTS", "Point or spot lights.";
    LIGHT_DIRECTIONAL = 2, "LIGHT_DIRECTIONAL", "Directional lights.";
    ENVIRONMENT = 3, "ENVIRONMENT", "The camera has an environment that emits.";
    ENVIRONMENT_MAP = 4, "ENVIRONMENT_MAP", "The environment has an image.";
    TEXTURES = 5, "TEXTURES", "Textures of any kind.";
    NORMAL_MAPS = 6, "NORMAL_MAPS", "Normal maps.";
    ALPHA = 7, "ALPHA", "Alpha mask or blending.";
    TRANSMISSION = 8, "TRANSMISSION", "Specular transmission.";
    ATTENUATION = 9, "ATTENUATION", "Absorption inside transmissive objects.";
    VERTEX_COLORS = 10, "VERTEX_COLORS", "Meshes with vertex colors.";
    ENERGY_COMPENSATION = 11, "ENERGY_COMPENSATION", "The camera uses energy compensation.";
    SECOND_UVS = 17, "SECOND_UVS", "Textures that use the second texture coordinates.";
    LAYER_TEXTURES = 18, "LAYER_TEXTURES", "Textures of transmission, specular reflection, clearcoat or anisotropy.";
    RAY_QUERY = 23, "RAY_QUERY", "Rays are traced by the ray queries of the device.";
    MANY_NEIGHBORS = 12, "MANY_NEIGHBORS", "The camera's settings combine more than three reservoirs in one resampling pass, apart from passes over pairs.";
    SPLIT_LIGHT = 15, "SPLIT_LIGHT", "The camera shows diffuse or specular light alone, or denoises them apart.";
    RENDER_LAYERS = 20, "RENDER_LAYERS", "Instances or lights that render layers hide from this camera.";
    CLEARCOAT = 24, "CLEARCOAT", "Clearcoats.";
    ANISOTROPY = 25, "ANISOTROPY", "Anisotropic microfacets.";
    DIFFUSE_TRANSMISSION = 26, "DIFFUSE_TRANSMISSION", "Diffuse transmission.";
    THIN_WALL = 27, "THIN_WALL", "Transmissive surfaces without thickness.";
    ENVIRONMENT_CUBE = 19, "ENVIRONMENT_CUBE", "The image of the environment is a cube map.";
    LIGHT_SPHERES = 21, "LIGHT_SPHERES", "Point lights with a radius.";
    LIGHT_RECTS = 22, "LIGHT_RECTS", "Rectangular lights.";
    SUN_DISK = 28, "SUN_DISK", "Directional lights with a disk.";
    BOUND_TEXTURES = 30, "BOUND_TEXTURES", "Textures that are bound in an array without a copy, if the device supports it.";
    DEFORMATION = 14, "DEFORMATION", "Skinned or morphed meshes.";
    SMOOTH = 16, "SMOOTH", "Surfaces that may be as smooth as mirrors and clear glass.";
    SUBSURFACE = 13, "SUBSURFACE", "Subsurface scattering.";
    CONNECTIONS = 31, "CONNECTIONS", "The camera's settings connect camera paths with light paths.";
    LIGHT_SHAPES = 29, "LIGHT_SHAPES", "Spheres, rectangles or suns with a disk: analytic lights that rays can hit.";
}

/// Keeps the bits of features for a while after they have vanished: each set of features has pipelines of its own, which take time to
/// compile, so a lamp that is switched off and on must not change the set each time.
#[derive(Debug, Default)]
pub(crate) struct Memory<T> {
    /// Bits of the current period and of the one before.
    recent: [T; 2],
    frame: u32,
}

impl<T: Copy + Default + BitOr<Output = T>> Memory<T> {
    /// The bits of this frame, and those that vanished in this period or in the one before: each is kept for one to two periods.
    pub(crate) fn update(&mut self, present: T) -> T {
        self.frame += 1;
        if self.frame >= MEMORY_PERIOD {
            *self = Self { recent: [T::default(), self.recent[0]], frame: 0 };
        }
        self.recent[0] = self.recent[0] | present;
        self.recent[0] | self.recent[1]
    }
}

impl Memory<SceneFeatures> {
    /// The features to specialize for.  Translucent objects need buffers and passes of their own, which a scene without such objects should
    /// not pay for.
    pub(crate) fn features(&mut self, present: SceneFeatures) -> SceneFeatures {
        self.update(present).difference(SceneFeatures::SUBSURFACE) | present
    }
}

/// Frames of a period.
const MEMORY_PERIOD: u32 = 600;

impl SceneFeatures {
    /// Contents of a scene whose light takes paths that shaders without the feature never sample.
    pub(crate) const PATHS: Self = Self::LIGHT_TRIANGLES
        .union(Self::LIGHT_POINTS)
        .union(Self::LIGHT_DIRECTIONAL)
        .union(Self::LIGHT_SPHERES)
        .union(Self::LIGHT_RECTS)
        .union(Self::LIGHT_SHAPES)
        .union(Self::SUN_DISK)
        .union(Self::ENVIRONMENT)
        .union(Self::ENVIRONMENT_MAP)
        .union(Self::ALPHA)
        .union(Self::CLEARCOAT)
        .union(Self::TRANSMISSION)
        .union(Self::THIN_WALL)
        .union(Self::DIFFUSE_TRANSMISSION)
        .union(Self::LAYER_TEXTURES)
        .union(Self::RENDER_LAYERS);

    /// Contents that change the alpha of surfaces, and so the paths through them.
    pub(crate) const ALPHA_SOURCES: Self =
        Self::TEXTURES.union(Self::BOUND_TEXTURES).union(Self::SECOND_UVS).union(Self::VERTEX_COLORS);

    /// The kinds of environments.
    pub(crate) const OF_ENVIRONMENT: Self =
        Self::ENVIRONMENT.union(Self::ENVIRONMENT_MAP).union(Self::ENVIRONMENT_CUBE);

    /// The shader definitions of these features.
    pub fn shader_defs(self) -> Vec<ShaderDefVal> {
        self.names().into_iter().map(|def| ShaderDefVal::Bool(def.into(), true)).collect()
    }

    /// The names of these features.
    pub fn names(self) -> Vec<&'static str> {
        Self::TABLE.iter().filter(|(feature, _)| self.contains(*feature)).map(|(_, def)| *def).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_remembered_for_at_least_a_period_and_less_than_two() {
        let mut memory = Memory::default();
        assert_eq!(memory.update(SceneFeatures::ALPHA), SceneFeatures::ALPHA);
        let frames = (0..5000).take_while(|_| memory.update(SceneFeatures::empty()) == SceneFeatures::ALPHA).count();
        assert!((MEMORY_PERIOD..2 * MEMORY_PERIOD).contains(&(frames as u32)), "{frames}");
        memory.features(SceneFeatures::SUBSURFACE);
        assert_eq!(memory.features(SceneFeatures::empty()), SceneFeatures::empty());
    }
}
