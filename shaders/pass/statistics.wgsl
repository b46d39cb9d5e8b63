// Adds up the rays and guards of all pixels, and clears them for the next frame.  It runs where rays are counted, and in debug views.

#import bevy_restir::view::bindings::{counts, LAYER_GUARDS, LAYER_RAYS, view}
#import bevy_restir::view::counter_bindings::counters
#import bevy_restir::view::guard_counter::sum_guards

var<workgroup> group_rays: atomic<u32>;

@compute @workgroup_size(8, 8)
fn statistics(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&group_rays, 0u);
    }
    workgroupBarrier();
    if all(id.xy < view.size) {
        atomicAdd(&group_rays, textureLoad(counts, id.xy, LAYER_RAYS).x);
        textureStore(counts, id.xy, LAYER_RAYS, vec4<u32>(0u));
        sum_guards(id.xy, textureLoad(counts, id.xy, LAYER_GUARDS).x);
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&counters.rays, atomicLoad(&group_rays));
    }
}
