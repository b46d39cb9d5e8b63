// Packs radiance and unpacks it again.
#import bevy_restir::restir::stored_path::{pack_radiance, unpack_radiance}

@group(0) @binding(0) var<storage, read> radiance: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> kept: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&radiance) {
        kept[id.x] = vec4<f32>(unpack_radiance(pack_radiance(radiance[id.x].xyz)), 0.0);
    }
}
