//! Features that the scene, the camera or the device has.  Shaders are specialized for them, and buffers and passes exist only for them.

use core::ops::BitOr;

use bevy::shader::ShaderDefVal;

use crate::settings::RestirExpected;

macro_rules! features {
    ($($name:ident = $bit:literal, $doc:literal;)*) => {
        bitflags::bitflags! {
            /// Features that shaders and passes depend on: contents of the scene, settings of the camera and abilities of the device.
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
            pub struct SceneFeatures: u64 {
                $(#[doc = $doc] const $name = 1 << $bit;)*
            }
        }

        impl SceneFeatures {
            /// Each feature with its shader definition, which has its name.
            pub const TABLE: &[(SceneFeatures, &str)] = &[$((SceneFeatures::$name, stringify!($name))),*];
        }
    };
}

features! {
    LIGHT_TRIANGLES = 0, "Emissive meshes.";
    LIGHT_POINTS = 1, "Point or spot lights.";
    LIGHT_DIRECTIONAL = 2, "Directional lights.";
    ENVIRONMENT = 3, "The camera has an environment that emits.";
    ENVIRONMENT_MAP = 4, "The environment has an image.";
    TEXTURES = 5, "Textures of any kind.";
    NORMAL_MAPS = 6, "Normal maps.";
    ALPHA = 7, "Alpha mask or blending.";
    TRANSMISSION = 8, "Specular transmission.";
    ATTENUATION = 9, "Absorption inside transmissive objects.";
    VERTEX_COLORS = 10, "Meshes with vertex colors.";
    ENERGY_COMPENSATION = 11, "The camera uses energy compensation.";
    SECOND_UVS = 17, "Textures that use the second texture coordinates.";
    LAYER_TEXTURES = 18, "Textures of transmission, specular reflection, clearcoat or anisotropy.";
    RAY_QUERY = 23, "Rays are traced by the ray queries of the device.";
    MANY_NEIGHBORS = 12, "The camera's settings combine more than three reservoirs in one resampling pass, apart from passes over pairs.";
    SPLIT_LIGHT = 15, "The camera shows diffuse or specular light alone, or denoises them apart.";
    RENDER_LAYERS = 20, "Instances or lights that render layers hide from this camera.";
    CLEARCOAT = 24, "Clearcoats.";
    ANISOTROPY = 25, "Anisotropic microfacets.";
    DIFFUSE_TRANSMISSION = 26, "Diffuse transmission.";
    THIN_WALL = 27, "Transmissive surfaces without thickness.";
    ENVIRONMENT_CUBE = 19, "The image of the environment is a cube map.";
    LIGHT_SPHERES = 21, "Point lights with a radius.";
    LIGHT_RECTS = 22, "Rectangular lights.";
    SUN_DISK = 28, "Directional lights with a disk.";
    BOUND_TEXTURES = 30, "Textures that are bound in an array without a copy, if the device supports it.";
    DEFORMATION = 14, "Skinned or morphed meshes.";
    SMOOTH = 16, "Surfaces that may be as smooth as mirrors and clear glass.";
    SUBSURFACE = 13, "Subsurface scattering.";
    CONNECTIONS = 31, "The camera's settings connect camera paths with light paths.";
    LIGHT_SHAPES = 29, "Spheres, rectangles or suns with a disk: analytic lights that rays can hit.";
    COPIED_MIS = 33, "The camera's settings copy the MIS weights of shifted paths.";
    COUNT_RAYS = 32, "Rays are counted, because the app asks for it or a debug view shows it.";
}

/// Keeps the bits of features for a while after they have vanished: each set of features has pipelines of its own, which take time to
/// compile, so a lamp that is switched off and on must not change the set each time.
#[derive(Debug, Default)]
pub(crate) struct RecentBits<T> {
    /// Bits of the current period and of the one before.
    recent: [T; 2],
    frame: u32,
}

impl<T: Copy + Default + BitOr<Output = T>> RecentBits<T> {
    /// The bits of this frame, and those that have vanished since the start of the last period: each is kept for one to two periods.
    pub(crate) fn update(&mut self, present: T) -> T {
        self.frame += 1;
        if self.frame >= RECENT_PERIOD {
            *self = Self { recent: [T::default(), self.recent[0]], frame: 0 };
        }
        self.recent[0] = self.recent[0] | present;
        self.recent[0] | self.recent[1]
    }
}

impl RecentBits<SceneFeatures> {
    /// The features to specialize for.  Translucent objects need buffers and passes of their own, which a scene without such objects should
    /// not pay for.
    pub(crate) fn features(&mut self, present: SceneFeatures) -> SceneFeatures {
        self.update(present).difference(SceneFeatures::SUBSURFACE) | present
    }
}

/// Frames of a period.
const RECENT_PERIOD: u32 = 600;

impl SceneFeatures {
    /// Contents of a scene whose light takes paths that shaders without the feature never sample.
    pub(crate) const PATHS: Self = Self::LIGHT_TRIANGLES
        .union(Self::LIGHT_POINTS)
        .union(Self::LIGHT_DIRECTIONAL)
        .union(Self::LIGHT_SPHERES)
        .union(Self::LIGHT_RECTS)
        .union(Self::LIGHT_SHAPES)
        .union(Self::SUN_DISK)
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

    /// The features that expected contents of a scene may bring, on any device.
    pub(crate) fn of_expected(expected: &RestirExpected) -> Self {
        const TEXTURES: SceneFeatures =
            SceneFeatures::TEXTURES.union(SceneFeatures::BOUND_TEXTURES).union(SceneFeatures::SECOND_UVS);
        const TRANSMITS: SceneFeatures = SceneFeatures::ATTENUATION.union(SceneFeatures::THIN_WALL);
        // All fields are named, so that a new one cannot be forgotten.
        let &RestirExpected {
            emissive_meshes,
            point_lights,
            sphere_lights,
            spot_lights,
            rect_lights,
            directional_lights,
            sun_disks,
            textures,
            normal_maps,
            layer_textures,
            vertex_colors,
            alpha,
            glass,
            diffuse_transmission,
            clearcoat,
            anisotropy,
            smooth_materials,
            subsurface,
            bending_meshes,
            render_layers,
        } = expected;
        let features = [
            (emissive_meshes, Self::LIGHT_TRIANGLES),
            (point_lights || spot_lights, Self::LIGHT_POINTS),
            (sphere_lights, Self::LIGHT_SPHERES | Self::LIGHT_SHAPES),
            (rect_lights, Self::LIGHT_RECTS | Self::LIGHT_SHAPES),
            (directional_lights, Self::LIGHT_DIRECTIONAL),
            (sun_disks, Self::SUN_DISK | Self::LIGHT_SHAPES),
            (textures, TEXTURES),
            (normal_maps, TEXTURES | Self::NORMAL_MAPS),
            (layer_textures, TEXTURES | Self::LAYER_TEXTURES),
            (vertex_colors, Self::VERTEX_COLORS),
            (alpha, Self::ALPHA),
            (glass, Self::TRANSMISSION | TRANSMITS | Self::SMOOTH),
            (diffuse_transmission, Self::DIFFUSE_TRANSMISSION | TRANSMITS),
            (clearcoat, Self::CLEARCOAT),
            (anisotropy, Self::ANISOTROPY),
            (smooth_materials, Self::SMOOTH),
            (subsurface, Self::SUBSURFACE),
            (bending_meshes, Self::DEFORMATION),
            (render_layers, Self::RENDER_LAYERS),
        ];
        features.into_iter().filter(|(is_expected, _)| *is_expected).map(|(_, features)| features).collect()
    }

    /// The features that a picture depends on: without the counting of rays.
    pub(crate) fn of_pictures(self) -> Self {
        self.difference(Self::COUNT_RAYS)
    }

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
        let mut recent = RecentBits::default();
        assert_eq!(recent.update(SceneFeatures::ALPHA), SceneFeatures::ALPHA);
        let frames = (0..5000).take_while(|_| recent.update(SceneFeatures::empty()) == SceneFeatures::ALPHA).count();
        assert!((RECENT_PERIOD..2 * RECENT_PERIOD).contains(&(frames as u32)), "{frames}");
        recent.features(SceneFeatures::SUBSURFACE);
        assert_eq!(recent.features(SceneFeatures::empty()), SceneFeatures::empty());
    }
}
