// Shifts the sample of each partner of a pixel to the pixel, and stores the result for both of them: the pixel resamples it, and the partner
// needs it for the MIS weight of its own sample.  Without pairs every pixel would do both shifts.

#import technique::{evaluate, is_visible, kept_shift, PackedReservoir, receiver_of, receives_light, reservoir_unpack, target_value}
#import bevy_restir::common::constants::NONE
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::pairs::next_pair
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::ray_counter::count_rays

// Only domains of paths make pairs, and a path has an alpha seed of its own.
const NO_ALPHA_SEED: u32 = 0u;

// The samples that the iteration resamples.
@group(2) @binding(1) var<storage, read> samples: array<PackedReservoir>;
// A layer for each shift of a pixel: what `kept_shift` keeps of it; 0 where it is not defined or the sample is occluded.
@group(2) @binding(2) var shifts: texture_storage_2d_array<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn pair_shifts(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    if !receives_light(ids) || view.bounces == 0u {
        return;
    }
    let r = receiver_of(ids, pixel, false);
    var slot = 0u;
    loop {
        let pair = next_pair(pixel, &slot);
        if pair.partner.x == NONE {
            break;
        }
        let s = reservoir_unpack(samples[reservoir_index(pair.partner, view.size, settings.reservoir_layout)]);
        var shift = vec4<f32>(0.0);
        if s.ucw > 0.0 {
            let e = evaluate(r, s);
            if target_value(e) > 0.0 && is_visible(r, e, NO_ALPHA_SEED) {
                shift = kept_shift(e);
            }
        }
        textureStore(shifts, pixel, pair.own_layer, shift);
    }
    count_rays(pixel);
}
