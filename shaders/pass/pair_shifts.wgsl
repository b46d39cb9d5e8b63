// Shifts the sample of each partner of a pixel to the pixel, and stores the result for both of them: the pixel resamples it, and the partner
// needs it for the MIS weight of its own sample.  Without pairs every pixel would do both shifts.
//
// With DEFERS_REPLAYS, a first pass does the shifts that replay nothing.  It is compiled without replay, and puts the pixels that have
// other shifts into a queue.  A second pass, with FROM_QUEUE, does the shifts of the queue, so that threads that run together all replay
// paths (replay compaction, Lin et al. 2026; Table 1 of its supplement has the cost).

#import domain::{evaluate, is_visible, kept_shift, needs_replay, PackedReservoir, Receiver, receiver_of, receives_light, Reservoir, reservoir_unpack, target_value}
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::rng_bits
#import bevy_restir::restir::iteration_rng::iteration_rng
#import bevy_restir::restir::pairs::{next_pair, Pair, pair_in_slot, pair_mask, slots_of}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::ray_counter::{count_rays, reset_counts}

// The queue begins with the number of workgroups of the second pass in each dimension, and the number of entries.  An entry is the
// coordinates of a pixel and the mask of its slots.
const QUEUE_COUNT: u32 = 3u;
const QUEUE_HEADER: u32 = 4u;
const QUEUE_THREADS: u32 = 64u;
// Greatest number of workgroups in a dimension that every device accepts.
const MAX_WORKGROUPS: u32 = 65535u;
const COORDINATE_BITS: u32 = 16u;

// The samples that the iteration resamples.
@group(2) @binding(1) var<storage, read> samples: array<PackedReservoir>;
// A layer for each shift of a pixel, as `kept_shift` returns it; 0 where the shift is not defined or the sample is occluded.
@group(2) @binding(2) var shifts: texture_storage_2d_array<rgba32float, write>;

fn sample_in(pixel: vec2<u32>) -> Reservoir {
    return reservoir_unpack(samples[reservoir_index(pixel)]);
}

// Rays of direct light see blended surfaces by these random numbers; a path has an alpha seed of its own.
fn alpha_seed_of(pixel: vec2<u32>, pair: Pair) -> u32 {
    var rng = iteration_rng(pixel);
    return rng_bits(&rng).x + pair.slot;
}

fn store_shift(pixel: vec2<u32>, r: Receiver, pair: Pair, s: Reservoir) {
    var shift = vec4<f32>(0.0);
    if s.ucw > 0.0 {
        let e = evaluate(r, s);
        if target_value(e) > 0.0 && is_visible(r, e, alpha_seed_of(pixel, pair)) {
            shift = kept_shift(e);
        }
    }
    textureStore(shifts, pixel, pair.own_layer, shift);
}

#ifdef FROM_QUEUE
@group(2) @binding(4) var<storage, read> queue: array<u32>;

@compute @workgroup_size(QUEUE_THREADS)
fn pair_shifts(@builtin(global_invocation_id) id: vec3<u32>) {
    // `num_workgroups` is 0 in indirect dispatches of some Direct3D devices.
    let stride = queue[0u] * QUEUE_THREADS;
    // A band does as many entries as it has pixels.
    let first = view.first_pixel.y * view.size.x;
    let end = min(queue[QUEUE_COUNT], first + view.band_rows * view.size.x);
    for (var entry = first + id.x; entry < end; entry += stride) {
        let coordinates = queue[QUEUE_HEADER + 2u * entry];
        let pixel = vec2<u32>(coordinates & ((1u << COORDINATE_BITS) - 1u), coordinates >> COORDINATE_BITS);
        let r = receiver_of(textureLoad(visibility, pixel, 0).xy, pixel, false);
        let own = pair_mask(pixel);
        // An entry has at least one slot.  A thread does all shifts to a pixel, because it alone may count the rays of the pixel.
        var slots = queue[QUEUE_HEADER + 2u * entry + 1u];
        loop {
            let pair = pair_in_slot(pixel, own, firstTrailingBit(slots));
            store_shift(pixel, r, pair, sample_in(pair.partner));
            slots &= slots - 1u;
            if slots == 0u {
                break;
            }
        }
        count_rays(pixel);
        reset_counts();
    }
}
#else
@compute @workgroup_size(8, 8)
fn pair_shifts(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let pixel = id.xy + view.first_pixel;
    var deferred = 0u;
    if all(pixel < view.size) {
        let ids = textureLoad(visibility, pixel, 0).xy;
        if receives_light(ids) && view.bounces > 0u {
            deferred = shift_partners(pixel, receiver_of(ids, pixel, false));
            count_rays(pixel);
        }
    }
    enqueue(pixel, deferred, thread);
}

// Returns the slots whose samples are left to the queue.
fn shift_partners(pixel: vec2<u32>, r: Receiver) -> u32 {
    var deferred = 0u;
    let own = pair_mask(pixel);
    var slots = slots_of(own);
    var pair = next_pair(pixel, own, &slots);
    if pair.partner.x == NONE {
        return deferred;
    }
    loop {
        let s = sample_in(pair.partner);
        if is_deferred(r, s) {
            deferred |= 1u << pair.slot;
        } else {
            store_shift(pixel, r, pair, s);
        }
        pair = next_pair(pixel, own, &slots);
        if pair.partner.x == NONE {
            break;
        }
    }
    return deferred;
}

#ifdef DEFERS_REPLAYS
@group(2) @binding(4) var<storage, read_write> queue: array<atomic<u32>>;

// Entries of the workgroup, and the first of them in the queue.
var<workgroup> count: atomic<u32>;
var<workgroup> first: u32;

fn is_deferred(r: Receiver, s: Reservoir) -> bool {
    return s.ucw > 0.0 && needs_replay(r, s);
}

// Workgroups reserve their entries together, so that the counter of the queue is no bottleneck.
fn enqueue(pixel: vec2<u32>, deferred: u32, thread: u32) {
    // Bevy turns off the zero-initialization of workgroup memory.
    if thread == 0u {
        atomicStore(&count, 0u);
    }
    workgroupBarrier();
    var index = 0u;
    if deferred != 0u {
        index = atomicAdd(&count, 1u);
    }
    workgroupBarrier();
    let total = atomicLoad(&count);
    if thread == 0u && total > 0u {
        first = atomicAdd(&queue[QUEUE_COUNT], total);
        atomicMax(&queue[0], min((first + total + QUEUE_THREADS - 1u) / QUEUE_THREADS, MAX_WORKGROUPS));
        atomicMax(&queue[1], 1u);
        atomicMax(&queue[2], 1u);
    }
    workgroupBarrier();
    if deferred != 0u {
        let entry = QUEUE_HEADER + 2u * (first + index);
        atomicStore(&queue[entry], pixel.x | (pixel.y << COORDINATE_BITS));
        atomicStore(&queue[entry + 1u], deferred);
    }
}
#else
fn is_deferred(r: Receiver, s: Reservoir) -> bool {
    return false;
}

fn enqueue(pixel: vec2<u32>, deferred: u32, thread: u32) {
}
#endif
#endif
