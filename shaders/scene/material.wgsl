// Materials at a point of a triangle: factors times textures.  The texture slots of a material are in `texture_table`; one loop samples all
// of them, so that the sampling code is compiled once.
#define_import_path bevy_restir::scene::material

#import bevy_restir::common::constants::{INSTANCE_SECOND_UV, INSTANCE_VERTEX_COLORS, LEAST_DIVISOR, MATERIAL_ALPHA_BLEND, MATERIAL_ALPHA_MASK, MATERIAL_FLIP_NORMAL_MAP_Y, MATERIAL_UNLIT, SLOT_ANISOTROPY, SLOT_BASE_COLOR, SLOT_CLEARCOAT, SLOT_CLEARCOAT_NORMAL, SLOT_CLEARCOAT_ROUGHNESS, SLOT_DIFFUSE_TRANSMISSION, SLOT_EMISSIVE, SLOT_METALLIC_ROUGHNESS, SLOT_NORMAL, SLOT_SPECULAR, SLOT_SPECULAR_TINT, SLOT_SPECULAR_TRANSMISSION, SLOT_THICKNESS, SLOT_TRANSFORM}
#import bevy_restir::common::math::max_component
#import bevy_restir::scene::bindings::{element_texel, instances, materials, second_uvs, texture_table, vertex_colors}
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::corners::{corner_uvs, CornerUvs}
#import bevy_restir::scene::texture::{has_texture, sample_area, sample_texture, TEXTURE_SECOND_UV, TEXTURE_TWO_COMPONENTS, TextureArea}
#import bevy_restir::scene::triangle::{safe_normalize, WorldTriangle}

// A material's factors times its textures.
struct MaterialPoint {
    base_color: vec3<f32>,
    metallic: f32,
    emission: vec3<f32>,
    perceptual_roughness: f32,
    dielectric_reflectance: vec3<f32>,
    specular_transmission: f32,
    normal: vec3<f32>,         // in tangent space; (0, 0, 1) without a normal map
    diffuse_transmission: f32,
    coat_normal: vec3<f32>,    // in tangent space
    thickness: f32,
    anisotropy_direction: vec2<f32>,
    anisotropy_strength: f32,
    clearcoat: f32,
    clearcoat_perceptual_roughness: f32,
}

// The material at a point of a triangle, with the mesh's vertex colors, and its textures filtered over the footprint of a ray cone.
fn material_at(instance: u32, triangle: u32, barycentrics: vec2<f32>, t: WorldTriangle, wo: vec3<f32>, cone: Cone) -> MaterialPoint {
    let material = instances[instance].material;
    let p = MaterialPoint(
        materials[material].base_color * vertex_color_at(instance, triangle, barycentrics).rgb,
        materials[material].metallic,
        materials[material].emissive,
        materials[material].perceptual_roughness,
        materials[material].dielectric_reflectance,
        materials[material].specular_transmission,
        vec3<f32>(0.0, 0.0, 1.0),
        materials[material].diffuse_transmission,
        vec3<f32>(0.0, 0.0, 1.0),
        materials[material].thickness,
        materials[material].anisotropy_direction,
        materials[material].anisotropy_strength,
        materials[material].clearcoat,
        materials[material].clearcoat_perceptual_roughness,
    );
    return in_range(with_textures(p, instance, triangle, barycentrics, t, wo, cone), materials[material].flags);
}

// Vertex colors, textures of floats and tints may exceed 1.  Only colors of unlit materials stay as they are; all else would reflect more
// light than it receives.
fn in_range(point: MaterialPoint, flags: u32) -> MaterialPoint {
    var p = point;
    if (flags & MATERIAL_UNLIT) == 0u {
        p.base_color = min(p.base_color, vec3<f32>(1.0));
    }
    p.metallic = min(p.metallic, 1.0);
    p.perceptual_roughness = min(p.perceptual_roughness, 1.0);
    p.dielectric_reflectance = min(p.dielectric_reflectance, vec3<f32>(1.0));
    p.specular_transmission = min(p.specular_transmission, 1.0);
    p.diffuse_transmission = min(p.diffuse_transmission, 1.0);
    p.anisotropy_strength = min(p.anisotropy_strength, 1.0);
    p.clearcoat = min(p.clearcoat, 1.0);
    p.clearcoat_perceptual_roughness = min(p.clearcoat_perceptual_roughness, 1.0);
    return p;
}

// Whether surfaces of an instance may emit light; unlit ones do.
fn may_emit(instance: u32) -> bool {
    return max_component(materials[instances[instance].material].emissive) > 0.0;
}

// Normal in tangent space from a texel of a normal map.
fn decode_normal(slot: vec4<u32>, texel: vec4<f32>, flags: u32) -> vec3<f32> {
    var n = texel.xyz * 2.0 - 1.0;
    if (slot.x & TEXTURE_TWO_COMPONENTS) != 0u {
        n.z = sqrt(max(0.0, 1.0 - dot(n.xy, n.xy)));
    }
    if (flags & MATERIAL_FLIP_NORMAL_MAP_Y) != 0u {
        n.y = -n.y;
    }
    return n;
}

#ifdef TEXTURES
fn with_textures(factors: MaterialPoint, instance: u32, triangle: u32, barycentrics: vec2<f32>, t: WorldTriangle, wo: vec3<f32>, cone: Cone) -> MaterialPoint {
    let material = instances[instance].material;
    let footprint = cone_footprint(cone, t, wo);
    let first = corner_uvs(triangle);
    let second = second_corner_uvs(instance, triangle);
    let transform = uv_transform_of(material);
    var at = first_slot(material);
    var p = factors;
    for (var kinds = materials[material].textures & ~SLOT_TRANSFORM; kinds != 0u; kinds &= kinds - 1u) {
        let slot = table_entry(at);
        at += 1u;
        var uvs = first;
        if (slot.x & TEXTURE_SECOND_UV) != 0u {
            uvs = second;
        }
        let area = TextureArea(
            transform_uv(transform, interpolate_uv(uvs, barycentrics)),
            transform_uv_vector(transform, interpolate_uv_vector(uvs, footprint.xy)),
            transform_uv_vector(transform, interpolate_uv_vector(uvs, footprint.zw)),
        );
        if has_texture(slot) {
            p = with_texel(p, kinds & (0u - kinds), slot, sample_area(slot, area), materials[material].flags);
        }
    }
    return p;
}

fn with_texel(factors: MaterialPoint, kind: u32, slot: vec4<u32>, texel: vec4<f32>, flags: u32) -> MaterialPoint {
    var p = factors;
    switch kind {
        case SLOT_BASE_COLOR: {
            p.base_color *= texel.rgb;
        }
        case SLOT_METALLIC_ROUGHNESS: {
            p.metallic *= texel.b;
            p.perceptual_roughness *= texel.g;
        }
        case SLOT_NORMAL: {
            p.normal = decode_normal(slot, texel, flags);
        }
        case SLOT_EMISSIVE: {
            p.emission *= texel.rgb;
        }
        default: {
            p = with_layer_texel(p, kind, slot, texel, flags);
        }
    }
    return p;
}

// The ellipse that a ray cone covers on the triangle, in barycentrics: its long axis (along the slant of the ray), and its short axis.
fn cone_footprint(cone: Cone, t: WorldTriangle, wo: vec3<f32>) -> vec4<f32> {
    let cosine = dot(wo, t.normal);
    let slant = wo - cosine * t.normal;
    let along = safe_normalize(select(slant, t.edge_b, dot(slant, slant) < 1.0e-6));
    let long = along * (cone.width / max(abs(cosine), 1.0e-3));
    let short = cross(t.normal, along) * cone.width;
    let scale = 1.0 / max(2.0 * t.area, LEAST_DIVISOR);
    let footprint = scale * vec4<f32>(
        dot(cross(long, t.edge_c), t.normal),
        dot(cross(t.edge_b, long), t.normal),
        dot(cross(short, t.edge_c), t.normal),
        dot(cross(t.edge_b, short), t.normal),
    );
    return clamp(footprint, vec4<f32>(-1.0e6), vec4<f32>(1.0e6));
}

// A texture of the material at a point, without filtering over a footprint.
fn texel_at(kind: u32, instance: u32, triangle: u32, barycentrics: vec2<f32>) -> vec4<f32> {
    let material = instances[instance].material;
    let kinds = materials[material].textures;
    if (kinds & kind) == 0u {
        return vec4<f32>(1.0);
    }
    let slot = table_entry(first_slot(material) + countOneBits(kinds & (kind - 1u)));
    if !has_texture(slot) {
        return vec4<f32>(1.0);
    }
    var uvs = corner_uvs(triangle);
    if (slot.x & TEXTURE_SECOND_UV) != 0u {
        uvs = second_corner_uvs(instance, triangle);
    }
    return sample_texture(slot, transform_uv(uv_transform_of(material), interpolate_uv(uvs, barycentrics)));
}

fn emission_at(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> vec3<f32> {
    return materials[instances[instance].material].emissive * texel_at(SLOT_EMISSIVE, instance, triangle, barycentrics).rgb;
}

fn alpha_at(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> f32 {
    let alpha = materials[instances[instance].material].alpha * vertex_color_at(instance, triangle, barycentrics).a;
    return alpha * texel_at(SLOT_BASE_COLOR, instance, triangle, barycentrics).a;
}

fn interpolate_uv(uvs: CornerUvs, b: vec2<f32>) -> vec2<f32> {
    return (1.0 - b.x - b.y) * uvs.a + b.x * uvs.b + b.y * uvs.c;
}

// Change of texture coordinates along a vector `d` in barycentrics.
fn interpolate_uv_vector(uvs: CornerUvs, d: vec2<f32>) -> vec2<f32> {
    return d.x * (uvs.b - uvs.a) + d.y * (uvs.c - uvs.a);
}

fn table_entry(index: u32) -> vec4<u32> {
    return textureLoad(texture_table, element_texel(index, 1u), 0);
}

// Index of the first texture slot of a record, which begins with the transform of the texture coordinates if there is one.
fn first_slot(material: u32) -> u32 {
    return materials[material].texture_record + select(0u, 2u, (materials[material].textures & SLOT_TRANSFORM) != 0u);
}

struct UvTransform {
    columns: mat2x2<f32>,
    shift: vec2<f32>,
}

fn uv_transform_of(material: u32) -> UvTransform {
    if (materials[material].textures & SLOT_TRANSFORM) == 0u {
        return UvTransform(mat2x2<f32>(vec2<f32>(1.0, 0.0), vec2<f32>(0.0, 1.0)), vec2<f32>(0.0));
    }
    let columns = bitcast<vec4<f32>>(table_entry(materials[material].texture_record));
    let shift = bitcast<vec4<f32>>(table_entry(materials[material].texture_record + 1u));
    return UvTransform(mat2x2<f32>(columns.xy, columns.zw), shift.xy);
}

fn transform_uv(t: UvTransform, uv: vec2<f32>) -> vec2<f32> {
    return t.columns * uv + t.shift;
}

fn transform_uv_vector(t: UvTransform, d: vec2<f32>) -> vec2<f32> {
    return t.columns * d;
}
#else
fn with_textures(factors: MaterialPoint, instance: u32, triangle: u32, barycentrics: vec2<f32>, t: WorldTriangle, wo: vec3<f32>, cone: Cone) -> MaterialPoint {
    return factors;
}

fn emission_at(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> vec3<f32> {
    return materials[instances[instance].material].emissive;
}

fn alpha_at(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> f32 {
    return materials[instances[instance].material].alpha * vertex_color_at(instance, triangle, barycentrics).a;
}
#endif

// Probability that a ray hits the surface: 0 or 1 with a mask, alpha with blending.
#ifdef ALPHA
fn opacity_at(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> f32 {
    let material = instances[instance].material;
    let flags = materials[material].flags;
    if (flags & (MATERIAL_ALPHA_MASK | MATERIAL_ALPHA_BLEND)) == 0u {
        return 1.0;
    }
    let alpha = alpha_at(instance, triangle, barycentrics);
    if (flags & MATERIAL_ALPHA_MASK) != 0u {
        return select(0.0, 1.0, alpha >= materials[material].alpha_cutoff);
    }
    return clamp(alpha, 0.0, 1.0);
}
#else
fn opacity_at(instance: u32, triangle: u32, barycentrics: vec2<f32>) -> f32 {
    return 1.0;
}
#endif

// Textures other than base color, metallic-roughness, normal and emissive.
#ifdef LAYER_TEXTURES
fn with_layer_texel(factors: MaterialPoint, kind: u32, slot: vec4<u32>, texel: vec4<f32>, flags: u32) -> MaterialPoint {
    var p = factors;
    switch kind {
        case SLOT_SPECULAR: {
            // Bevy multiplies the reflectance by alpha / 2; `dielectric_reflectance` holds the square of the reflectance.
            p.dielectric_reflectance *= 0.25 * texel.a * texel.a;
        }
        case SLOT_SPECULAR_TINT: {
            p.dielectric_reflectance *= texel.rgb * texel.rgb;
        }
        case SLOT_SPECULAR_TRANSMISSION: {
            p.specular_transmission *= texel.r;
        }
        case SLOT_DIFFUSE_TRANSMISSION: {
            p.diffuse_transmission *= texel.a;
        }
        case SLOT_THICKNESS: {
            p.thickness *= texel.g;
        }
        case SLOT_CLEARCOAT: {
            p.clearcoat *= texel.r;
        }
        case SLOT_CLEARCOAT_ROUGHNESS: {
            p.clearcoat_perceptual_roughness *= texel.g;
        }
        case SLOT_CLEARCOAT_NORMAL: {
            p.coat_normal = decode_normal(slot, texel, flags);
        }
        case SLOT_ANISOTROPY: {
            // The texture's angle is added to that of the material.
            let own = p.anisotropy_direction;
            let d = texel.rg * 2.0 - 1.0;
            let turned = vec2<f32>(own.x * d.x - own.y * d.y, own.y * d.x + own.x * d.y);
            p.anisotropy_direction = select(own, turned * inverseSqrt(max(dot(d, d), 1.0e-6)), dot(d, d) > 1.0e-6);
            p.anisotropy_strength *= texel.b;
        }
        default: {}
    }
    return p;
}
#else
fn with_layer_texel(factors: MaterialPoint, kind: u32, slot: vec4<u32>, texel: vec4<f32>, flags: u32) -> MaterialPoint {
    return factors;
}
#endif

// The second texture coordinates; the first ones if the mesh has no second ones, and 0 where they do not fit the device.
#ifdef SECOND_UVS
fn second_corner_uvs(instance: u32, triangle: u32) -> CornerUvs {
    if (instances[instance].flags & INSTANCE_SECOND_UV) == 0u {
        return corner_uvs(triangle);
    }
    let at = element_texel(triangle, 3u);
    if any(at + vec2<u32>(2u, 0u) >= textureDimensions(second_uvs)) {
        return CornerUvs(vec2<f32>(0.0), vec2<f32>(0.0), vec2<f32>(0.0));
    }
    return CornerUvs(
        textureLoad(second_uvs, at, 0).xy,
        textureLoad(second_uvs, at + vec2<u32>(1u, 0u), 0).xy,
        textureLoad(second_uvs, at + vec2<u32>(2u, 0u), 0).xy,
    );
}
#else
fn second_corner_uvs(instance: u32, triangle: u32) -> CornerUvs {
    return corner_uvs(triangle);
}
#endif

// The vertex color at a point, linear; white if the mesh has none, and where the colors do not fit the device.
#ifdef VERTEX_COLORS
fn vertex_color_at(instance: u32, triangle: u32, b: vec2<f32>) -> vec4<f32> {
    if (instances[instance].flags & INSTANCE_VERTEX_COLORS) == 0u {
        return vec4<f32>(1.0);
    }
    let at = element_texel(triangle, 3u);
    if any(at + vec2<u32>(2u, 0u) >= textureDimensions(vertex_colors)) {
        return vec4<f32>(1.0);
    }
    return (1.0 - b.x - b.y) * textureLoad(vertex_colors, at, 0) + b.x * textureLoad(vertex_colors, at + vec2<u32>(1u, 0u), 0)
        + b.y * textureLoad(vertex_colors, at + vec2<u32>(2u, 0u), 0);
}
#else
fn vertex_color_at(instance: u32, triangle: u32, b: vec2<f32>) -> vec4<f32> {
    return vec4<f32>(1.0);
}
#endif
