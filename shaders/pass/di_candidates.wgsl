// Initial candidates of ReSTIR DI (Wyman and Panteleev 2021, 3 and 5).  Light that only BSDF sampling finds (in mirrors, and of lights that
// are not in the table) is not resampled, but written as light.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_new, STREAM_DI_CANDIDATES}
#import bevy_restir::restir::di::domain::receiver_of
#import bevy_restir::restir::di::initial_candidates::sample_candidates
#import bevy_restir::restir::di::reservoir::{no_reservoir, PackedReservoir, reservoir_pack}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::{view, visibility}
#import bevy_restir::view::ray_counter::count_rays

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
// The contribution of the selected sample.
@group(2) @binding(3) var contribution: texture_storage_2d<rgba32float, write>;
@group(2) @binding(4) var unresampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn di_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy + view.first_pixel;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(contribution, pixel, vec4<f32>(0.0));
        textureStore(unresampled, pixel, vec4<f32>(0.0));
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_DI_CANDIDATES, view.seed);
    let selected = sample_candidates(receiver_of(ids, pixel, false), pixel, &rng);
    reservoirs[index] = reservoir_pack(selected.reservoir);
    textureStore(contribution, pixel, vec4<f32>(selected.f, 0.0));
    textureStore(unresampled, pixel, selected.unresampled);
    count_rays(pixel);
}
