// Adds up the rays and guards of all pixels, and clears them for the next frame.  It runs where rays are counted, and in debug views.
// COUNT_LIGHT_PATHS: it also counts light vertices, and light vertices that the camera sees.

#ifdef COUNT_LIGHT_PATHS
#import bevy_restir::restir::bdpt::light_counts::{splats_landed_in, vertices_traced_by}
#import bevy_restir::view::pixel::pixel_index
#endif
#import bevy_restir::view::bindings::{counts, LAYER_GUARDS, LAYER_RAYS, view}
#import bevy_restir::view::counter_bindings::counters
#import bevy_restir::view::guard_counter::sum_guards

// Rays, light vertices, splats.
var<workgroup> group_counts: array<atomic<u32>, 3>;

@compute @workgroup_size(8, 8)
fn statistics(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local < 3u {
        atomicStore(&group_counts[local], 0u);
    }
    workgroupBarrier();
    if all(id.xy < view.size) {
        atomicAdd(&group_counts[0], textureLoad(counts, id.xy, LAYER_RAYS).x);
        textureStore(counts, id.xy, LAYER_RAYS, vec4<u32>(0u));
        sum_guards(id.xy, textureLoad(counts, id.xy, LAYER_GUARDS).x);
        count_light_paths(id.xy);
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&counters.rays, atomicLoad(&group_counts[0]));
        add_light_paths();
    }
}

#ifdef COUNT_LIGHT_PATHS
fn count_light_paths(pixel: vec2<u32>) {
    let index = pixel_index(pixel);
    atomicAdd(&group_counts[1], vertices_traced_by(index).y);
    atomicAdd(&group_counts[2], splats_landed_in(index));
}

fn add_light_paths() {
    atomicAdd(&counters.light_vertices, atomicLoad(&group_counts[1]));
    atomicAdd(&counters.splats, atomicLoad(&group_counts[2]));
}
#else
fn count_light_paths(pixel: vec2<u32>) {
}

fn add_light_paths() {
}
#endif
