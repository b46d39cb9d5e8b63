// Traces between two points of a surface: with both offset to the side of the other, nothing may be in between.  A ray
// that leaves in `direction` must not hit the triangle that it leaves.
#import bevy_restir::scene::bindings::instances
#import bevy_restir::scene::offset::{surface_point, offset_distance, offset_point}
#import bevy_restir::common::ray::Ray
#import bevy_restir::trace::trace::{trace_closest, trace_any}
#import bevy_restir::scene::triangle::{corners_of, triangle_normal}

struct Pair {
    instance: u32,
    triangle: u32,
    other_instance: u32,
    other_triangle: u32,
    barycentrics: vec2<f32>,
    other_barycentrics: vec2<f32>,
    direction: vec3<f32>,
    factor: f32,
}

struct Answer {
    hit_itself: u32,
    blocked: u32,
    distance: f32,
    pad: u32,
}

@group(1) @binding(0) var<storage, read> pairs: array<Pair>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

fn normal_of(instance: u32, triangle: u32) -> vec3<f32> {
    let m = instances[instance].object_from_world;
    let corners = corners_of(triangle);
    let n = normalize(triangle_normal(corners.a, corners.b, corners.c));
    return normalize(mat3x3<f32>(m[0].xyz, m[1].xyz, m[2].xyz) * n);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&pairs) {
        return;
    }
    let pair = pairs[id.x];
    let p = surface_point(pair.instance, pair.triangle, pair.barycentrics, false);
    let q = surface_point(pair.other_instance, pair.other_triangle, pair.other_barycentrics, false);
    let n_p = normal_of(pair.instance, pair.triangle);
    let n_q = normal_of(pair.other_instance, pair.other_triangle);
    let d_p = pair.factor * offset_distance(pair.instance, pair.triangle, pair.barycentrics, n_p, false);
    let d_q = pair.factor * offset_distance(pair.other_instance, pair.other_triangle, pair.other_barycentrics, n_q, false);

    let start = offset_point(p, n_p, pair.direction, d_p);
    let hit = trace_closest(Ray(start, 0.0, pair.direction, 3.0e38), 0u);
    let hit_itself = hit.instance == pair.instance && hit.triangle == pair.triangle;

    // The ray is inside of a convex body; normals point outward.
    let a = offset_point(p, n_p, -n_p, d_p);
    let b = offset_point(q, n_q, -n_q, d_q);
    let blocked = trace_any(Ray(a, 0.0, b - a, 1.0), 0u, false);
    answers[id.x] = Answer(u32(hit_itself), u32(blocked), d_p, 0u);
}
