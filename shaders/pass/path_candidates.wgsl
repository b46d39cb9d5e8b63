// Initial candidates of ReSTIR PT, GI and BDPT (Lin et al. 2026; Lanz 2025, 4.3.2): the paths of one random walk for each pixel, resampled
// into one.

#import domain::{in_domain_measure, no_reservoir, PackedReservoir, receiver_of, Reservoir, reservoir_pack, SHORTEST_LENGTH}
#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_new, STREAM_PATH_CANDIDATES}
#import bevy_restir::restir::pt::initial_candidates::sample_candidates
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
// The contribution of the selected path.
@group(2) @binding(3) var contribution: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces + 1u < SHORTEST_LENGTH {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(contribution, pixel, vec4<f32>(0.0));
        return;
    }
    let r = receiver_of(ids, pixel, false);
    var rng = rng_new(pixel, view.frame, STREAM_PATH_CANDIDATES, view.seed);
    let selected = in_domain_measure(sample_candidates(r.first, pixel, SHORTEST_LENGTH, r.shift, &rng), r);
    reservoirs[index] = reservoir_pack(Reservoir(selected.path, selected.ucw, 1.0, true));
    textureStore(contribution, pixel, vec4<f32>(selected.f, 0.0));
    count_rays(pixel);
}
