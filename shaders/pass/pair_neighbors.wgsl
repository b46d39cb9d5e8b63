// Finds the partners of each pixel that are similar to it, for paired spatial reuse: a mask of slots (`restir/pairs.wgsl`).

#import domain::{PackedReservoir, reservoir_unpack}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::flags::has
#import bevy_restir::restir::neighbors::{are_similar, receives_light}
#import bevy_restir::restir::pairs::{PAIR_IS_NEW, PAIR_SLOTS, partner_in_slot}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::types::RESAMPLE_HEURISTICS
#import bevy_restir::scene::surface::Shape
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::primary::pixel_shape
#import bevy_restir::view::ray_counter::count_guards

// The samples that the iteration resamples.
@group(2) @binding(1) var<storage, read> samples: array<PackedReservoir>;
@group(2) @binding(2) var masks: texture_storage_2d<r32uint, write>;

@compute @workgroup_size(8, 8)
fn pair_neighbors(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    var mask = 0u;
    if receives_light(ids) && view.bounces > 0u {
        mask = similar_partners(ids, pixel);
        // The samples are read only where new surfaces get more neighbors.
        if settings.disocclusion_samples > settings.spatial_samples {
            let own = reservoir_unpack(samples[reservoir_index(pixel)]);
            mask |= select(0u, PAIR_IS_NEW, own.confidence <= 1.0);
        }
    }
    textureStore(masks, pixel, vec4<u32>(mask));
    count_guards(pixel);
}

// Mask of the slots whose partners are similar: the first `pair_layers` of them.
fn similar_partners(ids: vec2<u32>, pixel: vec2<u32>) -> u32 {
    let own = pixel_shape(ids, pixel, false);
    var mask = 0u;
    for (var slot = 0u; slot < PAIR_SLOTS && countOneBits(mask) < settings.pair_layers; slot++) {
        let partner = partner_in_slot(pixel, slot);
        if any(partner >= view.size) {
            continue;
        }
        let partner_ids = textureLoad(visibility, partner, 0).xy;
        if receives_light(partner_ids) && (!has(RESAMPLE_HEURISTICS) || is_mutual(own, pixel_shape(partner_ids, partner, false))) {
            mask |= 1u << slot;
        }
    }
    return mask;
}

fn is_mutual(a: Shape, b: Shape) -> bool {
    return are_similar(a, b, false) && are_similar(b, a, false);
}
