// Exponentially distributed times of random bits.
#import bevy_restir::restir::bdpt::light_map::exponential_time

@group(0) @binding(0) var<storage, read> bits: array<u32>;
@group(0) @binding(1) var<storage, read_write> times: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&bits) {
        times[id.x] = exponential_time(bits[id.x]);
    }
}
