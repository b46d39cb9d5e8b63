// Vertices of a body in its present pose: morph targets first, then the skin, as in glTF and in Bevy.
#define_import_path bevy_restir::deformation::pose

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::{octahedral_decode, octahedral_encode}
#import bevy_restir::deformation::bindings::{poses, rigs, triangles, vertices}
#import bevy_restir::deformation::types::{Body, BODY_APPEARED}
#import bevy_restir::scene::corners::perpendicular
#import bevy_restir::scene::triangle::{safe_normalize, transform_normal, transform_point, transform_vector}
#import bevy_restir::scene::types::{NOT_GIVEN, Triangle, Vertex}

// Words of a vertex in the table of influences (four joints of 16 bits, four weights), and of a displacement (position, normal, tangent).
const INFLUENCE_WORDS: u32 = 6u;
const DISPLACEMENT_WORDS: u32 = 9u;

struct PosedVertex {
    position: vec3<f32>,
    normal: vec3<f32>,
    tangent: vec3<f32>,
    flipped: bool,             // the bitangent is -cross(normal, tangent)
}

fn displacement(word: u32) -> vec3<f32> {
    return vec3<f32>(bitcast<f32>(rigs[word]), bitcast<f32>(rigs[word + 1u]), bitcast<f32>(rigs[word + 2u]));
}

fn morphed(body: Body, vertex: u32, rest: PosedVertex) -> PosedVertex {
    var v = rest;
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

fn posed(body: Body, vertex: u32, rest: PosedVertex) -> PosedVertex {
    var v = morphed(body, vertex, rest);
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

fn at_rest(stored: Vertex) -> PosedVertex {
    let is_flipped = (stored.tangent & 1u) != 0u;
    return PosedVertex(stored.position, octahedral_decode(stored.normal), octahedral_decode(stored.tangent), is_flipped);
}

// Writes a vertex in the pose of this frame, and moves that of the last frame behind it.  A normal or a tangent that the mesh does not have
// is made from the posed triangle where a ray hits it.
fn pose_vertex(body: Body, index: u32) {
    var stored = vertices[body.rest_vertex + index];
    var v = posed(body, index, at_rest(stored));
    v.normal = safe_normalize(v.normal);
    stored.position = v.position;
    if stored.normal != NOT_GIVEN {
        stored.normal = octahedral_encode(v.normal);
    }
    if stored.tangent != NOT_GIVEN {
        stored.tangent = (octahedral_encode(perpendicular(v.tangent, v.normal)) & ~1u) | u32(v.flipped);
    }
    let now = body.vertex + index;
    let before = now + body.vertex_count;
    if (body.flags & BODY_APPEARED) != 0u {
        vertices[before] = stored;
    } else {
        vertices[before] = vertices[now];
    }
    vertices[now] = stored;
}

// Writes a triangle of a new body, with the vertices of this frame and with those of the last one.
fn add_triangle(body: Body, index: u32) {
    let rest = triangles[body.rest_triangle + index];
    let now = body.triangle + index;
    let shift = body.vertex - body.rest_vertex;
    let previous_shift = shift + body.vertex_count;
    triangles[now] = Triangle(rest.a + shift, rest.b + shift, rest.c + shift);
    triangles[now + body.triangle_count] = Triangle(rest.a + previous_shift, rest.b + previous_shift, rest.c + previous_shift);
}
