// Attributes of the corners of a stored triangle (`stored_triangle`): texture coordinates, and normals and tangents in object space.
#define_import_path bevy_restir::scene::corners

#import bevy_restir::common::constants::{FAR, LEAST_MAGNITUDE}
#import bevy_restir::common::math::{max_component, octahedral_decode}
#import bevy_restir::scene::bindings::{triangles, vertices}
#import bevy_restir::scene::triangle::{Corners, corners_of, safe_normalize, triangle_normal}
#import bevy_restir::scene::types::NOT_GIVEN

// Smallest area that texture coordinates span, relative to the products that it is the difference of: below it, rounding decides.
const LEAST_UV_AREA: f32 = 0x1p-22;

struct CornerUvs {
    a: vec2<f32>,
    b: vec2<f32>,
    c: vec2<f32>,
}

struct CornerTangents {
    tangents: Corners,
    flipped: bool,             // the bitangent is -cross(normal, tangent)
}

// Directions in which texture coordinates grow, not normalized; 0 if the coordinates span no area.
struct UvDirections {
    u: vec3<f32>,
    v: vec3<f32>,
}

fn vertex_uv(index: u32) -> vec2<f32> {
    return vertices[index].uv;
}

fn corner_uvs(stored: u32) -> CornerUvs {
    let t = triangles[stored];
    return CornerUvs(vertex_uv(t.a), vertex_uv(t.b), vertex_uv(t.c));
}

// Normals of the corners.  A vertex without a normal has that of the triangle's plane.
fn corner_normals(stored: u32) -> Corners {
    let t = triangles[stored];
    let words = vec3<u32>(vertices[t.a].normal, vertices[t.b].normal, vertices[t.c].normal);
    let n = Corners(octahedral_decode(words.x), octahedral_decode(words.y), octahedral_decode(words.z));
    let is_missing = words == vec3<u32>(NOT_GIVEN);
    if !any(is_missing) {
        return n;
    }
    let p = corners_of(stored);
    let plane = safe_normalize(triangle_normal(p.a, p.b, p.c));
    return Corners(select(n.a, plane, is_missing.x), select(n.b, plane, is_missing.y), select(n.c, plane, is_missing.z));
}

// Tangents of the corners.  A vertex without a tangent has that of the triangle's texture coordinates, perpendicular to its normal.
fn corner_tangents(stored: u32) -> CornerTangents {
    let t = triangles[stored];
    let words = vec3<u32>(vertices[t.a].tangent, vertices[t.b].tangent, vertices[t.c].tangent);
    let given = Corners(octahedral_decode(words.x), octahedral_decode(words.y), octahedral_decode(words.z));
    let is_flipped = (words.x & 1u) != 0u;
    let is_missing = words == vec3<u32>(NOT_GIVEN);
    if !any(is_missing) {
        return CornerTangents(given, is_flipped);
    }
    let n = corner_normals(stored);
    let along = uv_directions(corners_of(stored), corner_uvs(stored));
    // Texture coordinates without an area have no direction.  Any tangent will do: `perpendicular` makes one for the normal itself.
    let is_unmapped = all(along.u == vec3<f32>(0.0));
    let tangents = Corners(
        select(given.a, perpendicular(select(along.u, n.a, is_unmapped), n.a), is_missing.x),
        select(given.b, perpendicular(select(along.u, n.b, is_unmapped), n.b), is_missing.y),
        select(given.c, perpendicular(select(along.u, n.c, is_unmapped), n.c), is_missing.z),
    );
    // Bevy's bitangent is w cross(n, t) and points against the direction of v, because v points down in an image.
    return CornerTangents(tangents, select(is_flipped, dot(cross(n.a, along.u), along.v) > 0.0, is_missing.x));
}

// Edges and differences are divided by their largest component, so that products neither overflow nor underflow.
fn uv_directions(p: Corners, uvs: CornerUvs) -> UvDirections {
    let edge_b = p.b - p.a;
    let edge_c = p.c - p.a;
    let extent = max(max_component(max(abs(edge_b), abs(edge_c))), LEAST_MAGNITUDE);
    let uv_b = uvs.b - uvs.a;
    let uv_c = uvs.c - uvs.a;
    let uv_sizes = max(abs(uv_b), abs(uv_c));
    let uv_extent = clamp(max(uv_sizes.x, uv_sizes.y), LEAST_MAGNITUDE, FAR);
    let b = uv_b / uv_extent;
    let c = uv_c / uv_extent;
    let area = b.x * c.y - c.x * b.y;
    let spans = abs(area) > LEAST_UV_AREA * (abs(b.x * c.y) + abs(c.x * b.y));
    let side = select(0.0, sign(area), spans);
    let e = edge_b / extent;
    let f = edge_c / extent;
    return UvDirections(side * (e * c.y - f * b.y), side * (f * b.x - e * c.x));
}

// The part of a tangent perpendicular to n, normalized; an arbitrary perpendicular unit vector if the two are parallel.
fn perpendicular(tangent: vec3<f32>, n: vec3<f32>) -> vec3<f32> {
    let t = safe_normalize(tangent);
    let across = t - dot(t, n) * n;
    if dot(across, across) > 1.0e-8 {
        return normalize(across);
    }
    let other = select(vec3<f32>(0.0, 1.0, 0.0), vec3<f32>(1.0, 0.0, 0.0), abs(n.x) < 0.6);
    return normalize(cross(cross(n, other), n));
}
