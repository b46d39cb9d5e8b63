// Initial candidates of ReSTIR PT (paper 000): one tree of paths a pixel, resampled into one path.  Nothing reuses them yet: what they
// carry joins the pixel's sum.

#import bevy_restir::common::constants::{NONE, NON_FINITE}
#import bevy_restir::common::math::is_finite_3
#import bevy_restir::common::rng::{rng_new, STREAM_TREE}
#import bevy_restir::path::random::path_seed
#import bevy_restir::path::sample::{path_pack, path_unpack}
#import bevy_restir::path::tree::{Chosen, path_tree}
#import bevy_restir::path::walk::Vertex
#import bevy_restir::restir::direct::receiver_of
#import bevy_restir::shift::connect::{Connection, connection_of}
#import bevy_restir::shift::hybrid::hybrid_shift
#import bevy_restir::trace::ray::{rays_traced, trace_flags}
#import bevy_restir::view::backdrop::backdrop
#import bevy_restir::view::bindings::{ray_counts, view, visibility}
#import bevy_restir::view::camera::{camera_position, primary_ray}

@group(2) @binding(0) var<storage, read_write> radiance: array<vec4<f32>>;

// Paper 000: c = 0.02, roughness from 0.2.
const FOOTPRINT: f32 = 0.02;
const ROUGHNESS: f32 = 0.2;

@compute @workgroup_size(8, 8)
fn path_candidates(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= view.size) {
        return;
    }
    let ids = textureLoad(visibility, pixel, 0).xy;
    var light = vec3<f32>(0.0);
    if ids.x == NONE {
        light = backdrop(primary_ray(pixel).direction);
    } else {
        let r = receiver_of(ids, pixel, false);
        light = r.surface.emission + r.surface.unlit;
        let first = Vertex(r.surface, r.wo, vec3<f32>(0.0));
        let c = connection_of(camera_position(false), r.surface, FOOTPRINT, ROUGHNESS);
        var rng = rng_new(pixel, view.frame, STREAM_TREE, view.seed);
        let chosen = path_tree(first, path_seed(pixel), c, &rng);
        if chosen.sample.ucw > 0.0 {
            light += carried_by(chosen, first, c) * chosen.sample.ucw;
        }
    }
    var flags = trace_flags;
    if !is_finite_3(light) {
        light = vec3<f32>(0.0);
        flags |= NON_FINITE;
    }
    let index = pixel.y * view.size.x + pixel.x;
    var sum = vec4<f32>(light, 1.0);
    if view.accumulated > 0u {
        sum += radiance[index];
    }
    radiance[index] = sum;
    let counted = textureLoad(ray_counts, pixel).x;
    textureStore(ray_counts, pixel, vec4<u32>((counted + rays_traced) | flags << 24u));
}

// TEST_*: what only tests define.  The path goes through its 64 bytes and is shifted into its own pixel: (why it could not be, what it
// is, the relative error of what it carries).
#ifdef TEST_SHIFT_REASON
fn carried_by(chosen: Chosen, first: Vertex, c: Connection) -> vec3<f32> {
    let s = hybrid_shift(path_unpack(path_pack(chosen.sample)), first, c, false);
    let error = distance(s.f * s.jacobian, chosen.f) / max(length(chosen.f), 1.0e-30);
    return vec3<f32>(f32(s.reason), f32(chosen.sample.end) + 10.0 * f32(chosen.sample.length) + 1000.0 * f32(chosen.sample.reconnection), error) / chosen.sample.ucw;
}
#else
fn carried_by(chosen: Chosen, first: Vertex, c: Connection) -> vec3<f32> {
    return chosen.f;
}
#endif
