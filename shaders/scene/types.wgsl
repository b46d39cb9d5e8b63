// The scene as the GPU holds it: one struct a buffer.  Each is equal by test to `GpuX` in `src/gpu_types.rs`.
#define_import_path bevy_restir::scene::types

// What changes when the scene does.
struct SceneUniforms {
    tlas_root: u32,            // node index (5 vec4 a node) of the top level, NONE when the scene is empty
    tlas_indices: u32,         // index into `nodes` of the packed instance list of the top level, 4 a vec4
    previous_tlas_root: u32,
    previous_tlas_indices: u32,
    light_count: u32,          // lights in the alias table
    instance_count: u32,
    light_power: f32,          // W per unit of luminous emission: luminance-weighted power of every light of the table
    radius: f32,               // of a sphere round every instance, m
    center: vec3<f32>,         // of that sphere
    previous_lights: u32,      // index in `lights` of the last frame's table; 0 where it is this frame's
    shapes_root: u32,          // as `tlas_root`, of the tree over balls and rectangles; its primitives are lights
    shapes_indices: u32,
    sun_count: u32,            // suns with a disc, the first of the table
    pad: u32,
}

// Object-space positions of a triangle, in the order of the leaves of its bottom-level tree.
struct Triangle {
    a: vec3<f32>,
    pad_a: u32,
    b: vec3<f32>,
    pad_b: u32,
    c: vec3<f32>,
    pad_c: u32,
}

// What a triangle's corners carry besides a position.  Normals and tangents are octahedral, two snorm16 to a word;
// the lowest bit of a tangent's word is set where the bitangent is flipped.
struct TriangleAttributes {
    normals: vec3<u32>,
    tangent_a: u32,
    tangent_b: u32,
    tangent_c: u32,
    uv_a: vec2<f32>,
    uv_b: vec2<f32>,
    uv_c: vec2<f32>,
}

// The three columns of a mat3x4 are the rows of the affine 3x4 matrix: `vec4(p, 1) * m` transforms a point, `v * m` with w = 0 a vector.
struct Instance {
    world_from_object: mat3x4<f32>,
    object_from_world: mat3x4<f32>,
    previous_world_from_object: mat3x4<f32>,
    blas_root: u32,            // node index of the bottom level
    first_triangle: u32,
    triangle_count: u32,
    material: u32,
    first_light: u32,          // light of the first triangle, the others follow; NONE where the material does not emit
    flags: u32,                // INSTANCE_*
    layers: u32,               // bits 0 to 7: sets of render layers whose rays meet it; 8 to 15: whose cameras see it
    entity: u32,               // index of the Bevy entity, for debug views
}

// The slot of a texture: x = layer | flags of scene/texture.wgsl, y = left | top << 16, z = width | height << 16, w = 0.  x = NONE: the
// image is not there.
struct Material {
    base_color: vec3<f32>,
    alpha: f32,
    emissive: vec3<f32>,       // radiance, cd/m², the global emissive luminance included
    perceptual_roughness: f32,
    dielectric_reflectance: vec3<f32>,  // 0.16 (reflectance · tint)²
    metallic: f32,
    attenuation: vec3<f32>,    // absorption coefficient of the inside, 1/m
    specular_transmission: f32,
    ior: f32,
    thickness: f32,
    alpha_cutoff: f32,
    flags: u32,                // MATERIAL_*
    textures: u32,             // SLOT_*: those that it has
    texture_record: u32,       // index of its record in `texture_table`
    anisotropy_direction: vec2<f32>,    // (cosine, sine) of the angle from the tangent
    anisotropy_strength: f32,
    diffuse_transmission: f32,
    clearcoat: f32,
    clearcoat_perceptual_roughness: f32,
}

// `data` by kind: triangle = (instance, triangle); bits of: spot = (cosine of the inner, of the outer angle), sphere = (radius, 0),
// rectangle = (half its width, half its height), sun = (1 - cosine of the disc's half angle, 0).
struct Light {
    position: vec3<f32>,       // point, spot; center of a sphere or rectangle
    kind: u32,                 // LIGHT_*, and LIGHT_HIDDEN_SHIFT
    emission: vec3<f32>,       // triangle: mean radiance; sphere, rectangle, sun: radiance; point, spot: intensity, cd; directional:
                               // illuminance, lux
    pmf: f32,                  // probability of this light in the table
    direction: vec3<f32>,      // spot, directional, sun: the way the light travels; rectangle: its rotation (`light/rect.wgsl`)
    alias_probability: f32,
    alias_index: u32,
    counterpart: u32,          // where the table changed: id of the same light in the other frame's table, or NONE
    data: vec2<u32>,
}
