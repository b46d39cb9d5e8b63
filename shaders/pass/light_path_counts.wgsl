// Counts light vertices, and light vertices that the camera sees.  It runs where rays are counted.

#import bevy_restir::restir::bdpt::light_counts::{splats_landed_in, vertices_traced_by}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::counter_bindings::counters
#import bevy_restir::view::pixel::pixel_index

var<workgroup> group_vertices: atomic<u32>;
var<workgroup> group_splats: atomic<u32>;

@compute @workgroup_size(8, 8)
fn light_path_counts(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&group_vertices, 0u);
        atomicStore(&group_splats, 0u);
    }
    workgroupBarrier();
    if all(id.xy < view.size) {
        let pixel = pixel_index(id.xy);
        atomicAdd(&group_vertices, vertices_traced_by(pixel).y);
        atomicAdd(&group_splats, splats_landed_in(pixel));
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&counters.light_vertices, atomicLoad(&group_vertices));
        atomicAdd(&counters.splats, atomicLoad(&group_splats));
    }
}
