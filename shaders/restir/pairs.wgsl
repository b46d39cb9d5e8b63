// The pairs of a pixel that exchange their samples in paired spatial reuse.  Both pixels of a pair come to the same decision, from the
// masks of similar partners that `pass/pair_neighbors.wgsl` writes: by geometry and random numbers alone, never by a sample.
#define_import_path bevy_restir::restir::pairs

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{seeded, STREAM_PAIRS}
#import bevy_restir::restir::bindings::{pair_masks, settings}
#import bevy_restir::restir::iteration_rng::iteration_stream
#import bevy_restir::restir::pairing::{pair_key, partner_of}
#import bevy_restir::view::bindings::view

// Number of involutions of an iteration: a pixel has a partner in each.
const PAIR_SLOTS: u32 = 16u;
// Bit of a mask after those of the slots: the surface has just come into view.
const PAIR_IS_NEW: u32 = 0x10000u;

// A pair that is used.
struct Pair {
    partner: vec2<u32>,        // NONE: the slot is not used
    own_layer: u32,            // of the shift of the partner's sample to the pixel
    partner_layer: u32,        // of the shift of the pixel's sample to the partner
    slot: u32,
}

// The mask of similar partners of a pixel.
fn pair_mask(pixel: vec2<u32>) -> u32 {
    return textureLoad(pair_masks, pixel, 0).x;
}

// The slots of a mask, as bits.
fn slots_of(mask: u32) -> u32 {
    return mask & (PAIR_IS_NEW - 1u);
}

// The partner of a pixel in a slot; it may lie outside of the image.
fn partner_in_slot(pixel: vec2<u32>, slot: u32) -> vec2<u32> {
    let stream = seeded(iteration_stream(STREAM_PAIRS), view.seed);
    return partner_of(pixel, settings.pair_tile_bits, pair_key(view.frame, stream, slot));
}

// The pair of a pixel in a slot of its mask, `own`.  A mask has at most as many slots as there are layers.  A pixel wants as many neighbors
// as its settings ask for, and takes the first ones of its slots.  A pair is used if one of its pixels wants the other: so pixels at edges,
// which have few similar partners, keep those that they have.
fn pair_in_slot(pixel: vec2<u32>, own: u32, slot: u32) -> Pair {
    var pair = Pair(vec2<u32>(NONE), 0u, 0u, slot);
    let partner = partner_in_slot(pixel, slot);
    let other = pair_mask(partner);
    // Rounding may make a surface similar to another that is not similar to it; and the partner may have found enough others before.
    if !has_slot(other, slot) {
        return pair;
    }
    let own_rank = rank_of(own, slot);
    let other_rank = rank_of(other, slot);
    if own_rank < wanted_pairs(own) || other_rank < wanted_pairs(other) {
        pair = Pair(partner, own_rank, other_rank, slot);
    }
    return pair;
}

// The next pair of a pixel, whose mask is `own`.  `slots` are the remaining slots; the call removes those up to the pair's.  The search is
// a loop of its own, so that threads that run together find their next pairs first and then do the work on them together, although these
// pairs are in different slots.
fn next_pair(pixel: vec2<u32>, own: u32, slots: ptr<function, u32>) -> Pair {
    var pair = Pair(vec2<u32>(NONE), 0u, 0u, 0u);
    loop {
        if *slots != 0u {
            pair = pair_in_slot(pixel, own, firstTrailingBit(*slots));
            *slots &= *slots - 1u;
        }
        if *slots == 0u || pair.partner.x != NONE {
            break;
        }
    }
    return pair;
}

fn has_slot(mask: u32, slot: u32) -> bool {
    return ((mask >> slot) & 1u) != 0u;
}

// Number of a mask's slots before this one.
fn rank_of(mask: u32, slot: u32) -> u32 {
    return countOneBits(mask & ((1u << slot) - 1u));
}

fn wanted_pairs(mask: u32) -> u32 {
    let is_new = (mask & PAIR_IS_NEW) != 0u;
    return select(settings.spatial_samples, max(settings.spatial_samples, settings.disocclusion_samples), is_new);
}
