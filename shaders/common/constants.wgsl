// Constants shared by every shader.  Those that Rust also knows are equal by test (tests/layout.rs) to `src/gpu_types.rs`.
#define_import_path bevy_restir::common::constants

const PI: f32 = 3.14159265358979323846;
const INV_PI: f32 = 0.31830988618379067154;
const TWO_PI: f32 = 6.28318530717958647692;
const FOUR_PI: f32 = 12.5663706143591729539;

// Larger than any distance in a scene; WGSL has no portable infinity.
const FAR: f32 = 3.0e38;

// "No such thing" for every index.
const NONE: u32 = 0xffffffffu;

const LIGHT_TRIANGLE: u32 = 0u;
const LIGHT_POINT: u32 = 1u;
const LIGHT_SPOT: u32 = 2u;
const LIGHT_DIRECTIONAL: u32 = 3u;
const LIGHT_ENVIRONMENT: u32 = 4u;

const INSTANCE_MIRRORED: u32 = 1u;
const INSTANCE_ALPHA: u32 = 2u;

const MATERIAL_DOUBLE_SIDED: u32 = 1u;
const MATERIAL_UNLIT: u32 = 2u;
const MATERIAL_ALPHA_MASK: u32 = 4u;
const MATERIAL_ALPHA_BLEND: u32 = 8u;
const MATERIAL_FLIP_NORMAL_MAP_Y: u32 = 16u;
const MATERIAL_CULL_BACK: u32 = 32u;
const MATERIAL_CULL_FRONT: u32 = 64u;
const MATERIAL_TWO_COMPONENT_NORMAL_MAP: u32 = 128u;

// The environment is shown to the camera; otherwise it only lights.
const VIEW_ENVIRONMENT_IS_BACKDROP: u32 = 1u;
const VIEW_ORTHOGRAPHIC: u32 = 2u;

// Bits of `trace_flags`: what went wrong, read back and reported.
const OVERFLOW_STACK: u32 = 1u;
const OVERFLOW_STEPS: u32 = 2u;
const NON_FINITE: u32 = 4u;

// Smallest roughness α, and the α below which a lobe is a delta (design 2).
const ALPHA_MIN: f32 = 1.0e-4;
const ALPHA_DELTA: f32 = 1.0e-3;
