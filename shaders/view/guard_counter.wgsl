// Counts the pixels that have raised guards, over the whole run of the view.
#define_import_path bevy_restir::view::guard_counter

#import bevy_restir::common::constants::{NON_FINITE, OVERFLOW_PROBE, OVERFLOW_STACK, OVERFLOW_STEPS}
#import bevy_restir::common::guard::raised_guards
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::view::bindings::{counts, LAYER_GUARDS}
#import bevy_restir::view::counter_bindings::counters
#import bevy_restir::view::ray_counter::count_guards

// A counter of the run stops near this number instead of returning to 0.
const SATURATED: u32 = 0x80000000u;

// For the pass that writes the light of a pixel.  Where rays are counted, `pass/statistics.wgsl` follows and counts guards, too; otherwise
// this pass is the last one of the pixel.
#ifdef COUNT_RAYS
fn end_pixel(pixel: vec2<u32>) {
    count_guards(pixel);
}
#else
fn end_pixel(pixel: vec2<u32>) {
    sum_guards(pixel, textureLoad(counts, pixel, LAYER_GUARDS).x | trace_flags | raised_guards);
}
#endif

// Counts all guards of a pixel, and clears them for the next frame.  Almost no pixel raises one, so that the atomics cost nothing.
fn sum_guards(pixel: vec2<u32>, raised: u32) {
    if raised == 0u {
        return;
    }
    textureStore(counts, pixel, LAYER_GUARDS, vec4<u32>(0u));
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
