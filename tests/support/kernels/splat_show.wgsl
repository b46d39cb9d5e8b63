// Shows the contributions of the samples that come from the last frame, and keeps this frame's candidates.  Tests run it instead of
// `shaders/pass/reuse.wgsl`.

#import domain::{PackedReservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::bindings::{previous_visibility, settings}
#import bevy_restir::restir::reservoir_layout::reservoir_index
#import bevy_restir::view::bindings::view

@group(2) @binding(1) var<storage, read> neighbors: array<PackedReservoir>;
@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
@group(2) @binding(4) var own_contribution: texture_2d<f32>;
@group(2) @binding(5) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn reuse(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel);
    reservoirs[index] = reservoir_pack(reservoir_unpack(reservoirs[index]));
    var shown = textureLoad(own_contribution, pixel, 0).rgb * 0.0;
    if settings.temporal_samples > 0u {
        shown = reservoir_unpack(neighbors[index]).f;
    }
    textureStore(resampled, pixel, vec4<f32>(shown + vec3<f32>(textureLoad(previous_visibility, pixel, 0).rgb) * 0.0, 0.0));
}
