// Closest hits and nothing else, to be timed; with ANY_HIT any hits.
#import bevy_restir::common::ray::Ray
#import bevy_restir::trace::trace::{trace_closest, trace_any}

@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<storage, read_write> distances: array<f32>;

#ifdef ANY_HIT
fn distance_of(ray: Ray) -> f32 {
    return select(ray.t_max, ray.t_min, trace_any(ray, 0u, false));
}
#else
fn distance_of(ray: Ray) -> f32 {
    return trace_closest(ray, 0u).t;
}
#endif

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&rays) {
        distances[id.x] = distance_of(rays[id.x]);
    }
}
