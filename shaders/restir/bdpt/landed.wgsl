// The light paths that land in a pixel: their sum, and a choice of one of them.
#define_import_path bevy_restir::restir::bdpt::landed

#import bevy_restir::common::constants::{LEAST_DIVISOR, OVERFLOW_STEPS}
#import bevy_restir::common::math::{luminance, max_component}
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::common::rng::{rng_bits, STREAM_SPLATS}
#import bevy_restir::restir::bdpt::light_map::{entry_unpack, exact_add, exact_sum, exact_total, MapEntry, MAX_ENTRIES, new_race, race_add, SPLAT_WORDS, SPLATS_OF_A_PATH, word_of}
#import bevy_restir::restir::bdpt::map_bindings::light_map
#import bevy_restir::restir::connection::light_sub_path::sub_path_rng
#import bevy_restir::view::bindings::view
#import bevy_restir::view::light_part::{SPLITS_LIGHT, unpack_share}
#import bevy_restir::view::pixel::pixel_index

// First dimension of the races.  `pass/light_paths.wgsl` takes two numbers of the same stream for each vertex of a sub-path, at most 128.
const DIMENSION_SPLAT_RACE: u32 = 1024u;

// The splats of a pixel that belong to one domain.
struct Landed {
    sum: vec3<f32>,
    diffuse: vec3<f32>,        // part of the sum that surfaces scatter diffusely; without SPLIT_LIGHT 0
    chosen: u32,               // link of the chosen entry, or 0
}

fn entry_of(link: u32) -> MapEntry {
    let word = word_of(link);
    var words: array<u32, SPLAT_WORDS>;
    for (var i = 0u; i < SPLAT_WORDS; i++) {
        words[i] = light_map[word + i];
    }
    return entry_unpack(words);
}

// Sums up the entries of a pixel's list that can be reconnected, or the others, and chooses one of them in proportion to luminance.
fn landed_splats(pixel: vec2<u32>, reconnects: bool) -> Landed {
    let head = light_map[pixel_index(pixel)];
    var largest = 0.0;
    var next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        let e = entry_of(next);
        largest = max(largest, select(0.0, max_component(e.value), e.reconnects == reconnects));
        next = e.next;
    }
    var sum = exact_sum(largest);
    var diffuse = sum;
    var race = new_race();
    next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        let e = entry_of(next);
        if e.reconnects == reconnects {
            exact_add(&sum, e.value);
            if SPLITS_LIGHT {
                exact_add(&diffuse, e.value * unpack_share(bitcast<f32>(e.diffuse)));
            }
            let weight = luminance(e.value) / max(largest, LEAST_DIVISOR);
            if weight > 0.0 {
                race_add(&race, next, weight, race_bits(next));
            }
        }
        next = e.next;
    }
    if next != 0u {
        trace_flags |= OVERFLOW_STEPS;
    }
    return Landed(exact_total(sum), exact_total(diffuse), race.winner);
}

fn race_bits(link: u32) -> u32 {
    let entry = link - 1u;
    var rng = sub_path_rng(entry / SPLATS_OF_A_PATH, view.frame, STREAM_SPLATS);
    rng.dimension = DIMENSION_SPLAT_RACE + entry % SPLATS_OF_A_PATH;
    return rng_bits(&rng).x;
}
