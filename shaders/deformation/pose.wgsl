// Vertices of a body in its present pose: morph targets first, then the skin, as in glTF and in Bevy.
#define_import_path bevy_restir::deformation::pose

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::deformation::bindings::{attributes, poses, rigs, triangles}
#import bevy_restir::deformation::types::{Body, BODY_APPEARED, BODY_FLAT}
#import bevy_restir::scene::triangle::{safe_normalize, transform_normal, transform_point, transform_vector}
#import bevy_restir::scene::types::Triangle

// Words of a vertex in the table of influences (four joints of 16 bits, four weights), and of a displacement (position, normal, tangent).
const INFLUENCE_WORDS: u32 = 6u;
const DISPLACEMENT_WORDS: u32 = 9u;

struct Vertex {
    position: vec3<f32>,
    normal: vec3<f32>,
    tangent: vec3<f32>,
    flipped: bool,             // the bitangent is -cross(normal, tangent)
}

fn displacement(word: u32) -> vec3<f32> {
    return vec3<f32>(bitcast<f32>(rigs[word]), bitcast<f32>(rigs[word + 1u]), bitcast<f32>(rigs[word + 2u]));
}

fn morphed(body: Body, vertex: u32, at_rest: Vertex) -> Vertex {
    var v = at_rest;
    for (var i = 0u; i < body.weight_count; i += 1u) {
        let active_target = poses[body.weights + i];
        let first = body.targets + (u32(active_target.y) * body.vertex_count + vertex) * DISPLACEMENT_WORDS;
        v.position += active_target.x * displacement(first);
        v.normal += active_target.x * displacement(first + 3u);
        v.tangent += active_target.x * displacement(first + 6u);
    }
    return v;
}

// The weighted mean of the transforms of a vertex's joints.
fn skin_transform(body: Body, vertex: u32) -> mat3x4<f32> {
    let first = body.influences + vertex * INFLUENCE_WORDS;
    var m = mat3x4<f32>(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0));
    for (var i = 0u; i < 4u; i += 1u) {
        let weight = bitcast<f32>(rigs[first + 2u + i]);
        if weight > 0.0 {
            let joint = min((rigs[first + i / 2u] >> (16u * (i % 2u))) & 0xffffu, body.joint_count - 1u);
            let row = body.joints + 3u * joint;
            m += mat3x4<f32>(weight * poses[row], weight * poses[row + 1u], weight * poses[row + 2u]);
        }
    }
    return m;
}

fn posed(body: Body, vertex: u32, at_rest: Vertex) -> Vertex {
    var v = morphed(body, vertex, at_rest);
    if body.influences != NONE {
        let m = skin_transform(body, vertex);
        let mirrors = dot(m[0].xyz, cross(m[1].xyz, m[2].xyz)) < 0.0;
        v.position = transform_point(m, v.position);
        v.normal = transform_normal(m, v.normal, mirrors);
        v.tangent = transform_vector(m, v.tangent);
        v.flipped = v.flipped != mirrors;
    }
    return v;
}

// The tangent, made perpendicular to n and normalized; an arbitrary perpendicular unit vector if the two are parallel.
fn perpendicular(tangent: vec3<f32>, n: vec3<f32>) -> vec3<f32> {
    let t = safe_normalize(tangent);
    let across = t - dot(t, n) * n;
    if dot(across, across) > 1.0e-8 {
        return normalize(across);
    }
    return normalize(cross(n, select(vec3<f32>(0.0, 1.0, 0.0), vec3<f32>(1.0, 0.0, 0.0), abs(n.x) < 0.6)));
}

fn packed_tangent(v: Vertex) -> u32 {
    return (octahedral_encode(perpendicular(v.tangent, v.normal)) & ~1u) | u32(v.flipped);
}

fn vertex_at_rest(position: vec3<f32>, normal: u32, tangent: u32) -> Vertex {
    return Vertex(position, octahedral_decode(normal), octahedral_decode(tangent), (tangent & 1u) != 0u);
}

// Writes a triangle in the pose of this frame, and moves that of the last frame behind it.
fn pose_triangle(body: Body, index: u32) {
    let rest = triangles[body.rest_triangle + index];
    var packed = attributes[body.rest_triangle + index];
    let corners = body.corners + 3u * index;
    var a = posed(body, rigs[corners], vertex_at_rest(rest.a, packed.normals.x, packed.tangent_a));
    var b = posed(body, rigs[corners + 1u], vertex_at_rest(rest.b, packed.normals.y, packed.tangent_b));
    var c = posed(body, rigs[corners + 2u], vertex_at_rest(rest.c, packed.normals.z, packed.tangent_c));
    if (body.flags & BODY_FLAT) != 0u {
        a.normal = cross(b.position - a.position, c.position - a.position);
        b.normal = a.normal;
        c.normal = a.normal;
    }
    a.normal = safe_normalize(a.normal);
    b.normal = safe_normalize(b.normal);
    c.normal = safe_normalize(c.normal);
    packed.normals = vec3<u32>(octahedral_encode(a.normal), octahedral_encode(b.normal), octahedral_encode(c.normal));
    packed.tangent_a = packed_tangent(a);
    packed.tangent_b = packed_tangent(b);
    packed.tangent_c = packed_tangent(c);
    let triangle = Triangle(a.position, 0u, b.position, 0u, c.position, 0u);

    let now = body.triangle + index;
    let before = now + body.triangle_count;
    if (body.flags & BODY_APPEARED) != 0u {
        triangles[before] = triangle;
        attributes[before] = packed;
    } else {
        triangles[before] = triangles[now];
        attributes[before] = attributes[now];
    }
    triangles[now] = triangle;
    attributes[now] = packed;
}
