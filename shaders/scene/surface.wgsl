// The surface at a hit point, for shading: position, normals, emission, and the BSDF of the textured material.
#define_import_path bevy_restir::scene::surface

#import bevy_restir::bsdf::types::Bsdf
#import bevy_restir::common::constants::{ALPHA_MIN, MATERIAL_DOUBLE_SIDED, MATERIAL_UNLIT, NONE}
#import bevy_restir::common::guard::{GUARD_SURFACE, guard_holds, guarded_3}
#import bevy_restir::common::math::is_finite_3
#import bevy_restir::scene::bindings::{instances, materials}
#import bevy_restir::scene::cone::Cone
#import bevy_restir::scene::corners::{corner_normals, corner_tangents}
#import bevy_restir::scene::directional_albedo::multiple_scattering
#import bevy_restir::scene::lobes::{TangentFrame, with_lobes}
#import bevy_restir::scene::material::material_at
#import bevy_restir::scene::offset::{offset_distance, surface_point}
#import bevy_restir::scene::subsurface::subsurface_at
#import bevy_restir::scene::triangle::{Corners, instance_transform, is_mirrored, safe_normalize, stored_triangle, transform_normal, transform_vector, world_triangle}

struct Surface {
    position: vec3<f32>,
    offset: f32,              // distance along ±n_geo at which rays start, m
    emission: vec3<f32>,      // towards wo, cd/m²
    front: u32,               // 1: seen from the front face
    unlit: vec3<f32>,         // radiance of an unlit material, which only the camera sees
    material: u32,
    attenuation: vec3<f32>,   // absorption coefficient of the volume inside, 1/m
    light: u32,               // id of this triangle in the light table, or NONE
    radius: vec3<f32>,        // length d of the subsurface profile, m; 0 in channels that do not scatter below the surface
    instance: u32,
    smooth_n: vec3<f32>,      // normal without a normal map, on wo's side
    bsdf: Bsdf,
}

fn interpolated(corners: Corners, barycentrics: vec2<f32>) -> vec3<f32> {
    return (1.0 - barycentrics.x - barycentrics.y) * corners.a + barycentrics.x * corners.b + barycentrics.y * corners.c;
}

// Tangent space by MikkTSpace: the tangent is interpolated, and the bitangent is cross(n, t) without orthogonalization.  `n` is the
// interpolated normal, and `stored` the place of the triangle (`stored_triangle`).
fn tangent_frame(m: mat3x4<f32>, mirrored: bool, stored: u32, barycentrics: vec2<f32>, n: vec3<f32>) -> TangentFrame {
    let corners = corner_tangents(stored);
    let t = safe_normalize(transform_vector(m, interpolated(corners.tangents, barycentrics)));
    let handedness = select(1.0, -1.0, corners.flipped != mirrored);
    return TangentFrame(n, t, handedness * cross(n, t));
}

#ifdef NORMAL_MAPS
fn mapped_normal(mapped: vec3<f32>, m: mat3x4<f32>, mirrored: bool, stored: u32, barycentrics: vec2<f32>, n: vec3<f32>) -> vec3<f32> {
    if all(mapped == vec3<f32>(0.0, 0.0, 1.0)) {
        return n;
    }
    let frame = tangent_frame(m, mirrored, stored, barycentrics, n);
    return safe_normalize(mapped.x * frame.tangent + mapped.y * frame.bitangent + mapped.z * n);
}
#else
fn mapped_normal(mapped: vec3<f32>, m: mat3x4<f32>, mirrored: bool, stored: u32, barycentrics: vec2<f32>, n: vec3<f32>) -> vec3<f32> {
    return n;
}
#endif

// Normal of the coat: the interpolated normal, unless the coat has a normal map of its own.
#ifdef LAYER_TEXTURES
fn mapped_coat_normal(mapped: vec3<f32>, frame: TangentFrame) -> vec3<f32> {
    if all(mapped == vec3<f32>(0.0, 0.0, 1.0)) {
        return frame.normal;
    }
    return safe_normalize(mapped.x * frame.tangent + mapped.y * frame.bitangent + mapped.z * frame.normal);
}
#else
fn mapped_coat_normal(mapped: vec3<f32>, frame: TangentFrame) -> vec3<f32> {
    return frame.normal;
}
#endif

// Interpolated vertex normal, flipped to the side of the geometric normal.  `stored`: the place of the triangle (`stored_triangle`).
fn interpolated_normal(stored: u32, barycentrics: vec2<f32>, m: mat3x4<f32>, mirrored: bool, n_geo: vec3<f32>) -> vec3<f32> {
    let n = safe_normalize(transform_normal(m, interpolated(corner_normals(stored), barycentrics), mirrored));
    return select(n, -n, dot(n, n_geo) < 0.0);
}

// The geometric part of a surface, without its material.
struct Shape {
    position: vec3<f32>,
    n: vec3<f32>,             // without a normal map
    n_geo: vec3<f32>,
    material: u32,
}

// The surface as seen from `viewer`, now or (`previous`) in the last frame.
fn shape_at(instance: u32, triangle: u32, barycentrics: vec2<f32>, viewer: vec3<f32>, previous: bool) -> Shape {
    let t = world_triangle(instance, triangle, previous);
    let mirrored = is_mirrored(instance);
    let stored = stored_triangle(instance, triangle, previous);
    let n = interpolated_normal(stored, barycentrics, instance_transform(instance, previous), mirrored, t.normal);
    let side = select(-1.0, 1.0, dot(viewer - t.corner, t.normal) > 0.0);
    return Shape(surface_point(instance, triangle, barycentrics, previous), n * side, t.normal * side, instances[instance].material);
}

// `cone`: footprint of the pixel.  `previous`: as the surface was in the last frame.
fn surface_at(instance: u32, triangle: u32, barycentrics: vec2<f32>, wo: vec3<f32>, cone: Cone, previous: bool) -> Surface {
    let t = world_triangle(instance, triangle, previous);
    let m = instance_transform(instance, previous);
    let mirrored = is_mirrored(instance);
    let material = instances[instance].material;
    let flags = materials[material].flags;
    let point = material_at(instance, triangle, barycentrics, t, wo, cone);

    let stored = stored_triangle(instance, triangle, previous);
    let smooth_n = interpolated_normal(stored, barycentrics, m, mirrored, t.normal);
    let n = mapped_normal(point.normal, m, mirrored, stored, barycentrics, smooth_n);

    // Normals are flipped to wo's side.
    let front = dot(wo, t.normal) > 0.0;
    let side = select(-1.0, 1.0, front);
    let ior = materials[material].ior;
    let alpha = max(point.perceptual_roughness * point.perceptual_roughness, ALPHA_MIN);

    var s: Surface;
    s.position = surface_point(instance, triangle, barycentrics, previous);
    s.offset = offset_distance(instance, triangle, barycentrics, t.normal, previous);
    s.front = u32(front);
    s.material = material;
    s.attenuation = materials[material].attenuation;
    s.light = NONE;
    if instances[instance].first_light != NONE {
        s.light = instances[instance].first_light + triangle - instances[instance].first_triangle;
    }
    let emits = (flags & MATERIAL_UNLIT) == 0u && (front || (flags & MATERIAL_DOUBLE_SIDED) != 0u);
    s.emission = guarded_3(select(vec3<f32>(0.0), point.emission, emits), GUARD_SURFACE);
    // The emission of an unlit material is the radiance of base color 1.
    let unlit = point.base_color * point.emission;
    s.unlit = guarded_3(select(vec3<f32>(0.0), unlit, (flags & MATERIAL_UNLIT) != 0u), GUARD_SURFACE);
    s.bsdf.n = n * side;
    s.bsdf.n_geo = t.normal * side;
    s.bsdf.base_color = point.base_color;
    s.bsdf.metallic = point.metallic;
    s.bsdf.dielectric_reflectance = point.dielectric_reflectance;
    s.bsdf.roughness = alpha;
    s.bsdf.transmission = point.specular_transmission;
    s.bsdf.eta = select(1.0 / ior, ior, front);
    s.bsdf.compensation = multiple_scattering(alpha, dot(wo, s.bsdf.n));
    let frame = tangent_frame(m, mirrored, stored, barycentrics, smooth_n);
    let coat_normal = side * mapped_coat_normal(point.coat_normal, frame);
    s.bsdf = with_lobes(s.bsdf, point, frame, coat_normal, wo);
    let below = subsurface_at(instance, point.base_color, front, cone.width, s.offset);
    s.bsdf.subsurface = below.weight;
    s.radius = below.radius;
    s.instance = instance;
    s.smooth_n = smooth_n * side;
    if (flags & MATERIAL_UNLIT) != 0u {
        // An unlit material reflects no light.
        s.bsdf = black(s.bsdf);
    }
    if !guard_holds(is_finite_3(s.position) && is_finite_3(s.bsdf.n) && is_finite_3(s.bsdf.n_geo), GUARD_SURFACE) {
        s.emission = vec3<f32>(0.0);
        s.unlit = vec3<f32>(0.0);
        s.bsdf = black(s.bsdf);
    }
    return s;
}

// A base that reflects and transmits nothing; the coat stays.
fn black(bsdf: Bsdf) -> Bsdf {
    var b = bsdf;
    b.base_color = vec3<f32>(0.0);
    b.dielectric_reflectance = vec3<f32>(0.0);
    b.transmission = 0.0;
    return b;
}
