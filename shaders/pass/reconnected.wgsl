// Candidates of light sub-paths whose last edge can be reconnected: one of those that land in a pixel, which stands for all of them.  Its
// light sub-path is traced again, because the light map does not hold the vertex before the one that the camera sees.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::guard::{GUARD_CONTRIBUTION_WEIGHT, guarded}
#import bevy_restir::common::math::luminance
#import bevy_restir::common::rng::STREAM_LIGHT_PATHS
#import bevy_restir::path::light_path::chosen_light
#import bevy_restir::restir::bdpt::landed::{entry_of, landed_splats}
#import bevy_restir::restir::bdpt::light_map::SPLATS_OF_A_PATH
#import bevy_restir::restir::connection::light_sub_path::{continue_sub_path, event_rng, replayed_sub_path, sub_path_rng}
#import bevy_restir::restir::reconnected::domain::{evaluate, is_vertex_of, Receiver, target_value, with_vertex}
#import bevy_restir::restir::reconnected::reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::view
#import bevy_restir::view::camera::camera_point
#import bevy_restir::view::pixel::pixel_at
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var contributions: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reconnected(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    let landed = landed_splats(pixel, true);
    var r = no_reservoir();
    var contribution = vec3<f32>(0.0);
    if landed.chosen != 0u {
        r = sample_of(landed.chosen);
    }
    if r.instance != NONE {
        // The path that is weighted is the one that is stored.
        r = reservoir_unpack(reservoir_pack(r));
        let e = evaluate(Receiver(pixel, false), r);
        r.target_value = target_value(e);
        if r.target_value > 0.0 {
            contribution = e.f;
            r.ucw = guarded(luminance(landed.sum) / r.target_value, GUARD_CONTRIBUTION_WEIGHT);
        }
    }
    // The candidates of a pixel count as one sample, however many of them land in it.
    r.confidence = 1.0;
    reservoirs[reservoir_index(pixel)] = reservoir_pack(r);
    textureStore(contributions, pixel, vec4<f32>(contribution, 0.0));
    count_rays(pixel);
}

// The path of an entry, without its weight; no path if rounding has led its light sub-path elsewhere.
fn sample_of(link: u32) -> Reservoir {
    var r = no_reservoir();
    r.path = (link - 1u) / SPLATS_OF_A_PATH;
    r.frame = view.frame;
    r.events = entry_of(link).events;
    r.light = chosen_light(sub_path_rng(r.path, r.frame, STREAM_LIGHT_PATHS));
    let w = replayed_sub_path(r.path, r.frame, r.light, r.events - 1u, false).walk;
    if !is_vertex_of(r, w) {
        return no_reservoir();
    }
    var rng = event_rng(r.path, r.frame, r.events);
    let last = continue_sub_path(w, &rng, false).walk;
    if last.events == 0u {
        return no_reservoir();
    }
    let at = camera_point(view.current, last.surface.position).at;
    r.place = at - vec2<f32>(pixel_at(at));
    return with_vertex(r, w);
}
