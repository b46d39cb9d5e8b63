// Initial candidates of ReSTIR PT (paper 000): one tree of paths a pixel, resampled into one path.

#import bevy_restir::common::constants::NONE
#import bevy_restir::common::rng::{rng_new, STREAM_TREE}
#import bevy_restir::path::random::path_seed
#import bevy_restir::path::sample::{no_path_sample, path_pack, PackedPath}
#import bevy_restir::path::tree::{Chosen, path_tree}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::direct::receiver_of
#import bevy_restir::restir::types::PathSettings
#import bevy_restir::shift::connect::{Connection, connection_of}
#import bevy_restir::shift::hybrid::hybrid_shift
#import bevy_restir::trace::ray::{rays_traced, trace_flags}
#import bevy_restir::view::bindings::{ray_counts, view, visibility}
#import bevy_restir::view::camera::camera_position

@group(2) @binding(0) var<uniform> settings: PathSettings;
@group(2) @binding(1) var<storage, read_write> reservoirs: array<PackedPath>;
@group(2) @binding(2) var resampled: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let index = pixel.y * view.size.x + pixel.x;
    let ids = textureLoad(visibility, pixel, 0).xy;
    if ids.x == NONE || view.bounces == 0u {
        reservoirs[index] = path_pack(no_path_sample());
        textureStore(resampled, pixel, vec4<f32>(0.0));
        return;
    }
    var rng = rng_new(pixel, view.frame, STREAM_TREE, view.seed);
    let r = receiver_of(ids, pixel, false);
    let first = Vertex(r.surface, r.wo, vec3<f32>(0.0));
    let c = connection_of(camera_position(false), r.surface, settings.footprint, settings.roughness);
    let chosen = path_tree(first, path_seed(pixel), c, &rng);
    reservoirs[index] = path_pack(chosen.sample);
    textureStore(resampled, pixel, vec4<f32>(carried_by(chosen, first, c) * chosen.sample.ucw, 0.0));
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | trace_flags << 24u));
}

// TEST_*: what only tests define: here the path is shifted into its own pixel.
#ifdef TEST_SELF_SHIFT
fn carried_by(chosen: Chosen, first: Vertex, c: Connection) -> vec3<f32> {
    let s = hybrid_shift(chosen.sample, first, c, false);
    return s.f * s.jacobian;
}
#else
fn carried_by(chosen: Chosen, first: Vertex, c: Connection) -> vec3<f32> {
    return chosen.f;
}
#endif
