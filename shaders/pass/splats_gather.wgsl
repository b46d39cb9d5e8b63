// Gives each pixel one of the samples of the last frame that land in it, in proportion to their weights.  These samples come from different
// pixels, and so from disjoint sets of sub-paths: each one counts in full, with a MIS weight of 1 (Hedstrom et al. 2025, A).

#import bevy_restir::common::constants::{NONE, OVERFLOW_STEPS}
#import bevy_restir::common::guard::{GUARD_CONTRIBUTION_WEIGHT, GUARD_RESAMPLING_WEIGHT, guarded}
#import bevy_restir::common::math::luminance
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::common::rng::{rng_bits, rng_of_key, STREAM_SPLATS}
#import bevy_restir::restir::bdpt::light_map::{exact_add, exact_sum, exact_total, MAX_ENTRIES, new_race, race_add}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::splats::reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::camera::{motion_of_sky, primary_ray, project}
#import bevy_restir::view::pixel::{is_in_picture, pixel_at}
#import bevy_restir::view::primary::previous_pixel_shape
#import bevy_restir::view::ray_counter::count_guards

@group(2) @binding(1) var<storage, read> last: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> forwarded: array<PackedReservoir>;

@compute @workgroup_size(8, 8)
fn splats_gather(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) || settings.temporal_samples == 0u {
        return;
    }
    let index = reservoir_index(pixel);
    var r = landed_sample(last[index].head);
    r.confidence = proxy_confidence(pixel);
    forwarded[index] = reservoir_pack(r);
    count_guards(pixel);
}

// Confidence must not depend on the samples that land in the pixel, so it is that of the pixel where its surface was in the last frame
// (ibid., Eq. 27).
fn proxy_confidence(pixel: vec2<u32>) -> f32 {
    let ids = textureLoad(visibility, pixel, 0).xy;
    var at = vec2<f32>(pixel) + 0.5;
    if ids.x == NONE {
        at += motion_of_sky(primary_ray(pixel).direction);
    } else {
        at = project(view.previous, previous_pixel_shape(ids, pixel).position);
    }
    if !is_in_picture(at) {
        return 0.0;
    }
    return reservoir_unpack(last[reservoir_index(pixel_at(at))]).confidence;
}

// One sample of a list, which stands for all of them.
fn landed_sample(head: u32) -> Reservoir {
    var largest = 0.0;
    var next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        largest = max(largest, weight_of(next - 1u));
        next = last[next - 1u].next;
    }
    if !(largest > 0.0) {
        return no_reservoir();
    }
    var sum = exact_sum(largest);
    var race = new_race();
    next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        let weight = weight_of(next - 1u);
        exact_add(&sum, vec3<f32>(weight));
        if weight / largest > 0.0 {
            race_add(&race, next, weight / largest, race_bits(next));
        }
        next = last[next - 1u].next;
    }
    if next != 0u {
        trace_flags |= OVERFLOW_STEPS;
    }
    var r = reservoir_unpack(last[race.winner - 1u]);
    r.ucw = guarded(exact_total(sum).x / luminance(r.f), GUARD_CONTRIBUTION_WEIGHT);
    return r;
}

fn weight_of(index: u32) -> f32 {
    let r = reservoir_unpack(last[index]);
    return guarded(luminance(r.f) * r.ucw, GUARD_RESAMPLING_WEIGHT);
}

fn race_bits(link: u32) -> u32 {
    var rng = rng_of_key(link, view.frame, STREAM_SPLATS, view.seed);
    rng.dimension = DIMENSION_FORWARD_RACE;
    return rng_bits(&rng).x;
}

// `pass/splats.wgsl` and `pass/light_paths.wgsl` use smaller dimensions of the same stream.
const DIMENSION_FORWARD_RACE: u32 = 2048u;
