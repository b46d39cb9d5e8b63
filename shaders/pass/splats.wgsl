// Candidates of light sub-paths whose last edge cannot be reconnected: one of those that land in a pixel, which stands for all of them.

#import bevy_restir::common::constants::LEAST_DIVISOR
#import bevy_restir::common::guard::{GUARD_CONTRIBUTION_WEIGHT, guarded}
#import bevy_restir::common::math::{is_finite_3, luminance}
#import bevy_restir::common::rng::STREAM_LIGHT_PATHS
#import bevy_restir::path::light_path::chosen_light
#import bevy_restir::restir::bdpt::landed::{entry_of, landed_splats}
#import bevy_restir::restir::bdpt::light_map::SPLATS_OF_A_PATH
#import bevy_restir::restir::bdpt::splat::Splat
#import bevy_restir::restir::connection::light_sub_path::sub_path_rng
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::splats::domain::{contribution_of, has_changed}
#import bevy_restir::restir::splats::reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack}
#import bevy_restir::view::bindings::view
#import bevy_restir::view::light_part::pack_share
#import bevy_restir::view::ray_counter::count_guards

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(3) var contributions: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn splats(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let landed = landed_splats(pixel, false);
    var r = no_reservoir();
    if landed.chosen != 0u {
        r = sample_of(landed.chosen);
        r.ucw = guarded(luminance(landed.sum) / max(luminance(r.f), LEAST_DIVISOR), GUARD_CONTRIBUTION_WEIGHT);
    }
    // The candidates of a pixel count as one sample, however many of them land in it.
    r.confidence = 1.0;
    // The color of all splats, scaled to the luminance of the chosen one.  Where something changed, MIS weights differ between the splats
    // of a pixel, and a weight holds for the color of its own splat only.
    let color = select(landed.sum / max(r.ucw, LEAST_DIVISOR), r.f, has_changed());
    let contribution = select(vec3<f32>(0.0), color, r.ucw > 0.0 && is_finite_3(color));
    reservoirs[reservoir_index(pixel)] = reservoir_pack(r);
    textureStore(contributions, pixel, vec4<f32>(contribution, pack_share(share_of(landed.diffuse, landed.sum))));
    count_guards(pixel);
}

fn share_of(part: vec3<f32>, sum: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(0.0), part / sum, sum > vec3<f32>(0.0));
}

// The vertex of an entry, without its weight.
fn sample_of(link: u32) -> Reservoir {
    let e = entry_of(link);
    var r = no_reservoir();
    r.path = (link - 1u) / SPLATS_OF_A_PATH;
    r.frame = view.frame;
    r.events = e.events;
    r.light = chosen_light(sub_path_rng(r.path, r.frame, STREAM_LIGHT_PATHS));
    r.f = contribution_of(Splat(0u, e.value / e.multiplicity, e.diffuse, false), r.light);
    r.diffuse = e.diffuse;
    return r;
}
