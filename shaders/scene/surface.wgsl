// A point that a ray met, ready for shading: position, normals, material with its textures.
#define_import_path bevy_restir::scene::surface

#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::{ALPHA_MIN, INSTANCE_MIRRORED, MATERIAL_DOUBLE_SIDED, MATERIAL_FLIP_NORMAL_MAP_Y, MATERIAL_TWO_COMPONENT_NORMAL_MAP, MATERIAL_UNLIT, NONE}
#import bevy_restir::common::math::octahedral_decode
#import bevy_restir::scene::albedo::multiple_scattering
#import bevy_restir::scene::bindings::{attributes, instances, materials}
#import bevy_restir::scene::texture::{has_texture, sample_color, sample_data}
#import bevy_restir::scene::triangle::{instance_transform, safe_normalize, transform_normal, transform_vector, triangle_uv, world_triangle}
#import bevy_restir::trace::offset::{offset_distance, surface_point}

struct Surface {
    position: vec3<f32>,
    offset: f32,              // how far along ±n_geo a ray starts, m
    emission: vec3<f32>,      // towards the viewer, cd/m²; unlit colour included only as `unlit`
    front: u32,               // 1: seen from the front face
    unlit: vec3<f32>,         // what the camera alone sees
    material: u32,
    attenuation: vec3<f32>,   // of the inside, 1/m
    light: u32,               // id of this triangle in the light table, or NONE
    bsdf: Bsdf,
}

#ifdef TEXTURES
fn base_color_at(material: u32, uv: vec2<f32>) -> vec3<f32> {
    let slot = materials[material].base_color_texture;
    if !has_texture(slot) {
        return materials[material].base_color;
    }
    return materials[material].base_color * sample_color(slot, uv).rgb;
}

// (metallic, perceptual roughness): glTF keeps them in blue and green.
fn metallic_roughness_at(material: u32, uv: vec2<f32>) -> vec2<f32> {
    let factor = vec2<f32>(materials[material].metallic, materials[material].perceptual_roughness);
    let slot = materials[material].metallic_roughness_texture;
    if !has_texture(slot) {
        return factor;
    }
    return factor * sample_data(slot, uv).bg;
}

fn emission_at(material: u32, uv: vec2<f32>) -> vec3<f32> {
    let slot = materials[material].emissive_texture;
    if !has_texture(slot) {
        return materials[material].emissive;
    }
    return materials[material].emissive * sample_color(slot, uv).rgb;
}
#else
fn base_color_at(material: u32, uv: vec2<f32>) -> vec3<f32> {
    return materials[material].base_color;
}

fn metallic_roughness_at(material: u32, uv: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(materials[material].metallic, materials[material].perceptual_roughness);
}

fn emission_at(material: u32, uv: vec2<f32>) -> vec3<f32> {
    return materials[material].emissive;
}
#endif

#ifdef NORMAL_MAPS
// Mikkelsen's frame: interpolated, the bitangent from both, not normalised between.
fn mapped_normal(material: u32, m: mat3x4<f32>, mirrored: bool, triangle: u32, barycentrics: vec2<f32>, uv: vec2<f32>, n: vec3<f32>) -> vec3<f32> {
    let slot = materials[material].normal_texture;
    if !has_texture(slot) {
        return n;
    }
    let flags = materials[material].flags;
    var texel = sample_data(slot, uv).xyz * 2.0 - 1.0;
    if (flags & MATERIAL_TWO_COMPONENT_NORMAL_MAP) != 0u {
        texel.z = sqrt(max(0.0, 1.0 - dot(texel.xy, texel.xy)));
    }
    if (flags & MATERIAL_FLIP_NORMAL_MAP_Y) != 0u {
        texel.y = -texel.y;
    }
    let a = attributes[triangle];
    let t_object = (1.0 - barycentrics.x - barycentrics.y) * octahedral_decode(a.tangent_a)
        + barycentrics.x * octahedral_decode(a.tangent_b)
        + barycentrics.y * octahedral_decode(a.tangent_c);
    let t = safe_normalize(transform_vector(m, t_object));
    let handedness = select(1.0, -1.0, ((a.tangent_a & 1u) != 0u) != mirrored);
    let b = handedness * cross(n, t);
    return safe_normalize(texel.x * t + texel.y * b + texel.z * n);
}
#else
fn mapped_normal(material: u32, m: mat3x4<f32>, mirrored: bool, triangle: u32, barycentrics: vec2<f32>, uv: vec2<f32>, n: vec3<f32>) -> vec3<f32> {
    return n;
}
#endif

// Between the vertices' normals, on the front side like the geometric one whatever the file says.
fn interpolated_normal(triangle: u32, barycentrics: vec2<f32>, m: mat3x4<f32>, mirrored: bool, n_geo: vec3<f32>) -> vec3<f32> {
    let a = attributes[triangle];
    let n_object = (1.0 - barycentrics.x - barycentrics.y) * octahedral_decode(a.normals.x)
        + barycentrics.x * octahedral_decode(a.normals.y)
        + barycentrics.y * octahedral_decode(a.normals.z);
    let n = safe_normalize(transform_normal(m, n_object, mirrored));
    return select(n, -n, dot(n, n_geo) < 0.0);
}

// The part of a surface that needs nothing of its material.
struct Shape {
    position: vec3<f32>,
    n: vec3<f32>,             // without a normal map
    n_geo: vec3<f32>,
    material: u32,
}

// `previous`: as it was in the last frame.
fn shape_at(instance: u32, triangle: u32, barycentrics: vec2<f32>, viewer: vec3<f32>, previous: bool) -> Shape {
    let t = world_triangle(instance, triangle, previous);
    let mirrored = (instances[instance].flags & INSTANCE_MIRRORED) != 0u;
    let n = interpolated_normal(triangle, barycentrics, instance_transform(instance, previous), mirrored, t.normal);
    let side = select(-1.0, 1.0, dot(viewer - t.corner, t.normal) > 0.0);
    return Shape(surface_point(instance, triangle, barycentrics, previous), n * side, t.normal * side, instances[instance].material);
}

// `previous`: as it was in the last frame.
fn surface_at(instance: u32, triangle: u32, barycentrics: vec2<f32>, wo: vec3<f32>, previous: bool) -> Surface {
    let t = world_triangle(instance, triangle, previous);
    let m = instance_transform(instance, previous);
    let mirrored = (instances[instance].flags & INSTANCE_MIRRORED) != 0u;
    let material = instances[instance].material;
    let flags = materials[material].flags;
    let uv = triangle_uv(triangle, barycentrics);

    var n = interpolated_normal(triangle, barycentrics, m, mirrored, t.normal);
    n = mapped_normal(material, m, mirrored, triangle, barycentrics, uv, n);

    // Seen from behind, normals are flipped.
    let front = dot(wo, t.normal) > 0.0;
    let side = select(-1.0, 1.0, front);
    let base_color = base_color_at(material, uv);
    let metallic_roughness = metallic_roughness_at(material, uv);
    let ior = materials[material].ior;
    let alpha = max(metallic_roughness.y * metallic_roughness.y, ALPHA_MIN);

    var s: Surface;
    s.position = surface_point(instance, triangle, barycentrics, previous);
    s.offset = offset_distance(instance, triangle, barycentrics);
    s.front = u32(front);
    s.material = material;
    s.attenuation = materials[material].attenuation;
    s.light = NONE;
    if instances[instance].first_light != NONE {
        s.light = instances[instance].first_light + triangle - instances[instance].first_triangle;
    }
    let emits = (flags & MATERIAL_UNLIT) == 0u && (front || (flags & MATERIAL_DOUBLE_SIDED) != 0u);
    s.emission = select(vec3<f32>(0.0), emission_at(material, uv), emits);
    s.unlit = select(vec3<f32>(0.0), base_color, (flags & MATERIAL_UNLIT) != 0u);
    s.bsdf.n = n * side;
    s.bsdf.n_geo = t.normal * side;
    s.bsdf.base_color = base_color;
    s.bsdf.metallic = metallic_roughness.x;
    s.bsdf.dielectric_reflectance = materials[material].dielectric_reflectance;
    s.bsdf.roughness = alpha;
    s.bsdf.transmission = materials[material].specular_transmission;
    s.bsdf.eta = select(1.0 / ior, ior, front);
    s.bsdf.compensation = multiple_scattering(alpha, dot(wo, s.bsdf.n));
    if (flags & MATERIAL_UNLIT) != 0u {
        // Shown, but not lit: black to every ray.
        s.bsdf.base_color = vec3<f32>(0.0);
        s.bsdf.dielectric_reflectance = vec3<f32>(0.0);
        s.bsdf.transmission = 0.0;
    }
    return s;
}
