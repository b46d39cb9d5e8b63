// Group 0: the scene; and textures of it in a group behind all others, where the device has arrays of them.  The only module that binds it.
#define_import_path bevy_restir::scene::bindings

#import bevy_restir::scene::types::{SceneUniforms, Triangle, TriangleAttributes, Instance, Material, Light}

@group(0) @binding(0) var<uniform> scene: SceneUniforms;
// Bottom-level trees, the top level of this frame and of the last: obvhs CWBVH nodes, 5 vec4 each.
@group(0) @binding(1) var<storage, read> nodes: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> triangles: array<Triangle>;
@group(0) @binding(3) var<storage, read> attributes: array<TriangleAttributes>;
@group(0) @binding(4) var<storage, read> instances: array<Instance>;
@group(0) @binding(5) var<storage, read> materials: array<Material>;
@group(0) @binding(6) var<storage, read> lights: array<Light>;
@group(0) @binding(7) var atlas: texture_2d_array<f32>;
// What a GGX lobe with F = 1 reflects at once: the cosine of wo across, perceptual roughness down.
@group(0) @binding(8) var specular_albedo: texture_2d<f32>;
// Arrays in rows: a record for every material that has textures (its transform of texture coordinates, two entries, if it has one; then
// its slots in the order of their kinds); second texture coordinates of triangles, three texels each.
@group(0) @binding(9) var texture_table: texture_2d<u32>;
@group(0) @binding(10) var second_uvs: texture_2d<f32>;
// Equal to `ROW` in src/scene/data_texture.rs.
const ELEMENTS_A_ROW: u32 = 1024u;

// Images as they are, with their own levels: a view for every slot with TEXTURE_BOUND.
#ifdef BOUND_TEXTURES
#ifdef RAY_QUERY
@group(4) @binding(0) var bound_textures: binding_array<texture_2d<f32>>;
#else
@group(3) @binding(0) var bound_textures: binding_array<texture_2d<f32>>;
#endif
#endif
