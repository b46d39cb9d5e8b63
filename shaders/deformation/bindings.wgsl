// Group 0 of the passes that pose bodies.  They write to the buffers of the scene, which all other passes only read.
#define_import_path bevy_restir::deformation::bindings

#import bevy_restir::deformation::types::Body
#import bevy_restir::scene::types::{Triangle, Vertex}

@group(0) @binding(0) var<storage, read> bodies: array<Body>;
// Tables of the meshes that bend.  The table of a mesh never changes.
@group(0) @binding(1) var<storage, read> rigs: array<u32>;
// The poses of this frame: for each joint the rows of the transform from the mesh at rest to the instance; for each active morph target its
// weight and its index.
@group(0) @binding(2) var<storage, read> poses: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> triangles: array<Triangle>;
@group(0) @binding(4) var<storage, read_write> vertices: array<Vertex>;
@group(0) @binding(5) var<storage, read_write> nodes: array<vec4<u32>>;
// The box of each node, minimum and maximum.
@group(0) @binding(6) var<storage, read_write> boxes: array<vec4<f32>>;
