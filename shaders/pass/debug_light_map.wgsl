// Debug view of the light map: the number of entries in the list of each pixel.

#import bevy_restir::restir::bdpt::light_counts::splats_landed_in
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index

@group(2) @binding(3) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_light_map(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel_index(pixel);
    radiance[index] = vec4<f32>(vec3<f32>(f32(splats_landed_in(index))), 1.0);
}
