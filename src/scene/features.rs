//! What a scene really contains: shaders are specialized by it, buffers and passes exist only for it.

use bevy::shader::ShaderDefVal;

macro_rules! features {
    ($($name:ident = $bit:literal, $def:literal, $doc:literal;)*) => {
        bitflags::bitflags! {
            /// What a scene contains.
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
            pub struct SceneFeatures: u32 {
                $(#[doc = $doc] const $name = 1 << $bit;)*
            }
        }

        impl SceneFeatures {
            /// Every feature with its shader definition.
            pub const TABLE: &[(SceneFeatures, &str)] = &[$((SceneFeatures::$name, $def)),*];
        }
    };
}

features! {
    LIGHT_TRIANGLES = 0, "LIGHT_TRIANGLES", "Emissive meshes.";
    LIGHT_POINTS = 1, "LIGHT_POINTS", "Point or spot lights.";
    LIGHT_DIRECTIONAL = 2, "LIGHT_DIRECTIONAL", "Directional lights.";
    ENVIRONMENT = 3, "ENVIRONMENT", "An environment that emits.";
    ENVIRONMENT_MAP = 4, "ENVIRONMENT_MAP", "It has an image.";
    TEXTURES = 5, "TEXTURES", "Textures of any kind.";
    NORMAL_MAPS = 6, "NORMAL_MAPS", "Normal maps.";
    ALPHA = 7, "ALPHA", "Alpha mask or blending.";
    TRANSMISSION = 8, "TRANSMISSION", "Specular transmission.";
    ATTENUATION = 9, "ATTENUATION", "Absorption within transmissive bodies.";
    UNLIT = 10, "UNLIT", "Unlit materials.";
    ENERGY_COMPENSATION = 11, "ENERGY_COMPENSATION", "Energy compensation is asked for by the camera.";
    SECOND_UVS = 17, "SECOND_UVS", "Textures that go by the second texture coordinates.";
    LAYER_TEXTURES = 18, "LAYER_TEXTURES", "Textures of transmission, specular reflection, clearcoat or anisotropy.";
    RAY_QUERY = 23, "RAY_QUERY", "Rays by the device's ray queries: of the device, not of the scene.";
    MANY_NEIGHBORS = 12, "MANY_NEIGHBORS", "More than two neighbors are asked for by the camera.";
    RENDER_LAYERS = 20, "RENDER_LAYERS", "Things or lights on other render layers than a camera's that another camera sees.";
    CLEARCOAT = 24, "CLEARCOAT", "Clearcoats.";
    ANISOTROPY = 25, "ANISOTROPY", "Anisotropic microfacets.";
    DIFFUSE_TRANSMISSION = 26, "DIFFUSE_TRANSMISSION", "Diffuse transmission.";
    THIN_WALL = 27, "THIN_WALL", "Walls without an inside that let light through.";
    ENVIRONMENT_CUBE = 19, "ENVIRONMENT_CUBE", "The environment's image is a cube.";
    LIGHT_SPHERES = 21, "LIGHT_SPHERES", "Point lights with a radius.";
    LIGHT_RECTS = 22, "LIGHT_RECTS", "Rectangular lights.";
    SUN_DISK = 28, "SUN_DISK", "Directional lights with a disc.";
    BOUND_TEXTURES = 30, "BOUND_TEXTURES", "Textures that are bound as they are, where the device has arrays of them.";
    LIGHT_SHAPES = 29, "LIGHT_SHAPES", "Point lights with a radius, rectangles or suns with a disc: lights that rays meet and that are no triangles.";
}

impl SceneFeatures {
    /// The shader definitions that stand for these features.
    pub fn shader_defs(self) -> Vec<ShaderDefVal> {
        self.names().into_iter().map(|def| ShaderDefVal::Bool(def.into(), true)).collect()
    }

    /// The names of these features.
    pub fn names(self) -> Vec<&'static str> {
        Self::TABLE.iter().filter(|(feature, _)| self.contains(*feature)).map(|(_, def)| *def).collect()
    }
}
