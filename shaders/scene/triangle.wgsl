// A triangle in the world: what lights and surfaces need of (instance, triangle, barycentrics).
#define_import_path bevy_restir::scene::triangle

#import bevy_restir::scene::bindings::{instances, triangles, attributes}

struct WorldTriangle {
    v0: vec3<f32>,
    edge_1: vec3<f32>,         // v1 - v0
    edge_2: vec3<f32>,
    normal: vec3<f32>,         // unit, out of the front face
    area: f32,
}

fn transform_point(m: mat3x4<f32>, p: vec3<f32>) -> vec3<f32> {
    return vec4<f32>(p, 1.0) * m;
}

fn transform_vector(m: mat3x4<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec4<f32>(v, 0.0) * m;
}

// Normals go by the inverse transposed: `object_from_world` read the other way.
fn transform_normal(object_from_world: mat3x4<f32>, n: vec3<f32>) -> vec3<f32> {
    return (object_from_world * n).xyz;
}

// Scales a vector by a power of two near its size before normalising, so that 1e-30 and 1e30 do not under- or overflow.
fn safe_normalize(v: vec3<f32>) -> vec3<f32> {
    let m = max(max(abs(v.x), abs(v.y)), abs(v.z));
    if !(m > 0.0) {
        return vec3<f32>(0.0, 0.0, 1.0);
    }
    return normalize(v / m);
}

// The front face of a mirrored instance is the image of the object's: its normal goes by the inverse transposed, not by winding.
fn world_triangle(instance: u32, triangle: u32) -> WorldTriangle {
    let t = triangles[triangle];
    let m = instances[instance].world_from_object;
    let edge_1 = transform_vector(m, t.v1 - t.v0);
    let edge_2 = transform_vector(m, t.v2 - t.v0);
    let c = cross(edge_1, edge_2);
    let mirrored = (instances[instance].flags & 1u) != 0u;
    return WorldTriangle(
        transform_point(m, t.v0),
        edge_1,
        edge_2,
        select(1.0, -1.0, mirrored) * safe_normalize(c),
        0.5 * length(c),
    );
}

fn triangle_point(t: WorldTriangle, barycentrics: vec2<f32>) -> vec3<f32> {
    return t.v0 + barycentrics.x * t.edge_1 + barycentrics.y * t.edge_2;
}

fn triangle_uv(triangle: u32, barycentrics: vec2<f32>) -> vec2<f32> {
    let a = attributes[triangle];
    return (1.0 - barycentrics.x - barycentrics.y) * a.uv_0 + barycentrics.x * a.uv_1 + barycentrics.y * a.uv_2;
}
