// Traces every ray to its closest hit and, over the same interval, to any hit; with PREVIOUS in the previous frame.
#import bevy_restir::common::ray::{Ray, rays_traced, trace_flags}
#import bevy_restir::trace::trace::{trace_closest_in_frame, trace_any}

struct Answer {
    t: f32,
    instance: u32,
    triangle: u32,
    any: u32,
    barycentrics: vec2<f32>,
    flags: u32,
    rays: u32,
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
    let ray = rays[id.x];
    let hit = trace_closest_in_frame(ray, 7u, IN_THE_PAST);
    let any = trace_any(ray, 7u, IN_THE_PAST);
    answers[id.x] = Answer(hit.t, hit.instance, hit.triangle, u32(any), hit.barycentrics, trace_flags, rays_traced);
}
