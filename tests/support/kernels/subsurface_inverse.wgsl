// Draws a probe about a point of instance 0, inverts its first hit, and traces the probe that results.
#import bevy_restir::common::rng::{rng_1, rng_3, rng_of_key}
#import bevy_restir::scene::offset::surface_point
#import bevy_restir::scene::triangle::world_triangle
#import bevy_restir::subsurface::probe::{draw_probe, inverse_probe, probe_frame, probe_ray}
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
    found: vec3<f32>,          // the hit that is inverted
    technique: u32,            // axis + 3 · channel of the inverse
    normal: vec3<f32>,
    count: u32,                // 0: no hit
    again: vec3<f32>,          // the hit of the inverse on the same triangle
    is_again: u32,
}

@group(1) @binding(0) var<storage, read> queries: array<Query>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&queries) {
        return;
    }
    let q = queries[id.x];
    var rng = rng_of_key(q.index, q.seed, 79u, 0u);
    let frame = probe_frame(q.normal);
    let line = probe_ray(draw_probe(q.radius, rng_3(&rng)), q.position, frame, q.radius);
    var answer: Answer;
    if line.valid {
        let hits = trace_probe(line.ray, 0u, 7u, false);
        answer.count = hits.count;
        if hits.count > 0u {
            let hit = probe_hit(line.ray, 0u, probe_triangle(hits, 0u), probe_distance(hits, 0u), false);
            answer.found = surface_point(0u, hit.triangle, hit.barycentrics, false);
            answer.normal = world_triangle(0u, hit.triangle, false).normal;
            let probe = inverse_probe(answer.found - q.position, answer.normal, frame, q.radius, rng_1(&rng));
            answer.technique = probe.axis + 3u * probe.channel;
            let back = probe_ray(probe, q.position, frame, q.radius);
            let hits_again = trace_probe(back.ray, 0u, 7u, false);
            for (var i = 0u; i < hits_again.count; i += 1u) {
                if back.valid && probe_triangle(hits_again, i) == hit.triangle {
                    let same = probe_hit(back.ray, 0u, hit.triangle, probe_distance(hits_again, i), false);
                    answer.again = surface_point(0u, hit.triangle, same.barycentrics, false);
                    answer.is_again = 1u;
                }
            }
        }
    }
    answers[id.x] = answer;
}
