// Choices of lights by the first random numbers behind those of the environment, with the resolution of the random numbers.
#import bevy_restir::light::select::light_select

@group(2) @binding(0) var<storage, read> first: array<u32>;
@group(2) @binding(1) var<storage, read_write> chosen: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let across = id.x % 0x100000u;
    let row = id.x / 0x100000u;
    let u = vec2<f32>((f32(across) + 0.5) * 0x1p-20, f32(first[0] + row) * 0x1p-24);
    chosen[id.x] = light_select(u).light;
}
