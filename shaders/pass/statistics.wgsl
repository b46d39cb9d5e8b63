// Adds up the rays and guards of all pixels, and clears them for the next frame.

#import bevy_restir::common::constants::{NON_FINITE, OVERFLOW_PROBE, OVERFLOW_STACK, OVERFLOW_STEPS}
#import bevy_restir::view::bindings::{counts, LAYER_GUARDS, LAYER_RAYS, view}

struct Counters {
    // Of this frame.
    rays: atomic<u32>,
    non_finite_pixels: atomic<u32>,
    overflow_flags: atomic<u32>,
    pad: u32,
    // Of the whole run: for each bit of a guard, the sum over frames of the pixels that raised it.
    guards: array<atomic<u32>, 32>,
}

@group(2) @binding(0) var<storage, read_write> counters: Counters;

// A counter of the run stops near this number instead of returning to 0.
const SATURATED: u32 = 0x80000000u;

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
        let raised = textureLoad(counts, id.xy, LAYER_GUARDS).x;
        if raised != 0u {
            textureStore(counts, id.xy, LAYER_GUARDS, vec4<u32>(0u));
            count(raised);
        }
    }
    workgroupBarrier();
    if local == 0u {
        atomicAdd(&counters.rays, atomicLoad(&group_rays));
    }
}

// Counts the guards of a pixel.  Almost no pixel raises one, so that its atomics cost nothing.
fn count(raised: u32) {
    atomicOr(&counters.overflow_flags, raised & (OVERFLOW_STACK | OVERFLOW_STEPS | OVERFLOW_PROBE));
    if (raised & NON_FINITE) != 0u {
        atomicAdd(&counters.non_finite_pixels, 1u);
    }
    for (var bits = raised; bits != 0u; bits &= bits - 1u) {
        let bit = firstTrailingBit(bits);
        if atomicLoad(&counters.guards[bit]) < SATURATED {
            atomicAdd(&counters.guards[bit], 1u);
        }
    }
}
