// Partners of pixels.
#import bevy_restir::restir::pairing::{pair_key, partner_of}

struct Case {
    pixel: vec2<u32>,
    tile_bits: u32,
    frame: u32,
    stream: u32,
    slot: u32,
}

@group(0) @binding(0) var<storage, read> cases: array<Case>;
@group(0) @binding(1) var<storage, read_write> partners: array<vec2<u32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < arrayLength(&cases) {
        let c = cases[id.x];
        partners[id.x] = partner_of(c.pixel, c.tile_bits, pair_key(c.frame, c.stream, c.slot));
    }
}
