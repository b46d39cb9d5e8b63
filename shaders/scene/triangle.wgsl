// Triangles in world space, now and in the last frame, and transforms of points, vectors and normals.
#define_import_path bevy_restir::scene::triangle

#import bevy_restir::common::constants::{INSTANCE_APPEARED, INSTANCE_DEFORMED, INSTANCE_GONE, INSTANCE_MIRRORED}
#import bevy_restir::scene::bindings::{instances, triangles, vertices}

// A vector at each corner of a triangle: its position, its normal or its tangent, in object space.
struct Corners {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
}

struct WorldTriangle {
    corner: vec3<f32>,
    edge_b: vec3<f32>,         // b - a
    edge_c: vec3<f32>,
    normal: vec3<f32>,         // unit vector out of the front face
    area: f32,
}

fn transform_point(m: mat3x4<f32>, p: vec3<f32>) -> vec3<f32> {
    return vec4<f32>(p, 1.0) * m;
}

fn transform_vector(m: mat3x4<f32>, v: vec3<f32>) -> vec3<f32> {
    return vec4<f32>(v, 0.0) * m;
}

// Normals are transformed by the inverse transpose: here by the cofactor matrix, which differs from it by the factor of the determinant.
fn transform_normal(m: mat3x4<f32>, n: vec3<f32>, mirrored: bool) -> vec3<f32> {
    let v = vec3<f32>(
        dot(cross(m[1].xyz, m[2].xyz), n),
        dot(cross(m[2].xyz, m[0].xyz), n),
        dot(cross(m[0].xyz, m[1].xyz), n),
    );
    return select(v, -v, mirrored);
}

// Divides by the largest component before normalizing, so that lengths of 1e-30 or 1e30 do not under- or overflow.
fn safe_normalize(v: vec3<f32>) -> vec3<f32> {
    let m = max(max(abs(v.x), abs(v.y)), abs(v.z));
    if !(m > 0.0) {
        return vec3<f32>(0.0, 0.0, 1.0);
    }
    return normalize(v / m);
}

// Whether an instance is in the scene, now or (`previous`) in the last frame.
fn instance_exists(instance: u32, previous: bool) -> bool {
    return (instances[instance].flags & select(INSTANCE_GONE, INSTANCE_APPEARED, previous)) == 0u;
}

// Whether the transform of an instance mirrors it.
fn is_mirrored(instance: u32) -> bool {
    return (instances[instance].flags & INSTANCE_MIRRORED) != 0u;
}

// Transform of an instance, now or (`previous`) in the last frame.
fn instance_transform(instance: u32, previous: bool) -> mat3x4<f32> {
    if previous {
        return instances[instance].previous_world_from_object;
    }
    return instances[instance].world_from_object;
}

// Vectors of world space, multiplied from the left, become vectors of object space.
fn linear_inverse(instance: u32, previous: bool) -> mat3x3<f32> {
    if previous {
        let now = instances[instance].world_from_object;
        let world = instances[instance].previous_world_from_object;
        if all(now[0] == world[0]) && all(now[1] == world[1]) && all(now[2] == world[2]) {
            return linear_inverse_of_now(instance);
        }
        // By cofactors: the inverse of the last frame is not stored.
        let x = cross(world[1].xyz, world[2].xyz);
        let y = cross(world[2].xyz, world[0].xyz);
        let z = cross(world[0].xyz, world[1].xyz);
        let scale = 1.0 / dot(world[0].xyz, x);
        return transpose(mat3x3<f32>(x * scale, y * scale, z * scale));
    }
    return linear_inverse_of_now(instance);
}

fn linear_inverse_of_now(instance: u32) -> mat3x3<f32> {
    let object = instances[instance].object_from_world;
    return mat3x3<f32>(object[0].xyz, object[1].xyz, object[2].xyz);
}

fn vertex_position(index: u32) -> vec3<f32> {
    return vertices[index].position;
}

// Positions of the corners of a stored triangle (`stored_triangle`).
fn corners_of(stored: u32) -> Corners {
    let t = triangles[stored];
    return Corners(vertex_position(t.a), vertex_position(t.b), vertex_position(t.c));
}

// Where a triangle is stored, now or (`previous`) in the last frame.  A mesh that bends has its triangles twice: those of the
// last frame lie behind those of this one.
#ifdef DEFORMATION
fn stored_triangle(instance: u32, triangle: u32, previous: bool) -> u32 {
    let is_second = previous && (instances[instance].flags & INSTANCE_DEFORMED) != 0u;
    return triangle + select(0u, instances[instance].triangle_count, is_second);
}
#else
fn stored_triangle(instance: u32, triangle: u32, previous: bool) -> u32 {
    return triangle;
}
#endif

// The front face of a mirrored instance is the image of the front face in object space, although its winding is reversed.
fn world_triangle(instance: u32, triangle: u32, previous: bool) -> WorldTriangle {
    let t = corners_of(stored_triangle(instance, triangle, previous));
    let m = instance_transform(instance, previous);
    let edge_b = transform_vector(m, t.b - t.a);
    let edge_c = transform_vector(m, t.c - t.a);
    let c = cross(edge_b, edge_c);
    return WorldTriangle(
        transform_point(m, t.a),
        edge_b,
        edge_c,
        select(1.0, -1.0, is_mirrored(instance)) * safe_normalize(c),
        0.5 * length(c),
    );
}

// Normal, not normalized: the cross product of the two shorter edges.  For slivers, other pairs of edges lose all precision.
fn triangle_normal(v0: vec3<f32>, v1: vec3<f32>, v2: vec3<f32>) -> vec3<f32> {
    let e0 = v1 - v0;
    let e1 = v2 - v1;
    let e2 = v0 - v2;
    let l0 = dot(e0, e0);
    let l1 = dot(e1, e1);
    let l2 = dot(e2, e2);
    let skip_0 = l0 >= max(l1, l2);
    let skip_1 = !skip_0 && l1 >= l2;
    // Without e0: e1 x e2; without e1: e2 x e0; without e2: e0 x e1.
    return cross(select(select(e0, e2, skip_1), e1, skip_0), select(select(e1, e0, skip_1), e2, skip_0));
}
