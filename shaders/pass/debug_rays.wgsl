// Debug view: number of rays that the passes of this frame traced for each pixel, summed up while frames are accumulated.

#import bevy_restir::view::bindings::{counts, LAYER_RAYS, view}

@group(2) @binding(0) var<storage, read_write> radiance: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn debug_rays(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel.y * view.size.x + pixel.x;
    var sum = vec4<f32>(vec3<f32>(f32(textureLoad(counts, pixel, LAYER_RAYS).x)), 1.0);
    if view.accumulated > 0u {
        sum += radiance[index];
    }
    radiance[index] = sum;
}
