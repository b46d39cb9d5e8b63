// Copies the contribution of each pixel's own sample to the picture.  Tests run it instead of a reuse pass.

#import bevy_restir::view::bindings::view

@group(2) @binding(4) var own_contribution: texture_2d<f32>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    if all(id.xy < view.size) {
        textureStore(resampled, id.xy, textureLoad(own_contribution, id.xy, 0));
    }
}
