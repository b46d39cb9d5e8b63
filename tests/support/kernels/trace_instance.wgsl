// All hits of every ray on instance 0.
#import bevy_restir::common::ray::{Ray, rays_traced, trace_flags}
#import bevy_restir::trace::probe_hits::{PROBE_HITS_MAX, probe_distance, probe_triangle}
#import bevy_restir::trace::trace::trace_probe

struct Answer {
    count: u32,
    flags: u32,
    rays: u32,
    pad: u32,
    distances: array<f32, 8>,
    triangles: array<u32, 8>,
}

@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<storage, read_write> answers: array<Answer>;

#ifdef PREVIOUS
const IN_THE_PAST: bool = true;
#else
const IN_THE_PAST: bool = false;
#endif

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&rays) {
        return;
    }
    let hits = trace_probe(rays[id.x], 0u, 7u, IN_THE_PAST);
    var answer: Answer;
    answer.count = hits.count;
    answer.flags = trace_flags;
    answer.rays = rays_traced;
    for (var i = 0u; i < min(hits.count, PROBE_HITS_MAX); i += 1u) {
        answer.distances[i] = probe_distance(hits, i);
        answer.triangles[i] = probe_triangle(hits, i);
    }
    answers[id.x] = answer;
}
