// Closest hits and nothing else, to be timed.
#import bevy_restir::trace::ray::Ray
#import bevy_restir::trace::software::trace_closest

@group(1) @binding(0) var<storage, read> rays: array<Ray>;
@group(1) @binding(1) var<storage, read_write> distances: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&rays) {
        distances[id.x] = trace_closest(rays[id.x], 0u).t;
    }
}
