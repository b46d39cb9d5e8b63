// Triangles of the mesh in the first bin, by the least random bits, with a resolution of 1/64 of the last one.
#import bevy_restir::light::select::light_of_bin
#import bevy_restir::scene::bindings::scene

@group(2) @binding(0) var<storage, read> place: array<u32>;
@group(2) @binding(1) var<storage, read_write> chosen: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    chosen[id.x] = light_of_bin(scene.first_bin, place[0], vec2<u32>(id.x / 64u, (id.x % 64u) << 18u));
}
