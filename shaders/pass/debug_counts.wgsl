// Debug views of the counts of this frame, for each pixel: the number of rays, summed up while frames are accumulated, or, with
// SHOWS_GUARDS, a color for the set of guards that were raised.

#import bevy_restir::view::bindings::{counts, LAYER_GUARDS, LAYER_RAYS, view}
#import bevy_restir::view::false_color::false_color
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::pixel_light::add_to_sum

@group(2) @binding(0) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_counts(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel_index(pixel);
    radiance[index] = shown(pixel, radiance[index]);
}

// `sum`: the value of the buffer so far.
#ifdef SHOWS_GUARDS
// The buffer holds light, because the pass that writes it may raise guards, too.
fn shown(pixel: vec2<u32>, sum: vec4<f32>) -> vec4<f32> {
    let raised = textureLoad(counts, pixel, LAYER_GUARDS).x;
    return vec4<f32>(select(vec3<f32>(0.0), false_color(vec2<u32>(raised, 0u)), raised != 0u), 1.0);
}
#else
fn shown(pixel: vec2<u32>, sum: vec4<f32>) -> vec4<f32> {
    let before = select(vec4<f32>(0.0), sum, view.accumulated > 0u);
    return add_to_sum(before, vec3<f32>(f32(textureLoad(counts, pixel, LAYER_RAYS).x)));
}
#endif
