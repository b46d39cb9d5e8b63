// Candidates of light sub-paths: one of the splats that land in a pixel, which stands for all of them.

#import bevy_restir::common::constants::OVERFLOW_STEPS
#import bevy_restir::common::guard::{GUARD_CONTRIBUTION_WEIGHT, guarded}
#import bevy_restir::common::math::{is_finite_3, luminance, max_component}
#import bevy_restir::common::ray::trace_flags
#import bevy_restir::common::rng::{rng_bits, STREAM_LIGHT_PATHS, STREAM_SPLATS}
#import bevy_restir::path::light_path::chosen_light
#import bevy_restir::restir::bdpt::light_map::{entry_unpack, exact_add, exact_sum, exact_total, MapEntry, MAX_ENTRIES, Race, race_add, SPLAT_WORDS, SPLATS_OF_A_PATH, word_of}
#import bevy_restir::restir::connection::light_sub_path::sub_path_rng
#import bevy_restir::restir::bdpt::splat::Splat
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::splats::domain::{contribution_of, has_changed}
#import bevy_restir::restir::splats::reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::light_part::{pack_share, SPLITS_LIGHT, unpack_share}
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::ray_counter::count_guards

@group(2) @binding(1) var<storage, read> light_map: array<u32>;
@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var contributions: texture_storage_2d<rgba32float, write>;

// First dimension of the races.  `pass/light_paths.wgsl` takes two numbers of the same stream for each vertex of a sub-path, at most 128.
const DIMENSION_SPLAT_RACE: u32 = 1024u;

// The splats of a pixel.
struct Landed {
    sum: vec3<f32>,
    diffuse: vec3<f32>,        // part of the sum that surfaces scatter diffusely; without SPLIT_LIGHT 0
    chosen: u32,               // link of the chosen entry, or 0
}

@compute @workgroup_size(8, 8)
fn splats(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let landed = landed_splats(light_map[pixel_index(pixel)]);
    var r = no_reservoir();
    if landed.chosen != 0u {
        r = sample_of(landed.chosen);
        r.ucw = guarded(luminance(landed.sum) / max(luminance(r.f), 1.0e-37), GUARD_CONTRIBUTION_WEIGHT);
    }
    // The candidates of a pixel count as one sample, however many of them land in it.
    r.confidence = 1.0;
    // The color of all splats, scaled to the luminance of the chosen one.  Where something changed, MIS weights differ between the splats
    // of a pixel, and a weight holds for the color of its own splat only.
    let color = select(landed.sum / max(r.ucw, 1.0e-37), r.f, has_changed());
    let contribution = select(vec3<f32>(0.0), color, r.ucw > 0.0 && is_finite_3(color));
    reservoirs[reservoir_index(pixel)] = reservoir_pack(r);
    textureStore(contributions, pixel, vec4<f32>(contribution, pack_share(share_of(landed.diffuse, landed.sum))));
    count_guards(pixel);
}

fn entry_of(link: u32) -> MapEntry {
    let word = word_of(link);
    var words: array<u32, SPLAT_WORDS>;
    for (var i = 0u; i < SPLAT_WORDS; i++) {
        words[i] = light_map[word + i];
    }
    return entry_unpack(words);
}

// Sums up a list and chooses one of its entries in proportion to luminance.
fn landed_splats(head: u32) -> Landed {
    var largest = 0.0;
    var next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        let e = entry_of(next);
        largest = max(largest, max_component(e.value));
        next = e.next;
    }
    var sum = exact_sum(largest);
    var diffuse = sum;
    var race = Race(0u, 3.0e38);
    next = head;
    for (var i = 0u; next != 0u && i < MAX_ENTRIES; i++) {
        let e = entry_of(next);
        exact_add(&sum, e.value);
        if SPLITS_LIGHT {
            exact_add(&diffuse, e.value * unpack_share(bitcast<f32>(e.diffuse)));
        }
        let weight = luminance(e.value) / max(largest, 1.0e-37);
        if weight > 0.0 {
            race_add(&race, next, weight, race_bits(next));
        }
        next = e.next;
    }
    if next != 0u {
        trace_flags |= OVERFLOW_STEPS;
    }
    return Landed(exact_total(sum), exact_total(diffuse), race.winner);
}

fn share_of(part: vec3<f32>, sum: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(0.0), part / sum, sum > vec3<f32>(0.0));
}

fn race_bits(link: u32) -> u32 {
    let entry = link - 1u;
    var rng = sub_path_rng(entry / SPLATS_OF_A_PATH, view.frame, STREAM_SPLATS);
    rng.dimension = DIMENSION_SPLAT_RACE + entry % SPLATS_OF_A_PATH;
    return rng_bits(&rng).x;
}

// The vertex of an entry, without its weight.
fn sample_of(link: u32) -> Reservoir {
    let e = entry_of(link);
    var r = no_reservoir();
    r.path = (link - 1u) / SPLATS_OF_A_PATH;
    r.frame = view.frame;
    r.events = e.events;
    r.light = chosen_light(sub_path_rng(r.path, r.frame, STREAM_LIGHT_PATHS));
    r.f = contribution_of(Splat(0u, e.value / e.multiplicity, e.diffuse), r.light);
    r.diffuse = e.diffuse;
    return r;
}
