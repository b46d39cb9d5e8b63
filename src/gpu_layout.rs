//! Rust mirrors of the structs, constants and packed sizes that shaders share with Rust: `types.wgsl` of `shaders/scene`, `deformation`,
//! `view`, `restir` and `denoiser`, `common/constants.wgsl`, `common/guard.wgsl`, `restir/mis.wgsl` and
//! `view/counter_bindings.wgsl`.  A test compares every offset and size with naga's.

use bytemuck::{Pod, Zeroable};

/// Marks a missing index.
pub const NONE: u32 = u32::MAX;

pub const LIGHT_TRIANGLE: u32 = 0;
pub const LIGHT_POINT: u32 = 1;
pub const LIGHT_SPOT: u32 = 2;
pub const LIGHT_DIRECTIONAL: u32 = 3;
pub const LIGHT_SPHERE: u32 = 4;
pub const LIGHT_RECT: u32 = 5;
pub const LIGHT_SUN: u32 = 6;
pub const LIGHT_MESH: u32 = 7;
pub const LIGHT_KIND_BITS: u32 = 0xff;
pub const LIGHT_HIDDEN_SHIFT: u32 = 8;

pub const INSTANCE_MIRRORED: u32 = 1;
pub const INSTANCE_ALPHA: u32 = 2;
pub const INSTANCE_SECOND_UV: u32 = 4;
pub const INSTANCE_SUBSURFACE: u32 = 8;
/// The last frame did not have the instance.
pub const INSTANCE_APPEARED: u32 = 16;
/// Only the last frame had the instance.
pub const INSTANCE_GONE: u32 = 32;
/// Skinned or morphed: the buffers hold its triangles a second time, as they were in the last frame.
pub const INSTANCE_DEFORMED: u32 = 64;
/// The mesh has vertex colors.
pub const INSTANCE_VERTEX_COLORS: u32 = 128;
pub const INSTANCE_SUBSURFACE_SHIFT: u32 = 8;

pub const MATERIAL_DOUBLE_SIDED: u32 = 1;
pub const MATERIAL_UNLIT: u32 = 2;
pub const MATERIAL_ALPHA_MASK: u32 = 4;
pub const MATERIAL_ALPHA_BLEND: u32 = 8;
pub const MATERIAL_FLIP_NORMAL_MAP_Y: u32 = 16;
pub const MATERIAL_CULL_BACK: u32 = 32;
pub const MATERIAL_CULL_FRONT: u32 = 64;

pub const SLOT_BASE_COLOR: u32 = 1;
pub const SLOT_METALLIC_ROUGHNESS: u32 = 2;
pub const SLOT_NORMAL: u32 = 4;
pub const SLOT_EMISSIVE: u32 = 8;
pub const SLOT_SPECULAR_TRANSMISSION: u32 = 16;
pub const SLOT_DIFFUSE_TRANSMISSION: u32 = 32;
pub const SLOT_THICKNESS: u32 = 64;
pub const SLOT_CLEARCOAT: u32 = 128;
pub const SLOT_CLEARCOAT_ROUGHNESS: u32 = 256;
pub const SLOT_CLEARCOAT_NORMAL: u32 = 512;
pub const SLOT_ANISOTROPY: u32 = 1024;
pub const SLOT_SPECULAR: u32 = 2048;
pub const SLOT_SPECULAR_TINT: u32 = 4096;
pub const SLOT_TRANSFORM: u32 = 0x8000_0000;

pub const VIEW_ENVIRONMENT_IS_BACKDROP: u32 = 1;
pub const VIEW_ORTHOGRAPHIC: u32 = 2;
pub const VIEW_NO_BACKDROP: u32 = 4;
pub const VIEW_SEES_BACK_FACES: u32 = 8;
pub const VIEW_JITTERED_MEAN: u32 = 16;

pub const OVERFLOW_STACK: u32 = 1;
pub const OVERFLOW_STEPS: u32 = 2;
pub const NON_FINITE: u32 = 4;
pub const OVERFLOW_PROBE: u32 = 0x8_0000;

// Bits of guards, equal to those in `shaders/common/guard.wgsl`.
pub const GUARD_FLOAT_OVERFLOW: u32 = 0x8;
pub const GUARD_NEGATIVE_PIXEL: u32 = 0x10;
pub const GUARD_RAY: u32 = 0x20;
pub const GUARD_SURFACE: u32 = 0x40;
pub const GUARD_LIGHT_SAMPLE: u32 = 0x80;
pub const GUARD_LIGHT_CONTRIBUTION: u32 = 0x100;
pub const GUARD_BSDF_SAMPLE: u32 = 0x200;
pub const GUARD_THROUGHPUT: u32 = 0x400;
pub const GUARD_RESAMPLING_WEIGHT: u32 = 0x800;
pub const GUARD_CONTRIBUTION_WEIGHT: u32 = 0x1000;
pub const GUARD_TARGET: u32 = 0x2000;
pub const GUARD_MIS_WEIGHT: u32 = 0x4000;
pub const GUARD_SHIFT_CONTRIBUTION: u32 = 0x8000;
pub const GUARD_JACOBIAN: u32 = 0x10000;
pub const GUARD_GI_MEASURE: u32 = 0x20000;
pub const GUARD_RESERVOIR: u32 = 0x40000;

/// Bit of an entry of the top level that has, in place of an instance, the root of a tree over triangles in world space.
pub const WORLD_TREE: u32 = 0x8000_0000;

/// Words of 16 bytes in a CWBVH node.
pub const NODE_STRIDE: u32 = 5;

/// An affine 3x4 matrix by rows: `world = rows · (object, 1)`.
pub type Rows = [[f32; 4]; 3];

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuSceneUniforms {
    pub tlas_root: u32,
    pub tlas_indices: u32,
    pub previous_tlas_root: u32,
    pub previous_tlas_indices: u32,
    pub lights_end: u32,
    pub instance_count: u32,
    pub light_power: f32,
    pub radius: f32,
    pub center: [f32; 3],
    pub previous_first_bin: u32,
    pub shapes_root: u32,
    pub shapes_indices: u32,
    pub sun_count: u32,
    pub environment_limit: f32,
    pub previous_center: [f32; 3],
    pub previous_radius: f32,
    pub light_bins: u32,
    pub previous_light_bins: u32,
    pub first_bin: u32,
    pub first_mesh_bin: u32,
}

/// The vertices of a triangle.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct GpuTriangle {
    pub a: u32,
    pub b: u32,
    pub c: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuVertex {
    pub position: [f32; 3],
    pub normal: u32,
    pub uv: [f32; 2],
    pub tangent: u32,
    pub pad: u32,
}

/// Word of a normal or a tangent that the mesh does not have.  No unit vector is packed to it.
pub const NOT_GIVEN: u32 = 0x8000_0000;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuInstance {
    pub world_from_object: Rows,
    pub object_from_world: Rows,
    pub previous_world_from_object: Rows,
    pub blas_root: u32,
    pub first_triangle: u32,
    pub triangle_count: u32,
    pub material: u32,
    pub first_light: u32,
    pub flags: u32,
    pub layers: u32,
    pub entity: u32,
}

pub const BODY_APPEARED: u32 = 1;

/// A skinned or morphed instance (`shaders/deformation/types.wgsl`).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuBody {
    pub rest_triangle: u32,
    pub triangle: u32,
    pub triangle_count: u32,
    pub rest_vertex: u32,
    pub vertex: u32,
    pub vertex_count: u32,
    pub rest_node: u32,
    pub node: u32,
    pub first_box: u32,
    pub influences: u32,
    pub targets: u32,
    pub levels: u32,
    pub level_count: u32,
    pub joints: u32,
    pub joint_count: u32,
    pub weights: u32,
    pub weight_count: u32,
    pub flags: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct GpuMaterial {
    pub base_color: [f32; 3],
    pub alpha: f32,
    pub emissive: [f32; 3],
    pub perceptual_roughness: f32,
    pub dielectric_reflectance: [f32; 3],
    pub metallic: f32,
    pub attenuation: [f32; 3],
    pub specular_transmission: f32,
    pub ior: f32,
    pub thickness: f32,
    pub alpha_cutoff: f32,
    pub flags: u32,
    pub textures: u32,
    pub texture_record: u32,
    pub anisotropy_direction: [f32; 2],
    pub anisotropy_strength: f32,
    pub diffuse_transmission: f32,
    pub clearcoat: f32,
    pub clearcoat_perceptual_roughness: f32,
}

/// A texture slot that holds no texture.
pub const NO_TEXTURE: [u32; 4] = [NONE, 0, 0, 0];

impl Default for GpuMaterial {
    /// White, rough and opaque, with the F0 of glass, as `StandardMaterial::default()`; without textures.
    fn default() -> Self {
        Self {
            base_color: [1.0; 3],
            alpha: 1.0,
            emissive: [0.0; 3],
            perceptual_roughness: 0.5,
            dielectric_reflectance: [0.04; 3],
            metallic: 0.0,
            attenuation: [0.0; 3],
            specular_transmission: 0.0,
            ior: 1.5,
            thickness: 0.0,
            alpha_cutoff: 0.5,
            flags: 0,
            textures: 0,
            texture_record: 0,
            anisotropy_direction: [1.0, 0.0],
            anisotropy_strength: 0.0,
            diffuse_transmission: 0.0,
            clearcoat: 0.0,
            clearcoat_perceptual_roughness: 0.5,
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuLight {
    pub position: [f32; 3],
    pub kind: u32,
    pub emission: [f32; 3],
    pub pmf: f32,
    pub direction: [f32; 3],
    pub alias_probability: f32,
    pub alias_index: u32,
    pub link: u32,
    pub data: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuCamera {
    pub clip_from_offset: [[f32; 4]; 4],
    pub world_from_view: [[f32; 4]; 4],
    pub view_from_clip: [[f32; 4]; 4],
    pub image_normal: [f32; 3],
    pub image_area: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuViewUniforms {
    pub current: GpuCamera,
    pub previous: GpuCamera,
    /// Columns of a mat3x3, each padded to 16 bytes.
    pub environment_rotation: [[f32; 4]; 3],
    pub previous_environment_rotation: [[f32; 4]; 3],
    pub environment_color: [f32; 3],
    pub exposure: f32,
    pub previous_environment_color: [f32; 3],
    pub firefly_limit: f32,
    pub background: [f32; 3],
    pub debug_view: u32,
    pub size: [u32; 2],
    pub jitter: [f32; 2],
    pub previous_jitter: [f32; 2],
    pub frame: u32,
    pub seed: u32,
    pub bounces: u32,
    pub flags: u32,
    pub origin: [u32; 2],
    pub accumulated: u32,
    pub layers: u32,
    pub target_size: [u32; 2],
    pub background_alpha: f32,
    pub band_rows: u32,
    pub first_pixel: [u32; 2],
}

/// Counters of a view, equal to `Counters` in `shaders/view/counter_bindings.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuCounters {
    pub rays: u32,
    pub non_finite_pixels: u32,
    pub overflow_flags: u32,
    pub light_vertices: u32,
    pub splats: u32,
    /// By the bit of a guard, over the whole run; the others are of one frame.
    pub guards: [u32; 32],
}

pub const RESAMPLE_BSDF_CANDIDATE: u32 = 1;
pub const RESAMPLE_CANDIDATE_RAYS: u32 = 2;
pub const RESAMPLE_TARGET_RAYS: u32 = 4;
pub const RESAMPLE_DISCARD_OCCLUDED: u32 = 8;
pub const RESAMPLE_MIS_RAYS: u32 = 16;
pub const RESAMPLE_SHADING_RAYS: u32 = 32;
pub const RESAMPLE_REUSE_VISIBILITY: u32 = 64;
pub const RESAMPLE_HEURISTICS: u32 = 128;
pub const RESAMPLE_SHADE_ALL: u32 = 256;
pub const RESAMPLE_FROM_PREVIOUS: u32 = 512;
pub const RESAMPLE_SHADE: u32 = 1024;
pub const RESAMPLE_CANDIDATES_VISIBLE: u32 = 2048;
pub const RESAMPLE_TARGET_WITHOUT_BSDF: u32 = 4096;
pub const RESAMPLE_BILINEAR: u32 = 8192;
pub const RESAMPLE_SAME_MATERIAL: u32 = 16384;
pub const RESAMPLE_MOVED: u32 = 32768;
pub const RESAMPLE_RETRACE_FORWARD: u32 = 65536;
pub const RESAMPLE_RETRACE_BACKWARD: u32 = 131072;
pub const RESAMPLE_DIFFUSE_SECONDARY: u32 = 262_144;
pub const RESAMPLE_INVERT_PROBES: u32 = 524_288;
pub const RESAMPLE_RECONNECT_LIGHT_PATHS: u32 = 1_048_576;
pub const RESAMPLE_DUAL_MOTION: u32 = 2_097_152;
pub const RESAMPLE_NO_ROULETTE: u32 = 4_194_304;
pub const RESAMPLE_STILL: u32 = 8_388_608;
pub const RESAMPLE_SAME_RAYS: u32 = 16_777_216;
pub const RESAMPLE_SAME_DENSITIES: u32 = 33_554_432;

pub const RECONNECT_FOOTPRINTS: u32 = 0;
pub const RECONNECT_BLACK_BOX: u32 = 1;
pub const RECONNECT_BLACK_BOX_PRINTED: u32 = 2;
pub const RECONNECT_JACOBIAN_BOUND: u32 = 3;
pub const RECONNECT_PATH_FOOTPRINT: u32 = 4;
pub const RECONNECT_DISTANCE: u32 = 5;
pub const RECONNECT_FIRST: u32 = 6;

pub const SUBSURFACE_RECONNECTION: u32 = 0;
pub const SUBSURFACE_DELAYED: u32 = 1;
pub const SUBSURFACE_HYBRID: u32 = 2;

pub const MIS_UNIFORM: u32 = 0;
pub const MIS_ONE_OVER_Z: u32 = 1;
pub const MIS_BALANCE: u32 = 2;
pub const MIS_PAIRWISE: u32 = 3;
pub const MIS_DEFENSIVE_PAIRWISE: u32 = 4;
pub const MIS_DEFENSIVE_PAIRWISE_GRIS: u32 = 5;

/// Layouts of reservoirs without tiles.
pub const LAYOUT_ROWS: u32 = 0;
pub const LAYOUT_COLUMNS: u32 = u32::MAX;

/// Bytes of a presampled point of a light.
pub const PRESAMPLED_LIGHT_SIZE: u64 = 48;

/// Bytes of a reservoir of ReSTIR DI.
pub const DIRECT_RESERVOIR_SIZE: u64 = 16;
/// Bytes of a reservoir of ReSTIR GI.
pub const INDIRECT_RESERVOIR_SIZE: u64 = 52;
/// Bytes of a reservoir of ReSTIR SSS.
pub const SUBSURFACE_RESERVOIR_SIZE: u64 = 52;
/// Bytes of a reservoir of ReSTIR PT.
pub const PATH_RESERVOIR_SIZE: u64 = 64;
/// Bytes of a reservoir of ReSTIR BDPT.
pub const BIDIRECTIONAL_RESERVOIR_SIZE: u64 = 64;
/// Bytes of a reservoir of light sub-paths that the camera sees.
pub const SPLAT_RESERVOIR_SIZE: u64 = 44;
/// Bytes of a reservoir of such sub-paths that can be reconnected.
pub const RECONNECTED_RESERVOIR_SIZE: u64 = 64;

/// Texels of an entry of the light vertex cache, and entries of a row.
pub const VERTEX_TEXELS: u32 = 3;
pub const VERTICES_PER_ROW: u32 = 2048;
/// Entries of a light sub-path in the light map, and words of an entry.
pub const SPLATS_OF_A_PATH: u32 = 3;
pub const SPLAT_WORDS: u32 = 5;

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuResampleSettings {
    pub candidates: u32,
    pub subset_count: u32,
    pub subset_size: u32,
    pub light_tile_size: u32,
    pub temporal_samples: u32,
    pub spatial_samples: u32,
    pub disocclusion_samples: u32,
    pub neighbor_attempts: u32,
    pub temporal_attempts: u32,
    pub radius: f32,
    pub confidence_cap: f32,
    pub decorrelation: f32,
    pub mis: u32,
    pub flags: u32,
    pub normal_threshold: f32,
    pub depth_threshold: f32,
    pub visibility_radius: f32,
    pub reservoir_layout: u32,
    pub iteration: u32,
    pub reconnection: u32,
    pub roughness: f32,
    pub separation: f32,
    pub jacobian_limit: f32,
    pub light_paths: u32,
    pub splats: u32,
    pub nee_share: f32,
    pub caustic_share: f32,
    pub subsurface_shift: u32,
    pub pair_layers: u32,
    pub pair_tile_bits: u32,
    pub domain: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct GpuDenoiserSettings {
    pub step: u32,
    pub history: u32,
    pub has_history: u32,
    pub pad: u32,
}
