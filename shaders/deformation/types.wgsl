// Bodies: instances of skinned or morphed meshes.  Each has triangles, vertices and a tree of its own in the buffers of the scene.  Its
// triangles and its vertices are stored twice: those of this frame, followed by those of the last frame.
#define_import_path bevy_restir::deformation::types

// Tables of `rigs` are given by the index of their first word.
struct Body {
    rest_triangle: u32,        // first triangle of its mesh
    triangle: u32,             // first of its own triangles
    triangle_count: u32,
    rest_vertex: u32,          // first vertex of its mesh
    vertex: u32,               // first of its own vertices
    vertex_count: u32,
    rest_node: u32,            // root of the tree of its mesh
    node: u32,                 // root of its own tree
    first_box: u32,            // first of its elements of `boxes`
    influences: u32,           // table: joints and weights of each vertex; NONE without a skin
    targets: u32,              // table: displacements of each vertex by each morph target
    levels: u32,               // table: nodes by level (`deformation/refit.wgsl`)
    level_count: u32,
    joints: u32,               // first of three rows for each joint in `poses`
    joint_count: u32,
    weights: u32,              // first of its active morph targets in `poses`
    weight_count: u32,
    flags: u32,                // BODY_*
}

// The body is new: it has no triangles yet, and no vertices of the last frame.
const BODY_APPEARED: u32 = 1u;
