// Elements of the scene's buffers.  A test holds each struct X equal to `GpuX` in `src/gpu_layout.rs`.
#define_import_path bevy_restir::scene::types

// Uniforms that change with the scene.
struct SceneUniforms {
    tlas_root: u32,            // index of the top level's root node (5 vec4 each); NONE if the scene is empty
    tlas_indices: u32,         // index in `nodes` of the top level's list of instances, packed 4 in a vec4
    previous_tlas_root: u32,
    previous_tlas_indices: u32,
    lights_end: u32,           // end of the records in use in `lights`, or 0 if nothing emits
    instance_count: u32,       // number of slots of `instances`; no shader reads it
    light_power: f32,          // power of all lights of the table, by luminance, lm
    radius: f32,               // radius of a sphere around all instances, m
    center: vec3<f32>,         // center of that sphere
    previous_first_bin: u32,   // `first_bin` of the last frame: the same if no light has changed; NONE if its lights are unknown
    shapes_root: u32,          // like `tlas_root`, for the tree over spherical and rectangular lights
    shapes_indices: u32,       // like `tlas_indices`: the list of these lights
    sun_count: u32,            // number of suns with a disk, which have the first bins
    environment_limit: f32,    // largest probability of the environment beside the lights of the table
    previous_center: vec3<f32>, // sphere around all instances in the last frame
    previous_radius: f32,
    light_bins: u32,           // number of bins of the choice of a light
    previous_light_bins: u32,  // that of the last frame
    first_bin: u32,            // index in `lights` of the first bin
    first_mesh_bin: u32,       // index in `lights` of the first bin of an emissive mesh; they follow those of analytic lights
}

// The vertices of a triangle, by their indices in `vertices`.  Triangles have the order of the leaves of their bottom-level tree.
struct Triangle {
    a: u32,
    b: u32,
    c: u32,
}

// A vertex in object space (`scene/triangle.wgsl`, `scene/corners.wgsl`), which all triangles around it share.  It has 32 bytes, four of them
// unused, so that a position is one aligned load.  Normal and tangent are octahedral, two snorm16 per word; the lowest bit of a tangent is
// set if the bitangent is flipped.
struct Vertex {
    position: vec3<f32>,
    normal: u32,               // NOT_GIVEN: each triangle has that of its plane
    uv: vec2<f32>,
    tangent: u32,              // NOT_GIVEN: each triangle has that of its texture coordinates
}

// The word of a normal or a tangent that the mesh does not have.  No unit vector is packed to it.
const NOT_GIVEN: u32 = 0x80000000u;

// The three columns of a mat3x4 are the rows of the affine 3x4 matrix: `vec4(p, 1) * m` transforms a point, `v * m` with w = 0 a vector.
struct Instance {
    world_from_object: mat3x4<f32>,
    object_from_world: mat3x4<f32>,
    previous_world_from_object: mat3x4<f32>,
    blas_root: u32,            // node index of the bottom-level tree; NONE once the instance is removed
    first_triangle: u32,
    triangle_count: u32,
    material: u32,
    first_light: u32,          // light of the first triangle, with the others behind it; NONE if the material does not emit
    flags: u32,                // INSTANCE_*
    layers: u32,               // a bit for each set of render layers: 0 to 7, whether rays of its cameras hit it; 8 to 15, whether its
                               // cameras see it directly
    entity: u32,               // index of the Bevy entity; no shader reads it, it names the instance in a GPU debugger
}

// A texture slot is a vec4: x = page of the atlas | flags of scene/texture.wgsl, y = left | top << 16, z = width | height << 16, w = 0.
// x = NONE: the image is missing.
struct Material {
    base_color: vec3<f32>,
    alpha: f32,
    emissive: vec3<f32>,       // radiance, cd/m², including the global emissive luminance
    perceptual_roughness: f32,
    dielectric_reflectance: vec3<f32>,  // 0.16 (reflectance · tint)²
    metallic: f32,
    attenuation: vec3<f32>,    // absorption coefficient of the volume inside, 1/m
    specular_transmission: f32,
    ior: f32,
    thickness: f32,
    alpha_cutoff: f32,
    flags: u32,                // MATERIAL_*
    textures: u32,             // SLOT_* of its textures
    texture_record: u32,       // index of its record in `texture_table`
    anisotropy_direction: vec2<f32>,    // (cosine, sine) of the angle from the tangent
    anisotropy_strength: f32,
    diffuse_transmission: f32,
    clearcoat: f32,
    clearcoat_perceptual_roughness: f32,
}

// A record of `lights`.  The id of a light is the index of its record.  `src/scene/light/table.rs` describes the places of records: a bin for
// each analytic light and each emissive mesh, and for each mesh a header and behind it its triangles.
// `data` by kind: triangle: (instance, triangle); mesh: (id of its first triangle, number of triangles); header: (bin of the mesh, counted
// from `first_mesh_bin`, or NONE if only the last frame had these triangles, 0).  Others hold bits of f32: spot: cosines of the (inner, outer)
// angle; sphere: (radius, 0); rectangle: (half width, half height); sun: (1 - cosine of the disk's angular radius, 0).
struct Light {
    position: vec3<f32>,       // of a point or spot light; center of a sphere or rectangle
    kind: u32,                 // LIGHT_*, and hidden sets of render layers from LIGHT_HIDDEN_SHIFT on
    emission: vec3<f32>,       // sphere, rectangle, sun: radiance; point, spot: intensity, cd;
                               // directional: illuminance, lux
    pmf: f32,                  // of a bin: probability in the table; of a triangle: in its mesh
    direction: vec3<f32>,      // spot, directional, sun: direction of propagation; rectangle: rotation (`light/rect.wgsl`)
    alias_probability: f32,
    alias_index: u32,          // of a bin: another bin, counted from the first one; of a triangle: another one, from the first of its mesh
    link: u32,                 // of a triangle: index of the header of its mesh; of an analytic light: its id in the other frame; of a header:
                               // id of the mesh's first triangle in the other frame; NONE if the other frame does not have the light
    data: vec2<u32>,
}
