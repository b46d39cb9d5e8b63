// The factor from solid angle at one point to area at another.
#import bevy_restir::restir::shift::reconnection::geometry_factor

struct Pair {
    from_point: vec3<f32>,
    to_point: vec3<f32>,
    normal: vec3<f32>,
}

@group(0) @binding(0) var<storage, read> pairs: array<Pair>;
@group(0) @binding(1) var<storage, read_write> factors: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&pairs) {
        factors[id.x] = geometry_factor(pairs[id.x].from_point, pairs[id.x].to_point, pairs[id.x].normal);
    }
}
