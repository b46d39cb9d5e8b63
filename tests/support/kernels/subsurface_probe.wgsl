// Draws a probe for every seed about a point of instance 0, and gives its technique and its hits with their densities.
#import bevy_restir::common::rng::{rng_3, rng_of_key}
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::subsurface::probe::{draw_probe, probe_frame, probe_pdf, probe_ray}
#import bevy_restir::trace::probe_hits::{probe_distance, probe_triangle}
#import bevy_restir::trace::trace::{probe_hit, trace_probe}

struct Query {
    position: vec3<f32>,
    seed: u32,
    normal: vec3<f32>,
    index: u32,
    radius: vec3<f32>,
    pad: u32,
}

struct Answer {
    axis: u32,
    channel: u32,
    flags: u32,
    count: u32,
    triangles: array<u32, 8>,
    hits: array<vec4<f32>, 8>,    // position and density
}

@group(1) @binding(0) var<storage, read> queries: array<Query>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&queries) {
        return;
    }
    let q = queries[id.x];
    var rng = rng_of_key(q.index, q.seed, 78u, 0u);
    let probe = draw_probe(q.radius, rng_3(&rng));
    let frame = probe_frame(q.normal);
    let line = probe_ray(probe, q.position, frame, q.radius);
    var answer: Answer;
    answer.axis = probe.axis;
    answer.channel = probe.channel;
    if line.valid {
        let hits = trace_probe(line.ray, 0u, 7u, false);
        answer.count = hits.count;
        for (var i = 0u; i < hits.count; i += 1u) {
            let hit = probe_hit(line.ray, 0u, probe_triangle(hits, i), probe_distance(hits, i), false);
            let point = surface_point(0u, hit.triangle, hit.barycentrics, false);
            let pdf = probe_pdf(point - q.position, world_triangle(0u, hit.triangle, false).normal, frame, q.radius);
            answer.triangles[i] = hit.triangle;
            answer.hits[i] = vec4<f32>(point, pdf);
        }
    }
    answer.flags = trace_flags;
    answers[id.x] = answer;
}
