// Shifts each path of the last frame that stores a light vertex to its own pixel of the last frame, which changes nothing.  Tests run it
// instead of a reuse pass.  Writes (1, whether the shift finds the stored light vertex, 0).

#import domain::{in_current_frame, PackedReservoir, receiver_of, reservoir_unpack}
#import bevy_restir::common::constants::NONE
#import bevy_restir::restir::bindings::previous_visibility
#import bevy_restir::restir::connection::connection::stores_light_vertex
#import bevy_restir::restir::path_sample::with_shift_result
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::restir::shift::hybrid::hybrid_shift
#import bevy_restir::view::bindings::view

@group(2) @binding(1) var<storage, read> neighbors: array<PackedReservoir>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    if all(id.xy < view.size) {
        textureStore(resampled, id.xy, vec4<f32>(shifted_before(id.xy), 0.0));
    }
}

fn shifted_before(pixel: vec2<u32>) -> vec3<f32> {
    let ids = textureLoad(previous_visibility, pixel, 0).xy;
    let s = in_current_frame(reservoir_unpack(neighbors[reservoir_index(pixel)]));
    if ids.x == NONE || !(s.ucw > 0.0) || !stores_light_vertex(s.path) {
        return vec3<f32>(0.0);
    }
    let r = receiver_of(ids, pixel, true);
    let shifted = hybrid_shift(s.path, r.first, r.shift, true, true);
    let there = with_shift_result(s.path, shifted.result);
    let is_near = distance(there.barycentrics, s.path.barycentrics) < 1.0e-5 && dot(there.wi, s.path.wi) > 0.9999;
    let is_same = shifted.reason == 0u && there.instance == s.path.instance && there.triangle == s.path.triangle && is_near;
    return vec3<f32>(1.0, f32(is_same), 0.0);
}
