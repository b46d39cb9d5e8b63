// Constants that all rooms (folders of modules) share.  A test holds those that Rust also uses equal to `src/gpu_layout.rs`.
#define_import_path bevy_restir::common::constants

const PI: f32 = 3.14159265358979323846;
const INV_PI: f32 = 0.31830988618379067154;
const TWO_PI: f32 = 6.28318530717958647692;
const FOUR_PI: f32 = 12.5663706143591729539;

// Largest f32 below 1: the bound of a random number that is scaled up for reuse.
const ONE_MINUS_EPSILON: f32 = 0.99999994;

// Larger than any distance in a scene: WGSL has no portable infinity.
const FAR: f32 = 3.0e38;

// Floor of divisors and of arguments of inverseSqrt that may be 0.  Its reciprocal is finite, and it is above 1.2e-38, the least normal f32:
// GPUs may replace smaller numbers by 0.
const LEAST_DIVISOR: f32 = 1.0e-37;
// Floor of lengths, cosines and sums that may be 0 and divide greater numbers: the quotient of a number up to 3e8 by it is finite.
const LEAST_MAGNITUDE: f32 = 1.0e-30;

// Colors whose components share an exponent are stored as black if no component is above this bound.  Its exponent, and the powers of two
// that scale it, are well within the ranges of the encodings and of f32.
const LEAST_STORED_COLOR: f32 = 1.0e-30;

// Bound of values that are stored as half floats, the greatest of which is 65504.
const HALF_BOUND: f32 = 6.0e4;

// Marks a missing index.
const NONE: u32 = 0xffffffffu;

// Bit of an entry of the top level that has, in place of an instance, the root of a tree over triangles in world space.
const WORLD_TREE: u32 = 0x80000000u;

// Kinds of lights.
const LIGHT_TRIANGLE: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LIGHT_SPOT: u32 = 2u;
const LIGHT_DIRECTIONAL: u32 = 3u;
const LIGHT_SPHERE: u32 = 4u;
const LIGHT_RECT: u32 = 5u;
const LIGHT_SUN: u32 = 6u;
// Stands for the triangles of an emissive mesh in the choice of a light.
const LIGHT_MESH: u32 = 7u;
// `Light::kind` holds the kind in its low bits and, from LIGHT_HIDDEN_SHIFT on, a bit for each set of render layers whose cameras the
// light is hidden from.
const LIGHT_KIND_BITS: u32 = 0xffu;
const LIGHT_HIDDEN_SHIFT: u32 = 8u;

// Flags of an instance.
const INSTANCE_MIRRORED: u32 = 1u;
const INSTANCE_ALPHA: u32 = 2u;
const INSTANCE_SECOND_UV: u32 = 4u;
// Light scatters below the surface.  From INSTANCE_SUBSURFACE_SHIFT on, the flags then hold the index of a record in `subsurfaces`.
const INSTANCE_SUBSURFACE: u32 = 8u;
const INSTANCE_SUBSURFACE_SHIFT: u32 = 8u;
// The last frame did not have the instance.
const INSTANCE_APPEARED: u32 = 16u;
// Only the last frame had the instance.
const INSTANCE_GONE: u32 = 32u;
// Skinned or morphed: behind its triangles follow the same number of triangles as they were in the last frame.
const INSTANCE_DEFORMED: u32 = 64u;
// The mesh has vertex colors.
const INSTANCE_VERTEX_COLORS: u32 = 128u;

// Flags of a material.
const MATERIAL_DOUBLE_SIDED: u32 = 1u;
const MATERIAL_UNLIT: u32 = 2u;
const MATERIAL_ALPHA_MASK: u32 = 4u;
const MATERIAL_ALPHA_BLEND: u32 = 8u;
const MATERIAL_FLIP_NORMAL_MAP_Y: u32 = 16u;
const MATERIAL_CULL_BACK: u32 = 32u;
const MATERIAL_CULL_FRONT: u32 = 64u;

// Kinds of textures.  The texture slots in the record of a material have this order.
const SLOT_BASE_COLOR: u32 = 1u;
const SLOT_METALLIC_ROUGHNESS: u32 = 2u;
const SLOT_NORMAL: u32 = 4u;
const SLOT_EMISSIVE: u32 = 8u;
const SLOT_SPECULAR_TRANSMISSION: u32 = 16u;
const SLOT_DIFFUSE_TRANSMISSION: u32 = 32u;
const SLOT_THICKNESS: u32 = 64u;
const SLOT_CLEARCOAT: u32 = 128u;
const SLOT_CLEARCOAT_ROUGHNESS: u32 = 256u;
const SLOT_CLEARCOAT_NORMAL: u32 = 512u;
const SLOT_ANISOTROPY: u32 = 1024u;
const SLOT_SPECULAR: u32 = 2048u;
const SLOT_SPECULAR_TINT: u32 = 4096u;
// Not a texture: the record begins with a transform of the texture coordinates.
const SLOT_TRANSFORM: u32 = 0x80000000u;

// Flags of a view.  The camera sees the environment; otherwise the environment only lights the scene.
const VIEW_ENVIRONMENT_IS_BACKDROP: u32 = 1u;
const VIEW_ORTHOGRAPHIC: u32 = 2u;
// Pixels without a surface keep the picture of an earlier camera.
const VIEW_NO_BACKDROP: u32 = 4u;
// The camera sees back faces in place of front faces.
const VIEW_SEES_BACK_FACES: u32 = 8u;
// The picture is a mean of frames whose rays pass through different places of a pixel.
const VIEW_JITTERED_MEAN: u32 = 16u;

// Errors that are read back and reported: bits of `trace_flags` (OVERFLOW_*) and of `raised_guards` (NON_FINITE).  The other guards are in
// `common/guard.wgsl`.
const OVERFLOW_STACK: u32 = 1u;
const OVERFLOW_STEPS: u32 = 2u;
const NON_FINITE: u32 = 4u;
const OVERFLOW_PROBE: u32 = 0x80000u;

// Smallest GGX roughness α, and the α below which a lobe is a delta: f32 is not precise enough for narrower lobes.
const ALPHA_MIN: f32 = 1.0e-4;
const ALPHA_DELTA: f32 = 1.0e-3;
