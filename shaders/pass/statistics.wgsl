// Adds up the ray counts and errors of all pixels, and clears them for the next frame.

#import bevy_restir::common::constants::NON_FINITE
#import bevy_restir::view::bindings::{ray_counts, view}

struct Counters {
    rays: atomic<u32>,
    non_finite_pixels: atomic<u32>,
    overflow_flags: atomic<u32>,
    pad: u32,
}

@group(2) @binding(0) var<storage, read_write> counters: Counters;

var<workgroup> group_rays: atomic<u32>;
var<workgroup> group_non_finite: atomic<u32>;
var<workgroup> group_flags: atomic<u32>;

@compute @workgroup_size(8, 8)
fn statistics(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    if local == 0u {
        atomicStore(&group_rays, 0u);
        atomicStore(&group_non_finite, 0u);
        atomicStore(&group_flags, 0u);
    }
    workgroupBarrier();
    if all(id.xy < view.size) {
        let word = textureLoad(ray_counts, id.xy).x;
        textureStore(ray_counts, id.xy, vec4<u32>(0u));
        let flags = word >> 24u;
        atomicAdd(&group_rays, word & 0xffffffu);
        if (flags & NON_FINITE) != 0u {
            atomicAdd(&group_non_finite, 1u);
        }
        if (flags & ~NON_FINITE) != 0u {
            atomicOr(&group_flags, flags & ~NON_FINITE);
        }
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&counters.rays, atomicLoad(&group_rays));
        atomicAdd(&counters.non_finite_pixels, atomicLoad(&group_non_finite));
        atomicOr(&counters.overflow_flags, atomicLoad(&group_flags));
    }
}
