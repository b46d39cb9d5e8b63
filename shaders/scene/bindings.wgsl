// Group 0: the scene, in all passes that only read it; the passes that pose bodies have another group 0 (`deformation/bindings.wgsl`).  If
// the device supports arrays of textures, the last group holds textures of the scene.
#define_import_path bevy_restir::scene::bindings

#import bevy_restir::scene::types::{Instance, Light, Material, SceneUniforms, Triangle, Vertex}

@group(0) @binding(0) var<uniform> scene: SceneUniforms;
// CWBVH nodes of obvhs, 5 vec4 each: bottom-level trees, the trees over triangles of resting instances in world space, the top-level trees
// of this frame and the last, and the tree over lights.  Also those triangles, 3 vec4 each (`trace/software.wgsl`), and the lists of
// instances and lights that leaves refer to (`tlas_indices`, `shapes_indices`).
@group(0) @binding(1) var<storage, read> nodes: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> triangles: array<Triangle>;
@group(0) @binding(3) var<storage, read> vertices: array<Vertex>;
@group(0) @binding(4) var<storage, read> instances: array<Instance>;
@group(0) @binding(5) var<storage, read> materials: array<Material>;
@group(0) @binding(6) var<storage, read> lights: array<Light>;
@group(0) @binding(7) var atlas: texture_2d_array<f32>;
// Directional albedo E of a GGX lobe with F = 1, single scattering: x is the cosine of wo, y the perceptual roughness.
@group(0) @binding(8) var specular_albedo: texture_2d<f32>;
// Arrays, stored row by row.  `texture_table` has a record for each material with textures: the transform of its texture coordinates in two
// entries, if it has one, then its texture slots in the order of SLOT_*.  `second_uvs` has three texels per triangle.
@group(0) @binding(9) var texture_table: texture_2d<u32>;
@group(0) @binding(10) var second_uvs: texture_2d<f32>;
// Subsurface scattering: mean free path of the three channels in meters (rgb), and weight (a).
@group(0) @binding(11) var subsurfaces: texture_2d<f32>;
// Vertex colors: three texels per triangle.
@group(0) @binding(12) var vertex_colors: texture_2d<f32>;
// Elements per row; a test holds it equal to `ELEMENTS_PER_ROW` in src/scene/storage/data_texture.rs.
const ELEMENTS_PER_ROW: u32 = 1024u;

// First texel of an element that has this number of texels.
fn element_texel(index: u32, texels: u32) -> vec2<u32> {
    return vec2<u32>(texels * (index % ELEMENTS_PER_ROW), index / ELEMENTS_PER_ROW);
}

// A view of each image whose texture slot has TEXTURE_BOUND.
#ifdef BOUND_TEXTURES
#ifdef RAY_QUERY
@group(4) @binding(0) var bound_textures: binding_array<texture_2d<f32>>;
#else
@group(3) @binding(0) var bound_textures: binding_array<texture_2d<f32>>;
#endif
#endif
