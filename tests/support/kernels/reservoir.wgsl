// Unpacks reservoirs of direct light and packs them again.
#import bevy_restir::restir::di::reservoir::{PackedReservoir, reservoir_pack, reservoir_unpack}

@group(0) @binding(0) var<storage, read> words: array<PackedReservoir>;
@group(0) @binding(1) var<storage, read_write> packed: array<PackedReservoir>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&words) {
        packed[id.x] = reservoir_pack(reservoir_unpack(words[id.x]));
    }
}
