// Light sub-paths of a frame: each leaves a vertex in the light vertex cache, and its splats in the light map.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::{rng_1, STREAM_LIGHT_PATHS, STREAM_SPLATS}
#import bevy_restir::path::light_path::chosen_light
#import bevy_restir::restir::bdpt::light_map::{entry_pack, MapEntry, SPLAT_WORDS, SPLATS_OF_A_PATH, word_of}
#import bevy_restir::restir::connection::light_sub_path::{begin_sub_path, continue_sub_path, sub_path_rng, SubPath}
#import bevy_restir::restir::connection::light_vertex::{light_vertex_pack, LightVertex, offer_vertex, vertex_texel, VERTEX_TEXELS}
#import bevy_restir::restir::bdpt::splat::{no_splat, Splat, splat_of}
#import bevy_restir::restir::connection::count::CONNECTS
#import bevy_restir::restir::bindings::settings
#import bevy_restir::view::bindings::view
#import bevy_restir::view::pixel::pixel_index
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(1) var light_vertices: texture_storage_2d<rgba32uint, write>;
@group(2) @binding(2) var<storage, read_write> light_map: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn light_paths(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    let pixels = view.size.x * view.size.y;
    for (var path = pixel_index(pixel); path < settings.light_paths; path += pixels) {
        trace_sub_path(path);
    }
    count_rays(pixel);
}

// The splats of a sub-path beyond the first SPLATS_OF_A_PATH - 1, resampled into one in proportion to luminance.
struct Rest {
    splat: Splat,
    events: u32,
    sum: f32,
}

fn trace_sub_path(path: u32) {
    var rng = sub_path_rng(path, view.frame, STREAM_LIGHT_PATHS);
    var choices = sub_path_rng(path, view.frame, STREAM_SPLATS);
    var kept: LightVertex;
    var count = 0u;
    var rest = Rest(no_splat(), 1u, 0.0);
    let light = chosen_light(rng);
    // A connection adds at least one event, at its camera end.
    let last_connected = max(view.bounces, 1u) - 1u;
    let last = select(last_connected, view.bounces, settings.splats > 0u);
    var p: SubPath;
    if last > 0u {
        p = begin_sub_path(light, &rng, false);
    }
    for (var event = 1u; event <= last; event++) {
        if p.walk.events == 0u {
            break;
        }
        if event <= last_connected && CONNECTS {
            kept = offer_vertex(kept, p.walk, light, path, &choices);
        }
        let s = splat_of(p.walk, p.alpha_seed, false);
        let u = rng_1(&choices);
        if s.pixel != NONE {
            if count + 1u < SPLATS_OF_A_PATH {
                insert(path * SPLATS_OF_A_PATH + count, s, event, 1.0);
                count += 1u;
            } else {
                rest = merged(rest, s, event, u);
            }
        }
        if event < last {
            p = continue_sub_path(p.walk, &rng, false);
        }
    }
    if rest.splat.pixel != NONE {
        insert(path * SPLATS_OF_A_PATH + count, rest.splat, rest.events, rest.sum / luminance(rest.splat.value));
    }
    if CONNECTS {
        store_vertex(path, kept);
    }
}

fn store_vertex(path: u32, v: LightVertex) {
    var texels = light_vertex_pack(v);
    let at = vertex_texel(path);
    for (var i = 0u; i < VERTEX_TEXELS; i++) {
        textureStore(light_vertices, at + vec2<u32>(i, 0u), texels[i]);
    }
}

fn merged(rest: Rest, s: Splat, events: u32, u: f32) -> Rest {
    let value = luminance(s.value);
    var r = rest;
    r.sum += value;
    if u * r.sum < value {
        r.splat = s;
        r.events = events;
    }
    return r;
}

// Adds an entry to the list of its pixel.
fn insert(entry: u32, s: Splat, events: u32, multiplicity: f32) {
    let next = atomicExchange(&light_map[s.pixel], entry + 1u);
    var words = entry_pack(MapEntry(next, events, s.value * multiplicity, multiplicity, s.diffuse, s.reconnects));
    let at = word_of(entry + 1u);
    for (var i = 0u; i < SPLAT_WORDS; i++) {
        atomicStore(&light_map[at + i], words[i]);
    }
}
