// Light sub-paths of a frame: each leaves a vertex in the light vertex cache, and its splats in the light map.
//
// The light map begins with the head of a list for each pixel: an entry's index plus 1, or 0.  Then come the entries, SPLATS_OF_A_PATH for
// each sub-path, of four words: the next entry in the same form, and radiance.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::{rng_1, rng_bits, rng_new, STREAM_LIGHT_PATHS}
#import bevy_restir::path::light_path::{advance_light_path, begin_light_path}
#import bevy_restir::restir::bdpt::light_vertex::{light_vertex_pack, LightVertex, offer_vertex, PackedLightVertex}
#import bevy_restir::restir::bdpt::splat::{merged_splat, Splat, splat_of, SPLATS_OF_A_PATH}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(1) var<storage, read_write> light_vertices: array<PackedLightVertex>;
@group(2) @binding(2) var<storage, read_write> light_map: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn light_paths(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= view.size) {
        return;
    }
    let pixels = view.size.x * view.size.y;
    for (var path = id.y * view.size.x + id.x; path < settings.light_paths; path += pixels) {
        trace(path);
    }
    count_rays(id.xy);
}

fn trace(path: u32) {
    var rng = rng_new(vec2<u32>(path & 0xffffu, path >> 16u), view.frame, STREAM_LIGHT_PATHS, view.seed);
    var kept: LightVertex;
    var count = 0u;
    var last = Splat(NONE, vec3<f32>(0.0));
    var last_sum = 0.0;
    var w = begin_light_path(&rng);
    for (var event = 1u; event <= view.bounces; event++) {
        if w.events == 0u {
            break;
        }
        // A connection adds an event at the camera's end at least.
        if event < view.bounces {
            kept = offer_vertex(kept, w, &rng);
        }
        let u = rng_1(&rng);
        let alpha_seed = rng_bits(&rng).x;
        if settings.splats > 0u {
            let s = splat_of(w, alpha_seed);
            if s.pixel != NONE && count + 1u < SPLATS_OF_A_PATH {
                insert(path * SPLATS_OF_A_PATH + count, s);
                count += 1u;
            } else if s.pixel != NONE {
                last = merged_splat(last, last_sum, s, u);
                last_sum += luminance(s.value);
            }
        }
        if event < view.bounces {
            w = advance_light_path(w, &rng);
        }
    }
    if last.pixel != NONE {
        insert(path * SPLATS_OF_A_PATH + count, Splat(last.pixel, last.value * (last_sum / luminance(last.value))));
    }
    light_vertices[path] = light_vertex_pack(kept);
}

// Adds an entry to the list of its pixel.
fn insert(entry: u32, s: Splat) {
    let at = view.size.x * view.size.y + 4u * entry;
    atomicStore(&light_map[at], atomicExchange(&light_map[s.pixel], entry + 1u));
    atomicStore(&light_map[at + 1u], bitcast<u32>(s.value.x));
    atomicStore(&light_map[at + 2u], bitcast<u32>(s.value.y));
    atomicStore(&light_map[at + 3u], bitcast<u32>(s.value.z));
}
