// Debug view of the light map: the number of entries in the list of each pixel.

#import bevy_restir::restir::bdpt::light_map::{LINK_MASK, MAX_ENTRIES, word_of}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(0) var<storage, read> light_map: array<u32>;
@group(2) @binding(1) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_light_map(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel_index(pixel);
    var count = 0u;
    for (var next = light_map[index]; next != 0u && count < MAX_ENTRIES; count++) {
        next = light_map[word_of(next)] & LINK_MASK;
    }
    radiance[index] = vec4<f32>(vec3<f32>(f32(count)), 1.0);
}
