// Initial candidates of ReSTIR PT (paper 000): one tree of paths a pixel, resampled into one path.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_new, STREAM_TREE}
#import bevy_restir::path::tree::{Chosen, path_tree}
#import bevy_restir::restir::bindings::settings
#import bevy_restir::restir::path_reservoir::{no_reservoir, PackedReservoir, Reservoir, reservoir_pack, reservoir_unpack}
#import bevy_restir::restir::paths::{Receiver, receiver_of}
#import bevy_restir::restir::tiling::reservoir_index
#import bevy_restir::shift::hybrid::hybrid_shift
#import bevy_restir::trace::ray::{rays_traced, trace_flags}
#import bevy_restir::view::bindings::{ray_counts, view, visibility}

@group(2) @binding(2) var<storage, read_write> reservoirs: array<PackedReservoir>;
// What the paths carry.
@group(2) @binding(3) var carried: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = reservoir_index(pixel, view.size, settings.tiling);
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = reservoir_pack(no_reservoir());
        textureStore(carried, pixel, vec4<f32>(0.0));
        return;
    }
    let r = receiver_of(ids, pixel, false);
    var rng = rng_new(pixel, view.frame, STREAM_TREE, view.seed);
    let chosen = path_tree(r.first, pixel, r.connection, &rng);
    let kept = Reservoir(chosen.path, chosen.ucw, 1.0, true);
    reservoirs[index] = reservoir_pack(kept);
    textureStore(carried, pixel, vec4<f32>(carried_by(chosen, kept, r), 0.0));
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}

// TEST_*: what only tests define.  The path goes through its 64 bytes and is shifted into its own pixel: (why it could not be, what it
// is, the relative error of what it carries).
#ifdef TEST_SHIFT_REASON
fn carried_by(chosen: Chosen, kept: Reservoir, r: Receiver) -> vec3<f32> {
    let s = hybrid_shift(reservoir_unpack(reservoir_pack(kept)).path, r.first, r.connection, false, true);
    let error = distance(s.f * s.jacobian, chosen.f) / max(length(chosen.f), 1.0e-30);
    let kind = f32(chosen.path.end) + 10.0 * f32(chosen.path.length) + 1000.0 * f32(chosen.path.reconnection);
    return vec3<f32>(f32(s.reason), kind, error) / max(chosen.ucw, 1.0e-30);
}
#else
fn carried_by(chosen: Chosen, kept: Reservoir, r: Receiver) -> vec3<f32> {
    return chosen.f;
}
#endif
